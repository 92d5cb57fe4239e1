"""When messages had come that are read later: the kernel notes it (`man 7 socket`, SO_TIMESTAMP).

So who is in no hurry for them need not wake for each.
"""
import socket
import struct
import time
from typing import Callable, Iterable, NamedTuple, Optional, Tuple

from shsa_core.ros import clock

SO_TIMESTAMPNS = 35
"""Of Linux; Python has no name for it."""
_TIMESPEC = struct.Struct("ll")
SPACE = socket.CMSG_SPACE(_TIMESPEC.size)
"""Of what the kernel adds to what is read."""


def note(connected: socket.socket) -> None:
    """Have the kernel note from now on when data comes."""
    connected.setsockopt(socket.SOL_SOCKET, SO_TIMESTAMPNS, 1)


def noted(extra: Iterable[Tuple[int, int, bytes]]) -> int:
    """When the newest of what was read had come, by the wall clock in ns; 0: nobody noted it."""
    for level, kind, data in extra:
        if (level, kind) == (socket.SOL_SOCKET, SO_TIMESTAMPNS) and len(data) >= _TIMESPEC.size:
            seconds, nanoseconds = _TIMESPEC.unpack_from(data)
            return int(seconds) * 10**9 + int(nanoseconds)
    return 0


class Moment(NamedTuple):
    """`wall` and `ros_time` in ns; `here`, by the monotonic clock, and `time`, robot's, in s."""

    wall: int
    here: float
    time: float
    ros_time: int


class ArrivalTimes:
    """Tells when something had come between two looks; `now`: the robot's clock."""

    def __init__(self, now: Callable[[], float]) -> None:
        self._now = now
        self._before = self._looked = self._moment()

    def look(self) -> float:
        """To be called before what has come is read; the monotonic time in s."""
        self._before, self._looked = self._looked, self._moment()
        return self._looked.here

    def waited(self, time: float) -> float:
        """For how long in s what had come by `time` may have waited: since the look before."""
        return time - self._before.time

    def of(self, noted: int, read: Optional[float] = None) -> Tuple[float, int]:
        """The robot's time in s and ROS time in ns when something had come; 0: at the last look.

        Between two looks every clock is taken to go evenly. What is read now had not come before
        the look before, nor after it was `read`, by the monotonic clock; None: at the last look.
        """
        before, looked = self._before, self._looked
        ago, span = (looked.wall - noted) / 1e9 if noted else 0.0, looked.here - before.here
        if ago < 0.0 and read is not None:
            since = max(0.0, min(-ago, read - looked.here))
            return looked.time + since, looked.ros_time + round(1e9 * since)
        share = min(max(ago / span, 0.0), 1.0) if span > 0.0 else 0.0
        time = looked.time - share * (looked.time - before.time)
        return time, looked.ros_time - round(share * (looked.ros_time - before.ros_time))

    def _moment(self) -> Moment:
        return Moment(time.time_ns(), clock.now(), self._now(), clock.ros_ns())
