"""A standing connection to a publisher: what is read from it, cut into messages, and when it came.

A message is its length in four bytes, and so many bytes. The rest of a large one that is not wanted
is dropped in the kernel (`man 7 tcp`, MSG_TRUNC). When what is read later had come, the kernel
notes (`man 7 socket`): so who is in no hurry need not wake for each.
"""
import socket
import struct
import time
from contextlib import suppress
from typing import Any, Callable, Dict, Iterable, List, NamedTuple, Optional, Tuple

import rospy

from shsa_core.errors import ShsaError
from shsa_core.ros import clock, settings
from shsa_core.ros.messages.fields import Decoder
from shsa_core.ros.rospy_patches.subscribing import LENGTH


class Connection:
    """A connection that rospy has made: `transport`.

    `publisher` is whom it claims to be, and a node's name once it `is_known`, which listens at the
    numeric address `at`. What `wakes` ends the sleep of who reads it, as what `is_large` should.
    """

    def __init__(self, topic: str, transport: Any) -> None:
        """Take a connection over; raises OSError if rospy has closed it meanwhile."""
        connected = transport.socket
        connected.setblocking(False)
        connected.setsockopt(socket.SOL_SOCKET, SO_TIMESTAMPNS, 1)
        self.topic, self.publisher = topic, str(transport.callerid_pub)
        self.transport, self.uri = transport, str(transport.endpoint_id)
        self.header: Dict[str, str] = transport.header
        self.descriptor: int = connected.fileno()
        self.at = ""
        self.is_known = self.is_large = False
        self.wakes = True
        self.frames = Frames()
        self.newest: Optional[bytes] = None  # the last message of who is not known yet
        self.emptied: Optional[Moment] = None  # by then all was read that had come; None: it is
        self.expects = 1
        """Bytes that come before the kernel wakes who waits for it; 1: each does."""
        self.needs: Any = None  # by whoever reads its messages
        self._decodes: Optional[Tuple[str, Tuple[str, ...]]] = None
        self._decoder: Optional[Decoder] = None

    def read(self) -> bool:
        """Read what has come; return False once the connection has ended."""
        connected = self.transport.socket
        if connected is None:
            return False
        with suppress(OSError):
            stands = self.frames.read(connected)
            if self.frames.expected != self.expects:
                self.expects = self.frames.expected
                connected.setsockopt(socket.SOL_SOCKET, socket.SO_RCVLOWAT, self.expects)
            return stands
        return False

    def decoder(self, kind: str, fields: Tuple[str, ...]) -> Optional[Decoder]:
        """Return what reads fields of its messages; None, with a warning, if they are no `kind`."""
        if self._decodes != (kind, fields):
            self._decodes, self._decoder = (kind, fields), None
            try:
                self._decoder = Decoder(kind, self.header, fields)
                problems = self._decoder.problems
            except ShsaError as error:
                problems = [str(error)]
            for problem in problems:
                self.warn(problem)
        return self._decoder

    def warn(self, problem: object) -> None:
        """Say why its messages are not read, now and then."""
        text = f"What {self.publisher} publishes on {self.topic} is not read: {problem}"
        rospy.logwarn_throttle_identical(60.0, text)


_WASTE = bytearray(settings.LARGEST_DROP_B)
"""Memory for a kernel that drops nothing; no page of it is ever touched otherwise."""


class Wanted(NamedTuple):
    """The part of a message to copy: all of one of up to `whole` bytes, else the first `head`."""

    whole: int = settings.LARGEST_MESSAGE_B
    head: int = 0


class Frame(NamedTuple):
    """A message; `whole`: its data is all of it; `noted`: when what was copied had come.

    That is when the newest came of what the kernel keeps together, the oldest after `former`.
    """

    data: bytes
    whole: bool
    noted: int = 0
    former: int = 0


class Frames:
    """Reads messages from a socket that does not block; `wanted` may change at any time."""

    def __init__(self) -> None:
        self.wanted = Wanted()
        self._noted = self._former = self._begun = 0  # the last notes that differ
        self._buffer = bytearray()
        self._found: List[Frame] = []
        self._rest = 0  # bytes of a message that are still to come, and are not wanted
        self._cut: Optional[Frame] = None  # what is told of that message once it has come
        self._large = False  # the last message was one to drop
        self.more = False  # there was more to be read than our share of a turn

    def __len__(self) -> int:
        return len(self._buffer)

    @property
    def expected(self) -> int:
        """Return how many bytes probably come before anybody need look; 1: look at each."""
        dropping = self._large and not self._buffer and not self.more
        return settings.EXPECTED_B if dropping else 1

    def read(self, connected: socket.socket) -> bool:
        """Read a bounded part of what has come; False: the other end has closed. Raises OSError."""
        self.more = False
        for _ in range(settings.READS_A_TURN):
            try:
                if self._rest >= settings.READ_B:
                    size = min(self._rest, settings.LARGEST_DROP_B)
                    count = connected.recv_into(_WASTE, size, socket.MSG_TRUNC)
                    self._passed(count)
                else:
                    short = self._large and not self._buffer
                    size = settings.SHORT_READ_B if short else settings.READ_B
                    data, extra, _, _ = connected.recvmsg(size, SPACE)
                    count = len(data)
                    noted = noted_in(extra) if count else self._noted
                    self._begun = self._former  # it may begin with the rest of what is noted so
                    if noted != self._noted:
                        self._former, self._noted = self._noted, noted
                    self.add(data)
            except BlockingIOError:
                return True
            if not count:
                return False
            if count < size:
                return True
        self.more = True
        return True

    def add(self, data: bytes) -> None:
        """Cut what was read already."""
        self._buffer += data
        buffer, start = self._buffer, 0
        while True:
            if self._rest:
                passed = min(self._rest, len(buffer) - start)
                start += passed
                self._passed(passed)
            if self._rest or len(buffer) < start + LENGTH.size:
                break
            size: int = LENGTH.unpack_from(buffer, start)[0]
            kept = size if size <= self.wanted.whole else min(size, self.wanted.head)
            if size > settings.LARGEST_MESSAGE_B:
                kept = 0
            begin, end = start + LENGTH.size, start + LENGTH.size + kept
            if len(buffer) < end:
                break
            frame = Frame(bytes(buffer[begin:end]), kept == size, self._noted, self._begun)
            start, self._rest = end, size - kept
            self._large = self._rest >= settings.READ_B
            if not self._rest:
                self._found.append(frame)
            self._cut = frame if size <= settings.LARGEST_MESSAGE_B else None
        del buffer[:start]

    def _passed(self, count: int) -> None:
        self._rest -= count
        if not self._rest and self._cut is not None:
            self._found.append(self._cut)

    def take(self) -> List[Frame]:
        """Return the messages that have come completely, each once."""
        found, self._found = self._found, []
        return found


SO_TIMESTAMPNS = 35  # of Linux; Python has no name for it
_TIMESPEC = struct.Struct("ll")
SPACE = socket.CMSG_SPACE(_TIMESPEC.size)
"""Bytes of what the kernel adds to what is read."""


def noted_in(extra: Iterable[Tuple[int, int, bytes]]) -> int:
    """Return when the newest of what was read had come, by the wall clock in ns; 0: not noted."""
    for level, kind, data in extra:
        if (level, kind) == (socket.SOL_SOCKET, SO_TIMESTAMPNS) and len(data) >= _TIMESPEC.size:
            seconds, nanoseconds = _TIMESPEC.unpack_from(data)
            return int(seconds) * 10**9 + int(nanoseconds)
    return 0


class Moment(NamedTuple):
    """One look at all clocks: `here` is monotonic, `time` the robot's, in s; the rest in ns."""

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

    def of(self, noted: int, read: float, before: Moment) -> Tuple[float, int]:
        """Return the robot's time in s and ROS time in ns when something had come.

        `noted`: by the kernel; 0: at the last look. It had not come `before` all was read last, nor
        after it was `read`, by the monotonic clock: the wall clock may have been set.
        """
        looked = self.looked
        ago, span = (looked.wall - noted) / 1e9 if noted else 0.0, looked.here - before.here
        if ago < 0.0:
            return self.at(min(looked.here - ago, read))
        share = min(ago / span, 1.0) if span > 0.0 else 0.0
        time_ = looked.time - share * (looked.time - before.time)
        return time_, looked.ros_time - round(share * (looked.ros_time - before.ros_time))

    def at(self, here: float) -> Tuple[float, int]:
        """Return the same of a moment on the monotonic clock."""
        since = max(0.0, here - self.looked.here)
        return self.looked.time + since, self.looked.ros_time + round(1e9 * since)

    def _moment(self) -> Moment:
        here, ros_time = clock.both()
        return Moment(time.time_ns(), here, self._now(), round(1e9 * ros_time))
