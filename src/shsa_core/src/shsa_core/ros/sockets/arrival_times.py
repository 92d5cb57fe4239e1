"""Tells when messages had come that are read later: the kernel notes it (`man 7 socket`).

So who is in no hurry for them need not wake for each.
"""
import socket
import struct
import time
from typing import Callable, Iterable, NamedTuple, Tuple

from shsa_core.ros import clock

SO_TIMESTAMPNS = 35  # of Linux; Python has no name for it
_TIMESPEC = struct.Struct("ll")
SPACE = socket.CMSG_SPACE(_TIMESPEC.size)
"""Bytes of what the kernel adds to what is read."""


def enable(connected: socket.socket) -> None:
    """Have the kernel note from now on when data comes."""
    connected.setsockopt(socket.SOL_SOCKET, SO_TIMESTAMPNS, 1)


def noted_in(extra: Iterable[Tuple[int, int, bytes]]) -> int:
    """Return when the newest of what was read had come, by the wall clock in ns; 0: not noted."""
    for level, kind, data in extra:
        if (level, kind) == (socket.SOL_SOCKET, SO_TIMESTAMPNS) and len(data) >= _TIMESPEC.size:
            seconds, nanoseconds = _TIMESPEC.unpack_from(data)
            return int(seconds) * 10**9 + int(nanoseconds)
    return 0


class Moment(NamedTuple):
    """One look at all clocks.

    `wall` and `ros_time` in ns; `here`, by the monotonic clock, and `time`, the robot's, in s.
    """

    wall: int
    here: float
    time: float
    ros_time: int


class ArrivalTimes:
    """Tells when something had come between two looks; `now`: the robot's clock.

    Between two looks every clock is taken to go evenly, and after the last one in real time.
    """

    def __init__(self, now: Callable[[], float]) -> None:
        self._now = now
        self.before = self.looked = self._moment()

    def look(self) -> Moment:
        """Look at the clocks, before what has come is read."""
        self.before, self.looked = self.looked, self._moment()
        return self.looked

    def of(self, noted: int, read: float) -> Tuple[float, int]:
        """Return the robot's time in s and ROS time in ns when something had come.

        `noted`: by the kernel; 0: at the last look. It had not come before the look before, nor
        after it was `read`, by the monotonic clock: the wall clock may have been set.
        """
        before, looked = self.before, self.looked
        ago, span = (looked.wall - noted) / 1e9 if noted else 0.0, looked.here - before.here
        if ago < 0.0:
            return self._after(min(-ago, read - looked.here))
        share = min(ago / span, 1.0) if span > 0.0 else 0.0
        time_ = looked.time - share * (looked.time - before.time)
        return time_, looked.ros_time - round(share * (looked.ros_time - before.ros_time))

    def at(self, here: float) -> Tuple[float, int]:
        """Return the same of a moment on the monotonic clock."""
        return self._after(here - self.looked.here)

    def _after(self, since: float) -> Tuple[float, int]:
        since = max(0.0, since)
        return self.looked.time + since, self.looked.ros_time + round(1e9 * since)

    def _moment(self) -> Moment:
        here, ros_time = clock.both()
        return Moment(time.time_ns(), here, self._now(), round(1e9 * ros_time))
