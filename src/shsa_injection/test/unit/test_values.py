"""Faulty values are written into messages of all sorts of fields."""
import math
from typing import Any

import pytest
from nav_msgs.msg import Odometry
from sensor_msgs.msg import JointState, LaserScan
from std_msgs.msg import Float64, UInt8

from shsa_injection.inside.values import FaultyValue

JOINTS = JointState(name=["left", "right"], velocity=[1.0, 2.0])
SCAN = LaserScan(ranges=[1.0, 2.0, 3.0, 4.0])
TURNED = Odometry()
TURNED.pose.pose.orientation.w = 1.0


@pytest.mark.parametrize("value", [7.5, math.nan, math.inf, -math.inf])
@pytest.mark.parametrize(
    "message, field",
    [
        (Float64(1.0), "data"),
        (Odometry(), "twist.twist.linear.x"),
        (Odometry(), "pose.covariance[7]"),
        (JOINTS, "velocity[name=right]"),
        (JOINTS, "velocity[0]"),
        (SCAN, "min(ranges[1:3])"),
        (SCAN, "max(ranges)"),
    ],
)
def test_a_number_of_any_kind_is_written(message: Any, field: str, value: float) -> None:
    one = FaultyValue(type(message), field)
    one.set(message, value)
    found = one.get(message)
    assert found == value or (math.isnan(value) and found is not None and math.isnan(found))


def test_an_angle_takes_a_value_and_loses_it_to_nan() -> None:
    yaw = FaultyValue(Odometry, "yaw(pose.pose.orientation)")
    yaw.set(TURNED, 1.5)
    assert yaw.get(TURNED) == pytest.approx(1.5)
    yaw.set(TURNED, math.nan)
    assert math.isnan(TURNED.pose.pose.orientation.x)


def test_other_elements_stay() -> None:
    scan = LaserScan(ranges=[1.0, 2.0, 3.0, 4.0])
    FaultyValue(LaserScan, "min(ranges[1:3])").set(scan, 9.0)
    assert list(scan.ranges) == [1.0, 9.0, 9.0, 4.0]


@pytest.mark.parametrize("value, held", [(300.0, 1), (-4.0, 0), (math.nan, 0), (7.0, 7)])
def test_a_whole_number_takes_what_it_can_hold(value: float, held: int) -> None:
    message = UInt8(3)
    FaultyValue(UInt8, "data").set(message, value)
    assert message.data == held
