"""Fields of a substitute's message that it does not compute, type by type."""
import io
import math
import pathlib
from typing import Any, Dict, Optional, Type

import genpy
import pytest
from geometry_msgs.msg import (
    AccelStamped,
    PoseWithCovarianceStamped,
    Quaternion,
    TransformStamped,
    Twist,
    TwistWithCovarianceStamped,
)
from nav_msgs.msg import Odometry
from sensor_msgs.msg import (
    BatteryState,
    CameraInfo,
    FluidPressure,
    Illuminance,
    Imu,
    JointState,
    Joy,
    LaserScan,
    MagneticField,
    NavSatFix,
    Range,
    RelativeHumidity,
    Temperature,
)
from shsa_msgs.msg import Float64Stamped
from std_msgs.msg import Float64, Int32, String

from shsa_core import message_types
from shsa_core.errors import ShsaError
from shsa_core.model.conventions import CONVENTIONS, UNKNOWN_VARIANCE, with_unknowns
from shsa_core.model.kinds import Others
from shsa_core.model.service import Provision, Service
from shsa_core.model.som import Som
from shsa_core.ros.messages.fields import read_message
from shsa_core.substitution.composing import compose

LARGE = UNKNOWN_VARIANCE
UNKNOWN, LAST, ZERO = Others.UNKNOWN, Others.LAST, Others.ZERO


def data_of(message: genpy.Message) -> bytes:
    """A message as it travels."""
    buffer = io.BytesIO()
    message.serialize(buffer)
    return buffer.getvalue()


def composed(
    last: genpy.Message, others: Any = UNKNOWN, **errors: Optional[float]
) -> genpy.Message:
    """Compose from a last message that has travelled; it can travel again."""
    written = {name.replace("__", "."): error for name, error in errors.items()}
    kind = type(last)
    message = compose(kind, read_message(kind, data_of(last)), others, written)
    return read_message(kind, data_of(message))


def unknown(kind: Type[genpy.Message], **errors: Optional[float]) -> genpy.Message:
    """Compose where no last message is known."""
    written = {name.replace("__", "."): error for name, error in errors.items()}
    return read_message(kind, data_of(compose(kind, None, UNKNOWN, written)))


def diagonal(matrix: Any) -> list:
    """The variances of a matrix, of which all else is 0."""
    size = math.isqrt(len(matrix))
    assert [x for i, x in enumerate(matrix) if i % (size + 1) and x != 0.0] == []
    return [matrix[i * size + i] for i in range(size)]


def norm(q: Quaternion) -> float:
    """The length of a quaternion."""
    return math.sqrt(q.x**2 + q.y**2 + q.z**2 + q.w**2)


def odometry() -> Odometry:
    """A full message, in which every covariance claims much."""
    message = Odometry(child_frame_id="base_link")
    message.header.frame_id = "odom"
    message.pose.pose.position.x, message.pose.pose.position.y = 0.3, 9.7
    message.pose.pose.orientation.z, message.pose.pose.orientation.w = 0.6, 0.8
    message.twist.twist.linear.x, message.twist.twist.linear.y = 0.5, 0.1
    message.pose.covariance = [0.01] * 36
    message.twist.covariance = [0.02] * 36
    return message


def test_odometry_keeps_frames_and_pose_and_marks_what_is_not_known() -> None:
    message = composed(odometry(), twist__twist__linear__x=0.1, twist__twist__angular__z=None)
    assert (message.header.frame_id, message.child_frame_id) == ("odom", "base_link")
    assert message.pose.pose == odometry().pose.pose
    assert diagonal(message.pose.covariance) == [LARGE] * 6
    assert diagonal(message.twist.covariance) == pytest.approx([0.01] + [LARGE] * 5)
    assert message.twist.twist.linear.y == 0.0


def test_odometry_without_a_last_message_is_a_valid_one() -> None:
    message = unknown(Odometry, twist__twist__linear__x=0.1)
    assert message.pose.pose.orientation == Quaternion(0.0, 0.0, 0.0, 1.0)
    assert message.pose.pose.position.x == 0.0
    assert diagonal(message.pose.covariance) == [LARGE] * 6


def test_the_error_of_a_yaw_is_a_variance_about_z() -> None:
    for name in ("yaw(pose.pose.orientation)", "pose.pose.orientation.yaw"):
        message = composed(odometry(), **{name: 0.2})
        assert diagonal(message.pose.covariance) == pytest.approx([LARGE] * 5 + [0.04])


def test_pose_and_twist_with_covariance_go_by_their_own_rules() -> None:
    pose = composed(PoseWithCovarianceStamped(), pose__pose__position__z=2.0)
    assert diagonal(pose.pose.covariance) == [LARGE, LARGE, 4.0, LARGE, LARGE, LARGE]
    twist = composed(TwistWithCovarianceStamped(), twist__twist__angular__x=3.0)
    assert diagonal(twist.twist.covariance) == [LARGE] * 3 + [9.0, LARGE, LARGE]


def imu() -> Imu:
    """A message of a sensor that gives all of it."""
    message = Imu(orientation=Quaternion(0.0, 0.0, 0.0, 1.0))
    message.header.frame_id = "imu_link"
    message.angular_velocity.x = message.linear_acceleration.z = 9.0
    for name in ("orientation", "angular_velocity", "linear_acceleration"):
        setattr(message, f"{name}_covariance", [0.1] * 9)
    return message


def test_imu_says_minus_one_for_what_is_not_given() -> None:
    message = composed(imu(), angular_velocity__z=0.1)
    assert message.header.frame_id == "imu_link"
    assert message.orientation_covariance == (-1.0, *[0.0] * 8)
    assert message.linear_acceleration_covariance == (-1.0, *[0.0] * 8)
    assert diagonal(message.angular_velocity_covariance) == pytest.approx([LARGE, LARGE, 0.01])
    assert norm(message.orientation) == 1.0
    assert (message.angular_velocity.x, message.linear_acceleration.z) == (0.0, 0.0)


def test_an_error_that_is_not_known_is_a_large_variance_and_never_zero() -> None:
    message = composed(imu(), angular_velocity__z=None)
    assert diagonal(message.angular_velocity_covariance) == [LARGE] * 3


@pytest.mark.parametrize("others", Others)
@pytest.mark.parametrize(
    "last", [Quaternion(), Quaternion(0, 0, 3, 4), Quaternion(math.nan, 0, 0, 1)]
)
def test_every_quaternion_is_of_unit_length(last: Quaternion, others: Others) -> None:
    message = composed(Imu(orientation=last), others, angular_velocity__z=None)
    assert norm(message.orientation) == pytest.approx(1.0)
    if others is LAST and last.w == 4:
        assert message.orientation == Quaternion(0.0, 0.0, 0.6, 0.8)


def test_a_fix_without_its_position_is_no_fix() -> None:
    last = NavSatFix(latitude=48.2, longitude=16.3, altitude=170.0)
    last.header.frame_id = "gps"
    last.status.status, last.status.service = 2, 1
    last.position_covariance_type, last.position_covariance = 3, [1.0] * 9
    message = composed(last, altitude=2.0)
    assert (message.status.status, message.status.service) == (-1, 1)
    assert (message.latitude, message.longitude) == (48.2, 16.3)
    assert message.position_covariance_type == NavSatFix.COVARIANCE_TYPE_UNKNOWN
    assert diagonal(message.position_covariance) == [LARGE, LARGE, 4.0]
    message = composed(last, latitude=1e-5, longitude=1e-5)
    assert (message.status.status, message.altitude) == (2, 170.0)
    assert diagonal(message.position_covariance) == [LARGE] * 3
    assert math.isnan(unknown(NavSatFix, latitude=None, longitude=None).altitude)


def test_joints_keep_their_names_and_sizes_and_leave_out_what_is_not_known() -> None:
    last = JointState(name=["left", "right"], position=[1, 2], velocity=[3, 4], effort=[5, 6])
    message = composed(last, **{"velocity[1]": None})
    assert (message.name, message.position, message.effort) == (["left", "right"], (), ())
    assert len(message.velocity) == 2 and math.isnan(message.velocity[0])
    message = composed(last, **{"velocity[name=left]": None})
    assert len(message.velocity) == 2
    assert composed(last, ZERO, **{"velocity[1]": None}).position == (0.0, 0.0)


def test_a_battery_says_nan_where_its_documentation_does() -> None:
    last = BatteryState(voltage=12.0, temperature=20.0, current=-1.0, charge=5.0, capacity=7.0)
    last.design_capacity, last.cell_voltage, last.location = 8.0, [4.0] * 3, "left"
    last.power_supply_technology, last.present = 2, True
    last.power_supply_status, last.power_supply_health = 2, 1
    last.header.frame_id = "battery"
    message = composed(last, percentage=None)
    for name in ("voltage", "temperature", "current", "charge"):
        assert math.isnan(getattr(message, name)), name
    assert (message.capacity, message.design_capacity) == (7.0, 8.0)
    assert (message.power_supply_status, message.power_supply_health) == (0, 0)
    assert composed(last, power_supply_status=None).power_supply_status == 2
    assert len(message.cell_voltage) == 3 and all(map(math.isnan, message.cell_voltage))
    assert (message.location, message.power_supply_technology, message.present) == ("left", 2, True)
    assert math.isnan(unknown(BatteryState, percentage=None).voltage)


SAYS_UNKNOWN = [
    (BatteryState, "voltage", "voltage"),
    (BatteryState, "cell_voltage[1]", "cell_voltage[1]"),
    (BatteryState, "power_supply_status", "power_supply_status"),
    (BatteryState, "capacity", ""),
    (Imu, "angular_velocity.z", "angular_velocity"),
    (Imu, "yaw(orientation)", "orientation"),
    (Imu, "orientation_covariance[0]", ""),
    (Odometry, "twist.twist.linear.x", ""),
    (Odometry, "yaw(pose.pose.orientation)", ""),
    (NavSatFix, "latitude", ""),
    (JointState, "velocity[name=left]", "velocity[name=left]"),
    (MagneticField, "magnetic_field.x", "magnetic_field.x"),
    (LaserScan, "ranges[0]", "ranges[0]"),
    (LaserScan, "range_max", ""),
    (Temperature, "variance", ""),
    (Joy, "axes[0]", ""),
    (Float64Stamped, "data", "data"),
    (Float64Stamped, "header.seq", ""),
    (Int32, "data", ""),
]


@pytest.mark.parametrize("kind, field, unknown_with", SAYS_UNKNOWN)
def test_a_value_is_marked_whose_message_can_say_that_it_is_unknown(
    kind: Type[genpy.Message], field: str, unknown_with: str
) -> None:
    provision = Provision("a", field)
    som = Som([Service("a", "/a", kind._type, "/n", 0.1, (provision,))])
    (marked,) = with_unknowns(som, message_types.layout).sources
    assert marked.provision == provision
    assert marked.provision.unknown_with == unknown_with


def test_a_type_that_is_not_built_says_nothing() -> None:
    som = Som([Service("a", "/a", "no/No", "/n", 0.1, (Provision("a", "data"),))])
    (source,) = with_unknowns(som, message_types.layout).sources
    assert source.provision.unknown_with == ""


def test_distances_are_nan_and_what_the_device_is_stays() -> None:
    last = LaserScan(angle_min=-1.0, angle_increment=0.1, range_max=30.0, ranges=[1.0, math.inf])
    last.intensities = [1.0, 2.0]
    message = composed(last, **{"ranges[0]": None})
    assert (message.angle_min, message.range_max) == pytest.approx((-1.0, 30.0))
    assert message.intensities == () and len(message.ranges) == 2
    assert math.isnan(message.ranges[1])
    message = composed(Range(radiation_type=1, field_of_view=0.5, max_range=4.0, range=2.0))
    assert (message.radiation_type, message.max_range) == (1, 4.0)
    assert math.isnan(message.range)


@pytest.mark.parametrize(
    "kind, name",
    [
        (Temperature, "temperature"),
        (FluidPressure, "fluid_pressure"),
        (Illuminance, "illuminance"),
        (RelativeHumidity, "relative_humidity"),
    ],
)
def test_a_variance_of_zero_is_unknown_where_the_type_says_so(
    kind: Type[genpy.Message], name: str
) -> None:
    assert composed(kind(variance=0.5), **{name: 3.0}).variance == 9.0
    assert composed(kind(variance=0.5), **{name: None}).variance == 0.0


def test_a_magnetic_field_has_nan_for_its_other_axes() -> None:
    last = MagneticField(magnetic_field_covariance=[0.1] * 9)
    message = composed(last, magnetic_field__x=2.0)
    assert math.isnan(message.magnetic_field.y)
    assert diagonal(message.magnetic_field_covariance) == [4.0, 0.0, 0.0]


def test_what_commands_is_zero_and_not_held() -> None:
    last = Twist()
    last.linear.x, last.angular.z = 0.5, 1.0
    assert composed(last, linear__x=None).angular.z == 0.0
    assert composed(last, LAST, linear__x=None).angular.z == 1.0
    joy = composed(Joy(axes=[1.0, -1.0], buttons=[0, 1]))
    assert (joy.axes, joy.buttons) == ((0.0, 0.0), (0, 0))
    accel = AccelStamped()
    accel.accel.linear.z, accel.header.frame_id = 9.8, "base_link"
    message = composed(accel, accel__linear__x=None)
    assert (message.accel.linear.z, message.header.frame_id) == (0.0, "base_link")


def test_a_transform_and_a_calibration_stay() -> None:
    last = TransformStamped(child_frame_id="base_link")
    last.transform.translation.x = 3.0
    message = composed(last)
    assert (message.transform.translation.x, message.transform.rotation.w) == (3.0, 1.0)
    assert composed(CameraInfo(K=[2.0] * 9)).K == (2.0,) * 9


def test_other_types_are_nan_where_nobody_knows() -> None:
    assert math.isnan(composed(Float64(1.0)).data)
    assert composed(Int32(3)).data == 3
    assert composed(String("left")).data == "left"
    assert composed(Float64(1.0), ZERO).data == 0.0
    stamped = Float64Stamped(data=2.0)
    stamped.header.frame_id = "battery"
    message = composed(stamped, data=0.1)
    assert message.header.frame_id == "battery" and message.variance == pytest.approx(0.01)
    assert math.isnan(composed(stamped, data=None).variance)


def test_last_is_all_as_it_was() -> None:
    message = composed(odometry(), LAST, twist__twist__linear__x=0.1)
    expected = odometry()
    expected.pose.covariance = tuple(expected.pose.covariance)
    expected.twist.covariance = tuple(expected.twist.covariance)
    assert message == expected


def test_zero_is_zero_but_covariances_are_unknown_and_settings_stay() -> None:
    message = composed(odometry(), ZERO, twist__twist__linear__x=None)
    assert (message.pose.pose.position.x, message.pose.pose.orientation.w) == (0.0, 1.0)
    assert (message.header.frame_id, diagonal(message.pose.covariance)) == ("odom", [LARGE] * 6)
    scan = composed(LaserScan(range_max=30.0, ranges=[1.0]), ZERO)
    assert (scan.range_max, scan.ranges) == (30.0, (0.0,))


def test_a_message_that_is_none_of_the_type_is_refused() -> None:
    good = data_of(odometry())
    assert read_message(Odometry, good).child_frame_id == "base_link"
    for bad in (good[:-1], good + b"\0", b"", b"\xff" * len(good), data_of(imu())):
        with pytest.raises(ShsaError, match="bytes are no nav_msgs/Odometry"):
            read_message(Odometry, bad)


def test_every_entry_of_the_table_names_fields_that_its_type_has() -> None:
    for name, convention in CONVENTIONS.items():
        kind = genpy.message.get_message_class(name)
        if kind is None:
            continue  # its package is not here
        slots: Dict[str, str] = dict(zip(kind.__slots__, kind._slot_types))
        assert set(convention.fields) <= set(slots), name
        for covariance in convention.covariances:
            size = len(covariance.rows)
            entries = "float64" if size == 1 else f"float64[{size * size}]"
            assert slots[covariance.field] == entries, name
            assert all(not row or row.split(".")[0] in slots for row in covariance.rows), name
        for flag in convention.flags:
            assert flag.field.split(".")[0] in slots and set(flag.unless) <= set(slots), name


def test_every_type_of_the_table_is_described() -> None:
    page = pathlib.Path(__file__).resolve().parents[4] / "docs" / "reference" / "ros.md"
    text = page.read_text("utf-8")
    assert [name for name in CONVENTIONS if name not in text] == []
