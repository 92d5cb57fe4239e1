"""Two clocks: decisions use the monotonic one, messages carry ROS time."""
import time
from typing import Optional

import rospy


def now() -> float:
    """The monotonic clock in s: it neither jumps nor stalls."""
    return time.monotonic()


def to_stamp(moment: Optional[float]) -> rospy.Time:
    """The ROS time of a monotonic moment; zero for None."""
    if moment is None:
        return rospy.Time()
    return rospy.Time.from_sec(max(0.0, rospy.get_time() - (now() - moment)))


def from_stamp(stamp: rospy.Time) -> Optional[float]:
    """The monotonic moment of a ROS time; None for zero."""
    if stamp.is_zero():
        return None
    return now() - (rospy.get_time() - stamp.to_sec())
