"""A table of how message types say what is not known: from their documentation and REP 117."""
from dataclasses import dataclass, field
from typing import Mapping, Optional, Tuple

from shsa_core.model.kinds import Word

UNKNOWN_VARIANCE = 1e6
"""Says "not known" where 0 would claim certainty, as to robot_localization."""
NOT_GIVEN = -1.0
"""The first entry of a covariance of sensor_msgs/Imu whose values are not given at all."""


class Mark(Word):
    """The content of a field that nobody knows; a field that is no float needs one of its own.

    NAN: NaN. ZERO: 0. HELD: what the last good message had; 0 without one. HELD_OR_NAN: the same;
    NaN without one. SETTING: not measured but set, so it is as it was; NaN without a message.
    EMPTY: an array without items.
    """

    NAN = "nan"
    ZERO = "zero"
    HELD = "held"
    HELD_OR_NAN = "held_or_nan"
    SETTING = "setting"
    EMPTY = "empty"


@dataclass(frozen=True)
class Covariance:
    """A covariance matrix, or a variance, in `field`: its rows are those of the values `rows`.

    `group` is the field that holds them; where none of it is known, the first entry is `absent`, or
    else each variance is `unknown`.
    """

    field: str
    group: str
    rows: Tuple[str, ...]
    unknown: float = UNKNOWN_VARIANCE
    absent: Optional[float] = None


@dataclass(frozen=True)
class Flag:
    """A whole number that says that values are not known: `value`, unless all of `unless` are."""

    field: str
    value: int
    unless: Tuple[str, ...] = ()


@dataclass(frozen=True)
class Convention:
    """The way in which a type marks what is not known.

    `fields`: those with a mark of their own, which holds for all that is in them; `rest`: the mark
    of its other floats. What is of another type goes by that type's convention.
    """

    rest: Mark = Mark.NAN
    fields: Mapping[str, Mark] = field(default_factory=dict)
    covariances: Tuple[Covariance, ...] = ()
    flags: Tuple[Flag, ...] = ()


GENERIC = Convention()
"""Of a type that is not in the table: NaN, as a value that nobody knows must not be mistaken."""

_AXES = ("x", "y", "z")
_ANGLES = ("roll", "pitch", "yaw")


def _rows(group: str, names: Tuple[str, ...]) -> Tuple[str, ...]:
    return tuple(f"{group}.{name}" for name in names)


def _six(group: str, first: str, second: str, names: Tuple[str, ...]) -> Convention:
    rows = _rows(f"{group}.{first}", _AXES) + _rows(f"{group}.{second}", names)
    return Convention(covariances=(Covariance("covariance", group, rows),))


def _imu(group: str, names: Tuple[str, ...]) -> Covariance:
    return Covariance(f"{group}_covariance", group, _rows(group, names), absent=NOT_GIVEN)


def _measured(name: str) -> Convention:
    """One value with a `variance`, of which 0 is said to mean that it is not known."""
    return Convention(covariances=(Covariance("variance", name, (name,), unknown=0.0),))


CONVENTIONS: Mapping[str, Convention] = {
    # tf and robot_localization take no NaN: a pose stays, what moves or pushes is nothing.
    "geometry_msgs/Point": Convention(Mark.HELD),
    "geometry_msgs/Point32": Convention(Mark.HELD),
    "geometry_msgs/Quaternion": Convention(Mark.HELD),
    "geometry_msgs/Pose2D": Convention(Mark.HELD),
    "geometry_msgs/Transform": Convention(fields={"translation": Mark.HELD}),
    "geometry_msgs/Vector3": Convention(Mark.ZERO),
    "geometry_msgs/Inertia": Convention(Mark.SETTING, {"com": Mark.SETTING}),
    "geometry_msgs/PoseWithCovariance": _six("pose", "position", "orientation", _ANGLES),
    "geometry_msgs/TwistWithCovariance": _six("twist", "linear", "angular", _AXES),
    "geometry_msgs/AccelWithCovariance": _six("accel", "linear", "angular", _AXES),
    "ackermann_msgs/AckermannDrive": Convention(Mark.ZERO),
    "nav_msgs/MapMetaData": Convention(Mark.SETTING, {"origin": Mark.SETTING}),
    "sensor_msgs/Imu": Convention(
        covariances=(
            _imu("orientation", _ANGLES),
            _imu("angular_velocity", _AXES),
            _imu("linear_acceleration", _AXES),
        )
    ),
    # "If your sensor does not output 3 axes, put NaNs"; "0 is interpreted as variance unknown".
    "sensor_msgs/MagneticField": Convention(
        fields={"magnetic_field": Mark.NAN},
        covariances=(
            Covariance(
                "magnetic_field_covariance",
                "magnetic_field",
                _rows("magnetic_field", _AXES),
                unknown=0.0,
            ),
        ),
    ),
    # East, north, up in m: the error of a latitude, in degrees, is none of them.
    "sensor_msgs/NavSatFix": Convention(
        Mark.HELD,
        {"altitude": Mark.HELD_OR_NAN},
        covariances=(Covariance("position_covariance", "", ("", "", "altitude")),),
        flags=(
            Flag("status.status", -1, unless=("latitude", "longitude")),
            Flag("position_covariance_type", 0),
        ),
    ),
    # "The goal is to make each of the fields optional": what is not known is left out.
    "sensor_msgs/JointState": Convention(Mark.EMPTY),
    # "(If unmeasured NaN)", but for the voltage, which is mandatory.
    "sensor_msgs/BatteryState": Convention(
        fields={
            "voltage": Mark.HELD_OR_NAN,
            "capacity": Mark.SETTING,
            "design_capacity": Mark.SETTING,
        }
    ),
    # REP 117: a distance that is not valid is NaN. The limits and angles are the device's.
    "sensor_msgs/Range": Convention(Mark.SETTING, {"range": Mark.NAN}),
    "sensor_msgs/LaserScan": Convention(
        Mark.SETTING, {"ranges": Mark.NAN, "intensities": Mark.EMPTY}
    ),
    "sensor_msgs/CameraInfo": Convention(Mark.SETTING),
    "sensor_msgs/Joy": Convention(fields={"axes": Mark.ZERO, "buttons": Mark.ZERO}),
    "sensor_msgs/Temperature": _measured("temperature"),
    "sensor_msgs/FluidPressure": _measured("fluid_pressure"),
    "sensor_msgs/Illuminance": _measured("illuminance"),
    "sensor_msgs/RelativeHumidity": _measured("relative_humidity"),
}
