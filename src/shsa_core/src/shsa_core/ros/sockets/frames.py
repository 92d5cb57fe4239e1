"""What comes through a socket, cut into messages; of each only what is wanted is copied.

A message is its length in four bytes, and so many bytes. The rest of a large one that nobody wants
to see is dropped in the kernel (`man 7 tcp`, MSG_TRUNC): it is counted, and never copied.
"""
import socket
import struct
from typing import List, NamedTuple, Optional

from shsa_core.ros.sockets import arrival_times

LARGEST_MESSAGE = 1 << 28
"""Bytes; what is larger is not kept, and its publisher counts as silent."""
CHUNK = 65536
"""Bytes of one read. A smaller rest is copied: that costs less than another read."""
SHORT = 512
"""Bytes of the read after a message that was dropped: the next one is probably as large."""
DROP = 1 << 20
"""Bytes that one read drops at most."""
EXPECTED = 1 << 22
"""Bytes of large messages that come before anybody need look. Linux waits for half of what a socket
may hold at most: of 6 MB, unless it was told so."""
READS_A_TURN = 16
"""A babbling publisher must not keep the others waiting."""
_PREFIX = 4
_WASTE = bytearray(DROP)
"""Where a kernel that drops nothing would write; no page of it is ever touched otherwise."""
_TRUNCATE = socket.MSG_TRUNC


class Wanted(NamedTuple):
    """What is copied of a message: all of one of up to `whole` bytes, else the first `head`."""

    whole: int = LARGEST_MESSAGE
    head: int = 0


class Frame(NamedTuple):
    """A message that has come; `whole`: its data is all of it.

    `noted`: when its last part that was copied had come (`arrival_times`).
    """

    data: bytes
    whole: bool
    noted: int = 0


class Frames:
    """Reads messages from a socket that does not block.

    `wanted` may change at any time. It counts for a message until its head was read; so that of
    one that is under way may come in part although all of it is wanted by then.
    """

    def __init__(self, wanted: Wanted = Wanted()) -> None:
        self.wanted = wanted
        self._noted = 0
        self._buffer = bytearray()
        self._found: List[Frame] = []
        self._rest = 0  # bytes of a message that are still to come, and are not wanted
        self._cut: Optional[Frame] = None  # what is told of that message once it has come
        self._large = False  # the last message was one to drop
        self._more = False  # there was more to be read than our share of a turn

    def __len__(self) -> int:
        return len(self._buffer)

    @property
    def expected(self) -> int:
        """So many bytes come before anybody need look; 1: look at each.

        It may be wrong: a message need not be as large as the one before.
        """
        return EXPECTED if self._large and not self._buffer and not self._more else 1

    def read(self, connected: socket.socket) -> bool:
        """Read what has come, a bounded part of it; False if the other end has closed.

        Raises OSError if the connection is lost.
        """
        self._more = False
        for _ in range(READS_A_TURN):
            try:
                if self._rest >= CHUNK:
                    size = min(self._rest, DROP)
                    count = connected.recv_into(_WASTE, size, _TRUNCATE)
                    self._passed(count)
                else:
                    size = SHORT if self._large and not self._buffer else CHUNK
                    data, extra, _, _ = connected.recvmsg(size, arrival_times.SPACE)
                    count = len(data)
                    self._noted = arrival_times.noted(extra) if count else self._noted
                    self.add(data)
            except BlockingIOError:
                return True
            if not count:
                return False
            if count < size:
                return True
        self._more = True
        return True

    def add(self, data: bytes) -> None:
        """Take what was read already."""
        self._buffer += data
        self._parse()

    def take(self) -> List[Frame]:
        """The messages that have come completely, each once."""
        found, self._found = self._found, []
        return found

    def _passed(self, count: int) -> None:
        """So many bytes of a message that are not wanted have come."""
        self._rest -= count
        if not self._rest and self._cut is not None:
            self._found.append(self._cut)

    def _parse(self) -> None:
        buffer, start = self._buffer, 0
        while True:
            if self._rest:
                passed = min(self._rest, len(buffer) - start)
                start += passed
                self._passed(passed)
            if self._rest or len(buffer) < start + _PREFIX:
                break
            size: int = struct.unpack_from("<I", buffer, start)[0]
            wanted = self.wanted
            kept = size if size <= wanted.whole else min(size, wanted.head)
            if size > LARGEST_MESSAGE:
                kept = 0
            begin, end = start + _PREFIX, start + _PREFIX + kept
            if len(buffer) < end:
                break
            frame = Frame(bytes(buffer[begin:end]), kept == size, self._noted)
            start, self._rest = end, size - kept
            self._large = self._rest >= CHUNK
            if not self._rest:
                self._found.append(frame)
            self._cut = frame if size <= LARGEST_MESSAGE else None
        del buffer[:start]
