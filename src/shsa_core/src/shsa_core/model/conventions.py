"""A table of how message types say what is not known: from their documentation and REP 117."""
from dataclasses import dataclass, field, replace
from math import nan
from typing import Mapping, Optional, Tuple

from shsa_core.errors import ShsaError
from shsa_core.model.field import parse_field
from shsa_core.model.field_type import FLOATS, Layout
from shsa_core.model.kinds import Word
from shsa_core.model.service import Service
from shsa_core.model.som import Som

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


def _vector(group: str, names: Tuple[str, ...], **unknown: float) -> Covariance:
    return Covariance(f"{group}_covariance", group, _rows(group, names), **unknown)


def _measured(name: str, unknown: float = 0.0) -> Convention:
    """One value with a `variance`; in sensor_msgs, 0 is said to mean that it is not known."""
    return Convention(covariances=(Covariance("variance", name, (name,), unknown=unknown),))


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
            _vector("orientation", _ANGLES, absent=NOT_GIVEN),
            _vector("angular_velocity", _AXES, absent=NOT_GIVEN),
            _vector("linear_acceleration", _AXES, absent=NOT_GIVEN),
        )
    ),
    # "If your sensor does not output 3 axes, put NaNs"; "0 is interpreted as variance unknown".
    "sensor_msgs/MagneticField": Convention(
        fields={"magnetic_field": Mark.NAN},
        covariances=(_vector("magnetic_field", _AXES, unknown=0.0),),
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
    # "(If unmeasured NaN)"; 0 is POWER_SUPPLY_STATUS_UNKNOWN and POWER_SUPPLY_HEALTH_UNKNOWN.
    "sensor_msgs/BatteryState": Convention(
        fields={"capacity": Mark.SETTING, "design_capacity": Mark.SETTING},
        flags=(
            Flag("power_supply_status", 0, unless=("power_supply_status",)),
            Flag("power_supply_health", 0, unless=("power_supply_health",)),
        ),
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
    "shsa_msgs/Float64Stamped": _measured("data", unknown=nan),
}


def with_unknowns(som: Som, layout: Layout) -> Som:
    """Return the SOM with a mark at each value of which its message can say that it is unknown."""

    def marked(service: Service) -> Service:
        marks = (_unknown_with(service.type, each.field, layout) for each in service.provides)
        provides = (replace(each, unknown_with=m) for each, m in zip(service.provides, marks))
        return replace(service, provides=tuple(provides))

    return som.with_services(map(marked, som))


def _unknown_with(kind: str, field_: str, layout: Layout) -> str:
    """Return the part of a message that is unknown where a field is; empty: that cannot be said."""
    names = [step.name for step in parse_field(field_).steps]
    mark: Optional[Mark] = None
    for place, name in enumerate(names):
        convention, rest = CONVENTIONS.get(kind, GENERIC), ".".join(names[place:])
        for covariance in convention.covariances:
            if covariance.absent is not None and f"{rest}.".startswith(f"{covariance.group}."):
                return ".".join([*names[:place], covariance.group])
        if any(flag.field == rest and flag.unless == (rest,) for flag in convention.flags):
            return field_
        if any(covariance.field == name for covariance in convention.covariances):
            return ""
        mark = mark or convention.fields.get(name)
        try:
            kind = layout(kind).get(name, "").partition("[")[0]
        except ShsaError:
            return ""  # it is not built here
        if kind in FLOATS and (mark or convention.rest) in (Mark.NAN, Mark.EMPTY):
            return field_
    return ""
