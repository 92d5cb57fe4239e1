"""Meanings of the fields of common message types: units (REP 103), and what has no bounds."""
from typing import Mapping, NamedTuple, Tuple


class Meaning(NamedTuple):
    """The meaning of the numbers within a field.

    `unit`: empty where nothing fixes it; `words`: what they are called, empty: as the field is;
    `bounded`: whether the robot stays about within what was seen; with places, angles and distances
    it does not.
    """

    unit: str = ""
    words: str = ""
    bounded: bool = True


NOTHING = Meaning()

_PLACE = Meaning("m", bounded=False)
_LENGTH, _ANGLE = Meaning("m"), Meaning("rad")
_CHARGE, _VOLTAGE, _CELSIUS = Meaning("A*h"), Meaning("V"), Meaning("degC")
_TURNED = Meaning("rad", bounded=False)

MEANINGS: Mapping[str, Mapping[str, Meaning]] = {
    "geometry_msgs/Twist": {
        "linear": Meaning("m/s", "linear_velocity"),
        "angular": Meaning("rad/s", "angular_velocity"),
    },
    "geometry_msgs/Accel": {
        "linear": Meaning("m/s^2", "linear_acceleration"),
        "angular": Meaning("rad/s^2", "angular_acceleration"),
    },
    "geometry_msgs/Wrench": {"force": Meaning("N"), "torque": Meaning("N*m")},
    "geometry_msgs/Pose": {"position": _PLACE, "orientation": _TURNED},
    "geometry_msgs/PointStamped": {"point": _PLACE},
    "geometry_msgs/QuaternionStamped": {"quaternion": _TURNED},
    **dict.fromkeys(("geometry_msgs/Point", "geometry_msgs/Point32"), dict.fromkeys("xyz", _PLACE)),
    "geometry_msgs/Quaternion": dict.fromkeys("xyzw", _TURNED),
    "geometry_msgs/Transform": {"translation": _PLACE, "rotation": _TURNED},
    "geometry_msgs/Pose2D": {"x": _PLACE, "y": _PLACE, "theta": _TURNED},
    "sensor_msgs/Imu": {
        "orientation": _TURNED,
        "angular_velocity": Meaning("rad/s"),
        "linear_acceleration": Meaning("m/s^2"),
    },
    "sensor_msgs/MagneticField": {"magnetic_field": Meaning("T")},
    "sensor_msgs/BatteryState": {
        "voltage": _VOLTAGE,
        "temperature": _CELSIUS,
        "current": Meaning("A"),
        **dict.fromkeys(("charge", "capacity", "design_capacity"), _CHARGE),
        "percentage": Meaning("1", "state_of_charge"),
        "cell_voltage": _VOLTAGE,
        "cell_temperature": _CELSIUS,
    },
    "sensor_msgs/Temperature": {"temperature": _CELSIUS},
    "sensor_msgs/FluidPressure": {"fluid_pressure": Meaning("Pa")},
    "sensor_msgs/Illuminance": {"illuminance": Meaning("lx")},
    "sensor_msgs/RelativeHumidity": {"relative_humidity": Meaning("1")},
    "sensor_msgs/Range": {
        "range": _PLACE,
        **dict.fromkeys(("min_range", "max_range"), _LENGTH),
        "field_of_view": _ANGLE,
    },
    "sensor_msgs/LaserScan": {
        "ranges": Meaning("m", "distance", bounded=False),
        **dict.fromkeys(("range_min", "range_max"), _LENGTH),
        **dict.fromkeys(("angle_min", "angle_max", "angle_increment"), _ANGLE),
        **dict.fromkeys(("time_increment", "scan_time"), Meaning("s")),
    },
    "sensor_msgs/JointState": {
        "position": _TURNED,
        "velocity": Meaning("rad/s"),
        "effort": Meaning("N*m"),
    },
    "sensor_msgs/NavSatFix": {
        **dict.fromkeys(("latitude", "longitude"), Meaning("degree", bounded=False)),
        "altitude": _PLACE,
    },
    "ackermann_msgs/AckermannDrive": {
        "steering_angle": _ANGLE,
        "steering_angle_velocity": Meaning("rad/s"),
        "speed": Meaning("m/s"),
        "acceleration": Meaning("m/s^2"),
        "jerk": Meaning("m/s^3"),
    },
}
"""By message type and field; what is not here has no unit that anybody could know."""

SLIDES = "sensor_msgs/JointState"
"""Its units are those of a joint that turns; of one that slides they are m, m/s and N."""


def meaning(chain: Tuple[Tuple[str, str], ...]) -> Meaning:
    """Return the meaning of a number by its chain of (message type, field); inner ones count."""
    for kind, field in reversed(chain):
        found = MEANINGS.get(kind, {}).get(field)
        if found is not None:
            return found
    return NOTHING
