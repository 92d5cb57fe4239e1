"""Cuts what comes through a socket into messages; of each only what is wanted is copied.

A message is its length in four bytes, and so many bytes. The rest of a large one that nobody wants
to see is dropped in the kernel (`man 7 tcp`, MSG_TRUNC): it is counted, and never copied.
"""
import socket
from typing import List, NamedTuple, Optional

from shsa_core.ros import settings
from shsa_core.ros.rospy_patches.subscribing import LENGTH
from shsa_core.ros.sockets import arrival_times

_WASTE = bytearray(settings.LARGEST_DROP_B)
"""Memory for a kernel that drops nothing; no page of it is ever touched otherwise."""


class Wanted(NamedTuple):
    """The part of a message to copy: all of one of up to `whole` bytes, else the first `head`."""

    whole: int = settings.LARGEST_MESSAGE_B
    head: int = 0


class Frame(NamedTuple):
    """A message that has come; `whole`: its data is all of it.

    `noted`: when its last part that was copied had come, see `arrival_times`.
    """

    data: bytes
    whole: bool
    noted: int = 0


class Frames:
    """Reads messages from a socket that does not block.

    `wanted` may change at any time. It counts for a message until its head was read; so that of
    one that is under way may come in part although all of it is wanted by then.
    """

    def __init__(self) -> None:
        self.wanted = Wanted()
        self._noted = 0
        self._buffer = bytearray()
        self._found: List[Frame] = []
        self._rest = 0  # bytes of a message that are still to come, and are not wanted
        self._cut: Optional[Frame] = None  # what is told of that message once it has come

    def __len__(self) -> int:
        return len(self._buffer)

    def read(self, connected: socket.socket) -> bool:
        """Read what has come, a bounded part of it; False if the other end has closed.

        Raises OSError if the connection is lost.
        """
        for _ in range(settings.READS_A_TURN):
            try:
                if self._rest >= settings.READ_B:
                    size = min(self._rest, settings.LARGEST_DROP_B)
                    count = connected.recv_into(_WASTE, size, socket.MSG_TRUNC)
                    self._passed(count)
                else:
                    size = settings.READ_B
                    data, extra, _, _ = connected.recvmsg(size, arrival_times.SPACE)
                    count = len(data)
                    self._noted = arrival_times.noted_in(extra) if count else self._noted
                    self.add(data)
            except BlockingIOError:
                return True
            if not count:
                return False
            if count < size:
                return True
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
            frame = Frame(bytes(buffer[begin:end]), kept == size, self._noted)
            start, self._rest = end, size - kept
            if not self._rest:
                self._found.append(frame)
            self._cut = frame if size <= settings.LARGEST_MESSAGE_B else None
        del buffer[:start]

    def _passed(self, count: int) -> None:
        """Count bytes of a message that are not wanted."""
        self._rest -= count
        if not self._rest and self._cut is not None:
            self._found.append(self._cut)

    def take(self) -> List[Frame]:
        """Return the messages that have come completely, each once."""
        found, self._found = self._found, []
        return found
