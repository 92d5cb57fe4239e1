"""Two clocks: decisions use the monotonic one, messages carry ROS time."""
import threading
import time
from typing import Optional, Tuple

import rospy

from shsa_core.ros import settings

LOOKS = 3
"""At two clocks, of which the quickest counts."""
LEAP = 20.0
"""ROS time that advances so many times faster than ours, and than a turn takes, has been set."""


def now() -> float:
    """Return the monotonic clock in s: it neither jumps nor stalls."""
    return time.monotonic()


def is_simulated() -> bool:
    """Return whether ROS time comes from /clock."""
    return not rospy.rostime.is_wallclock()


def both() -> Tuple[float, float]:
    """Return the monotonic clock and ROS time in s, looked at together."""
    found = []
    for _ in range(LOOKS):
        before, ros = now(), ros_ns() / 1e9
        found.append((now() - before, before, ros))
    _, moment, ros = min(found)
    return moment, ros


def offset(told: rospy.Time = rospy.Time(), sent_here: int = 0) -> float:
    """Return by how many s ROS time is ahead of our monotonic clock, at who sent a message.

    That was `told` by the clock there, and `sent_here` by ours in ns; 0: our ROS time counts.
    """
    if sent_here and not told.is_zero():
        return float(told.to_sec()) - sent_here / 1e9
    moment, ros = both()
    return ros - moment


class RobotClock:
    """The clock by which a robot's nodes publish; from any thread.

    The monotonic one; under simulated time one that goes as /clock does, and never back.
    """

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self._before = both()
        self._now = self._before[0]

    def now(self) -> float:
        """Return its time in s."""
        if not is_simulated():
            return now()
        with self._lock:
            before, self._before = self._before, both()
            ours, theirs = (new - old for new, old in zip(self._before, before))
            leaps = theirs > LEAP * max(ours, settings.TURN_S)
            self._now += ours if leaps else max(0.0, theirs)
            return self._now


def to_stamp(moment: Optional[float], ahead: Optional[float] = None) -> rospy.Time:
    """Return the ROS time of a monotonic moment, `ahead`: the offset; zero for None."""
    if moment is None:
        return rospy.Time()
    return rospy.Time.from_sec(max(0.0, moment + (offset() if ahead is None else ahead)))


def to_moment(stamp: rospy.Time, ahead: float) -> Optional[float]:
    """Return the monotonic moment of a stamp by a clock that is so far ahead; None for zero.

    What is stamped ahead of now would count for good: it has happened by now.
    """
    return None if stamp.is_zero() else min(now(), stamp.to_sec() - ahead)


def ros_ns() -> int:
    """Return ROS time in ns."""
    return int(rospy.Time.now().to_nsec()) if is_simulated() else time.time_ns()
