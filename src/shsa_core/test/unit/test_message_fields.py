"""Fields of real message classes: read and written, never the end of whoever does it."""
import io
import math
from dataclasses import replace
from typing import Any

import pytest
from hypothesis import given, strategies as st

genpy = pytest.importorskip("genpy")

from geometry_msgs.msg import Pose, PoseStamped, Quaternion  # noqa: E402
from nav_msgs.msg import Odometry, Path  # noqa: E402
from sensor_msgs.msg import BatteryState, Imu, JointState, LaserScan  # noqa: E402
from std_msgs.msg import Bool, Float32, Float64, Int8, UInt8, UInt8MultiArray, UInt64  # noqa: E402

from shsa_core.errors import ShsaError  # noqa: E402
from shsa_core.model.field import is_distance  # noqa: E402
from shsa_core.model.kinds import Policy  # noqa: E402
from shsa_core.model.service import Provision, Service  # noqa: E402
from shsa_core.model.som import Som  # noqa: E402
from shsa_core.model.field_value import Field, problem  # noqa: E402
from shsa_core.ros.messages.fields import Decoder  # noqa: E402
from shsa_core.analysis.check import mark_unusable  # noqa: E402

NAN = math.nan


def sent(message: Any) -> Any:
    """The message as a consumer gets it."""
    stream = io.BytesIO()
    message.serialize(stream)
    return type(message)().deserialize(stream.getvalue())


def written(message: Any, **values: float) -> Any:
    for text, value in values.items():
        Field(type(message), text).set(message, value)
    return sent(message)


def test_elements_of_arrays_are_read() -> None:
    message = sent(JointState(name=["a", "b"], velocity=[1.0, 2.0]))
    read = lambda text: Field(JointState, text).get(message)
    assert read("velocity[1]") == 2.0
    assert str(read("velocity[2]")) == "nan"
    assert (read("velocity[name=a]"), read("velocity[name=b]")) == (1.0, 2.0)
    assert read("velocity[name=c]") is None  # the message is about others
    assert read("position[name=a]") is None  # it has no positions


def test_reductions_of_a_scan() -> None:
    scan = sent(LaserScan(ranges=[5.0, 2.0, math.inf, NAN, 4.0]))
    read = lambda text: Field(LaserScan, text).get(scan)
    assert (read("min(ranges)"), read("max(ranges[1:])"), read("mean(ranges[0:2])")) == (
        2,
        5 - 1,
        3.5,
    )
    assert (read("count(ranges)"), read("min(ranges[2:4])")) == (3.0, math.inf)
    assert str(read("mean(ranges[100:200])")) == "nan" and read("count(ranges[9:])") == 0.0
    blob = sent(UInt8MultiArray(data=b"\x05\x03"))
    assert Field(UInt8MultiArray, "min(data)").get(blob) == 3.0
    assert Field(UInt8MultiArray, "data[0]").get(blob) == 5.0


def test_a_reduction_cannot_be_written() -> None:
    with pytest.raises(ShsaError, match="min.ranges. is read-only"):
        Field(LaserScan, "min(ranges)").set(LaserScan(ranges=[1.0]), 2.0)
    assert problem("sensor_msgs/LaserScan", "min(ranges)", written=False) == ""
    assert "read-only" in problem("sensor_msgs/LaserScan", "min(ranges)", written=True)


def test_an_element_is_written_where_the_array_is_long_enough() -> None:
    known = sent(JointState(name=["a", "b"], velocity=[1.0, 2.0]))
    assert list(written(known, **{"velocity[1]": 7.0}).velocity) == [1.0, 7.0]
    blob = written(sent(UInt8MultiArray(data=b"\x05\x03")), **{"data[0]": 9.0})
    assert list(blob.data) == [9, 3]


def test_a_fixed_array_is_written_without_a_message_to_begin_with() -> None:
    message = written(Odometry(), **{"pose.covariance[35]": 0.5})
    assert message.pose.covariance[35] == 0.5 and len(message.pose.covariance) == 36
    again = written(message, **{"pose.covariance[0]": 0.25})  # a tuple, once it was received
    assert (again.pose.covariance[0], again.pose.covariance[35]) == (0.25, 0.5)


def test_an_array_that_is_too_short_is_an_error_that_is_handled() -> None:
    message = JointState()
    assert list(written(message, **{"velocity[0]": 1.0}).velocity) == [1.0]
    with pytest.raises(ShsaError, match=r"velocity\[2\]: the array has 1 elements"):
        Field(JointState, "velocity[2]").set(message, 1.0)
    with pytest.raises(ShsaError, match=r"no poses\[0\]"):
        Field(Path, "poses[0].pose.position.x").set(Path(), 1.0)


def test_outputs_by_name_make_one_consistent_message() -> None:
    message = written(
        JointState(),
        **{"velocity[name=left]": 1.0, "velocity[name=right]": 2.0, "position[name=right]": 3.0},
    )
    assert (message.name, message.velocity) == (["left", "right"], (1.0, 2.0))
    assert str(message.position) == str((NAN, 3.0)) and message.effort == ()


def test_an_output_by_name_keeps_what_is_there() -> None:
    known = JointState(name=["a", "b"], velocity=[1.0, 2.0], position=[3.0, 4.0])
    message = written(known, **{"velocity[name=b]": 9.0, "velocity[name=c]": 8.0})
    assert (message.name, message.velocity) == (["a", "b", "c"], (1.0, 9.0, 8.0))
    assert str(message.position) == str((3.0, 4.0, NAN)) and message.effort == ()


def test_yaw_is_written_and_roll_and_pitch_stay() -> None:
    pose = PoseStamped()
    for name, value in (("roll", 0.1), ("pitch", -0.2), ("yaw", 0.5), ("yaw", 2.5)):
        Field(PoseStamped, f"{name}(pose.orientation)").set(pose, value)
    message = sent(pose)
    read = lambda name: Field(PoseStamped, f"{name}(pose.orientation)").get(message)
    assert (read("roll"), read("pitch"), read("yaw")) == pytest.approx((0.1, -0.2, 2.5))
    rotation = message.pose.orientation
    assert sum(getattr(rotation, each) ** 2 for each in "xyzw") == pytest.approx(1.0)


@pytest.mark.parametrize(
    "message", [Imu(), Imu(orientation=Quaternion(w=math.nan)), Imu(orientation=Quaternion(w=7))]
)
def test_what_is_no_rotation_counts_as_none_turned(message: Imu) -> None:
    turned = written(message, **{"yaw(orientation)": 0.5}).orientation
    assert (turned.x, turned.y) == (0.0, 0.0)
    assert (turned.z, turned.w) == pytest.approx((math.sin(0.25), math.cos(0.25)))


def test_a_rotation_that_is_none_reads_as_no_number() -> None:
    assert str(Field(Imu, "yaw(orientation)").get(Imu())) == "nan"


@pytest.mark.parametrize(
    "kind, fits, not_",
    [
        (UInt8, (0.0, 254.6), (-0.6, 255.5, 1e300)),
        (Int8, (-128.0, 127.4), (-129.0, 128.0)),
        (UInt64, (2.0**63,), (2.0**64, -1.0)),
        (Bool, (0.0, 1.0, 0.7), (2.0, -1.0)),
        (Float32, (3e38, -3e38), (1e39, math.inf)),
        (Float64, (1e308,), (NAN,)),
    ],
)
def test_a_value_that_does_not_fit_is_refused_and_never_sent(
    kind: Any, fits: tuple, not_: tuple
) -> None:
    field = Field(kind, "data")
    for value in fits:
        message = kind()
        field.set(message, value)
        read = field.get(sent(message))
        assert read == pytest.approx(value if kind in (Float32, Float64) else round(value))
    for value in not_:
        with pytest.raises(ShsaError, match="does not fit"):
            field.set(kind(), value)


def test_enumerations_are_whole_numbers() -> None:
    status = Field(BatteryState, "power_supply_status")
    message = BatteryState()
    status.set(message, BatteryState.POWER_SUPPLY_STATUS_FULL)
    assert status.get(sent(message)) == 4.0
    assert Field(BatteryState, "present").get(sent(BatteryState(present=True))) == 1.0


@given(st.floats(), st.sampled_from(["velocity[0]", "velocity[3]", "velocity[name=x]"]))
def test_whatever_is_written_can_be_sent_or_is_refused(value: float, text: str) -> None:
    message = JointState()
    try:
        Field(JointState, text).set(message, value)
    except ShsaError:
        return
    sent(message)


@pytest.mark.parametrize(
    "kind, text, words",
    [
        (Odometry, "latitud", "nav_msgs/Odometry has no field latitud: latitud is not one of"),
        (Odometry, "twist.twist.linaer.x", "did you mean linear?"),
        (Odometry, "header.frame_id", "is a string, not a number"),
        (Odometry, "header.stamp", "is a time, not a number"),
        (Odometry, "header.stamp.secs", "a time has no fields"),
        (Odometry, "pose", "is a geometry_msgs/PoseWithCovariance, not a number"),
        (Odometry, "pose.covariance", "its first element is covariance[0]"),
        (Odometry, "pose.covariance[36]", "whose last place is 35"),
        (Odometry, "min(pose.covariance[30:40])", "whose last place is 35"),
        (Odometry, "twist[0]", "is not an array"),
        (Odometry, "min(twist.twist.linear.x)", "is not an array"),
        (Odometry, "yaw(pose.pose.position)", "is of a quaternion"),
        (Odometry, "yaw(twist.twist.linear.x)", "is of a quaternion"),
        (JointState, "velocity[names=a]", "needs an array of texts names"),
        (JointState, "min(name)", "is a string, not a number"),
    ],
)
def test_what_a_type_does_not_have_is_refused(kind: Any, text: str, words: str) -> None:
    with pytest.raises(ShsaError) as refusal:
        Field(kind, text)
    assert words in str(refusal.value)


def test_the_fields_of_rep_117_are_there() -> None:
    for kind, text in (("LaserScan", "ranges[0]"), ("Range", "range")):
        assert is_distance(f"sensor_msgs/{kind}", text)
        assert problem(f"sensor_msgs/{kind}", text, written=True) == ""
    assert Field(Pose, "yaw(orientation)").writable


def test_what_a_som_has_that_is_not_built_here_is_marked_and_named() -> None:
    strange, fine = Provision("a", "data"), Provision("b", "min(ranges)")
    scan = Service("scan", "/scan", "sensor_msgs/LaserScan", "/l", 0.1, (fine,), needed=True)
    services = [
        Service("strange", "/strange", "nowhere_msgs/Thing", "/s", 0.1, (strange,)),
        Service("needed", "/needed", "nowhere_msgs/Thing", "/n", 0.1, (strange,), needed=True),
        scan,
        replace(scan, name="restarted", policy=Policy.RESTART),
        Service("odom", "/odom", "nav_msgs/Odometry", "/d", 0.1, (Provision("c", "x"),)),
        Service("ok", "/ok", "std_msgs/Float64", "/o", 0.1, (Provision("d", "data"),), needed=True),
    ]
    marked, problems = mark_unusable(Som(services))
    assert [[source.property for source in service.readable] for service in marked] == [
        [],
        [],
        ["b"],
        ["b"],
        [],
        ["d"],
    ]
    assert [bool(service.unwritable) for service in marked] == [True] * 5 + [False]
    assert marked.services["ok"] == services[-1]
    assert [each.text.split(":")[0] for each in problems] == [
        "strange",
        "needed",
        "needed is needed, and cannot be substituted",
        "scan is needed, and cannot be substituted",
        "odom",
    ]


def test_fields_that_cannot_be_read_have_no_value_and_the_others_are_read() -> None:
    stream = io.BytesIO()
    JointState(name=["a"], velocity=[2.0]).serialize(stream)
    header = {"type": "sensor_msgs/JointState", "md5sum": JointState._md5sum}
    decoder = Decoder(
        "sensor_msgs/JointState", header, ["velocity[0]", "speed", "velocity[name=b]"]
    )
    assert decoder.values(stream.getvalue()) == (2.0, None, None)
    (said,) = decoder.problems
    assert "sensor_msgs/JointState has no field speed" in said
