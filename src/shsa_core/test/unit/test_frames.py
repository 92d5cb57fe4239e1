"""A socket's bytes are cut into messages, and only what is wanted of them is copied."""
import fcntl
import socket
import struct
import termios
import time
from contextlib import closing
from typing import Any, Iterator, List, Sequence, Tuple

import pytest
from hypothesis import given, settings, strategies as st
from plain_sockets import connected, framed

from shsa_core.ros import settings as shell
from shsa_core.ros.settings import READ_B as CHUNK, READS_A_TURN
from shsa_core.ros.sockets import connection
from shsa_core.ros.sockets.connection import Frame, Frames, Wanted
from shsa_testing.waiting import wait_until

MB = 1 << 20
HEAD = Wanted(1000, 12)
Pair = Tuple[socket.socket, socket.socket]


@pytest.fixture(name="pair")
def _pair() -> Iterator[Pair]:
    there, here = connected()
    yield there, here
    there.close()
    here.close()


def reading(wanted: Wanted) -> Frames:
    frames = Frames()
    frames.wanted = wanted
    return frames


def pour(pair: Pair, into: Frames, data: bytes) -> List[Frame]:
    """Send all of the data, and read whenever there is no more room."""
    there, here = pair
    there.setblocking(False)
    found: List[Frame] = []
    view = memoryview(data)
    while view:
        try:
            view = view[there.send(view) :]
        except BlockingIOError:
            assert into.read(here)
            found += into.take()
    there.shutdown(socket.SHUT_WR)
    here.settimeout(5.0)
    while into.read(here):
        found += into.take()
    return found + into.take()


def unread(connected: socket.socket) -> int:
    """The bytes that wait to be read."""
    return int(struct.unpack("i", fcntl.ioctl(connected, termios.FIONREAD, bytes(4)))[0])


class Counting:
    """A socket that counts what is copied."""

    def __init__(self, real: socket.socket) -> None:
        self._real, self.copied, self.reads = real, 0, 0

    def recvmsg(self, size: int, space: int) -> Any:
        data, *more = self._real.recvmsg(size, space)
        self.copied, self.reads = self.copied + len(data), self.reads + 1
        return (data, *more)

    def recv_into(self, *arguments: Any) -> int:
        self.reads += 1
        return self._real.recv_into(*arguments)

    def settimeout(self, seconds: float) -> None:
        self._real.settimeout(seconds)


def payload(size: int) -> bytes:
    return bytes(i % 251 for i in range(min(size, 997))) * (size // 997 + 1)


@pytest.mark.parametrize("size", (0, 1, 11, 12, 13, 999, 1000, 1001, CHUNK, CHUNK + 1017, 3 * MB))
def test_of_a_large_message_only_the_head_is_copied(pair: Pair, size: int) -> None:
    data = payload(size)[:size]
    found = pour(pair, reading(HEAD), framed(data, b"next"))
    cut = Frame(data, True) if size <= 1000 else Frame(data[:12], False)
    assert found == [cut, Frame(b"next", True)]


def test_a_payload_is_dropped_in_the_kernel(pair: Pair) -> None:
    there, here = pair
    counting: Any = Counting(here)
    count = 20
    found = pour((there, counting), reading(HEAD), framed(*[payload(MB)[:MB]] * count))
    assert found == [Frame(payload(12)[:12], False)] * count
    assert counting.copied <= 2 * CHUNK + count * CHUNK / 8


def test_as_before_all_of_every_message_is_copied_unless_told_otherwise(pair: Pair) -> None:
    sent = [payload(size)[:size] for size in (0, 5, 70_000, MB, 3)]
    assert pour(pair, Frames(), framed(*sent)) == [Frame(each, True) for each in sent]


def test_a_message_counts_once_its_last_byte_has_come(pair: Pair) -> None:
    there, here = pair
    reader = reading(Wanted(0, 4))
    here.settimeout(5.0)
    there.sendall(framed(bytes(1000))[:-1])
    assert reader.read(here) and reader.take() == []
    there.sendall(b"\0" + framed(b"x")[:2])
    assert reader.read(here) and reader.take() == [Frame(bytes(4), False)]


def test_what_is_wanted_may_change_in_the_middle_of_a_message(pair: Pair) -> None:
    there, here = pair
    reader = reading(HEAD)
    whole = framed(payload(MB)[:MB])
    there.sendall(whole[:100_000])
    here.settimeout(5.0)
    reader.read(here)
    reader.wanted = Wanted()
    found = pour(pair, reader, whole[100_000:] + whole)
    assert found == [Frame(payload(12)[:12], False), Frame(payload(MB)[:MB], True)]


def test_what_is_wanted_no_more_is_dropped_at_once(pair: Pair) -> None:
    there, here = pair
    reader = Frames()
    whole = framed(payload(MB)[:MB])
    there.sendall(whole[:100_000])
    here.settimeout(5.0)
    reader.read(here)
    reader.wanted = HEAD
    found = pour(pair, reader, whole[100_000:])
    assert found == [Frame(payload(12)[:12], False)] and len(reader) == 0


def test_nobody_need_look_at_each_part_of_large_messages_that_are_dropped(pair: Pair) -> None:
    there, here = pair
    here.settimeout(5.0)
    reader = reading(HEAD)
    assert reader.expected == 1
    whole = framed(payload(MB)[:MB])
    there.sendall(whole[:100_000])
    while reader.expected == 1:
        reader.read(here)
    assert reader.expected == shell.EXPECTED_B
    there.sendall(whole[100_000:])
    while not reader.take():
        reader.read(here)
    assert reader.expected == shell.EXPECTED_B, "the next one is probably as large"
    there.sendall(framed(b"small"))
    while not reader.take():
        reader.read(here)
    assert reader.expected == 1, "what follows is small as well"
    there.sendall(struct.pack("<I", 0xFFFFFFFF) + bytes(100))
    while reader.expected == 1:
        reader.read(here)
    assert reader.expected == shell.EXPECTED_B


def test_large_messages_that_are_read_together_came_one_after_the_other(pair: Pair) -> None:
    there, here = pair
    here.setsockopt(socket.SOL_SOCKET, connection.SO_TIMESTAMPNS, 1)

    def is_noted() -> bool:
        there.sendall(b"x")
        wait_until(lambda: unread(here) == 1, 5.0, "it has come")
        return connection.noted_in(here.recvmsg(1, connection.SPACE)[1]) > 0

    wait_until(is_noted, 10.0, "the kernel, who does so a little later, notes it")
    here.setsockopt(socket.SOL_SOCKET, socket.SO_RCVLOWAT, shell.EXPECTED_B)
    data, moments = framed(payload(MB)[:MB]), [time.time_ns()]
    for number in range(3):  # the kernel takes all of them before anybody reads
        there.sendall(data)
        wait_until(lambda: unread(here) == (number + 1) * len(data), 5.0, "it has come")
        moments.append(time.time_ns())
    reader = reading(HEAD)
    assert reader.read(here)
    found = reader.take()
    assert len(found) == 3
    for frame, before, after in zip(found, moments, moments[1:]):
        assert before <= frame.noted <= after


class Noting:
    """A socket that gives one message at a time, and notes when it came."""

    def __init__(self, *moments: int) -> None:
        self._moments = list(moments)

    def recvmsg(self, size: int, space: int) -> Any:
        if not self._moments:
            raise BlockingIOError
        when = struct.pack("ll", *divmod(self._moments.pop(0), 10**9))
        data = framed(bytes(size - 4))
        return data, [(socket.SOL_SOCKET, connection.SO_TIMESTAMPNS, when)], 0, None


def test_what_was_noted_came_after_what_was_noted_before_the_part_that_it_may_begin_in() -> None:
    noting: Any = Noting(3, 5, 5, 9, 9)
    reader = reading(Wanted())
    assert reader.read(noting) and not reader.more
    assert [each[2:] for each in reader.take()] == [(3, 0), (5, 0), (5, 3), (9, 3), (9, 5)]


def test_a_message_beyond_all_measure_is_not_told_of(pair: Pair, monkeypatch: Any) -> None:
    monkeypatch.setattr(shell, "LARGEST_MESSAGE_B", 2 * MB)
    for wanted in (Wanted(2 * MB), HEAD):
        there, here = connected()
        with closing(there), closing(here):
            data = framed(b"first", bytes(3 * MB), b"last")
            found = pour((there, here), reading(wanted), data)
        assert found == [Frame(b"first", True), Frame(b"last", True)]


class Endless:
    """A publisher that has always more to give."""

    def __init__(self) -> None:
        self.reads = 0

    def recvmsg(self, size: int, space: int) -> Any:
        self.reads += 1
        return (struct.pack("<I", MB) + bytes(size))[:size], [], 0, None

    def recv_into(self, buffer: bytearray, size: int, flags: int) -> int:
        self.reads += 1
        return size


@pytest.mark.parametrize("wanted", (Wanted(), HEAD))
def test_a_babbling_publisher_has_a_bounded_share_of_a_turn(wanted: Wanted) -> None:
    endless: Any = Endless()
    reader = reading(wanted)
    assert reader.read(endless)
    assert endless.reads == READS_A_TURN and len(reader.take()) <= READS_A_TURN
    assert reader.expected == 1, "there is more, whatever its size"


SIZES = st.one_of(
    st.integers(0, 20), st.sampled_from((999, 1000, 1001, CHUNK, CHUNK + 505, 200_000))
)


class Pieces:
    """A stream that comes in pieces of any size."""

    def __init__(self, data: bytes, pieces: Sequence[int]) -> None:
        self._data, self._pieces, self._at = data, pieces, 0
        self._turn = 0

    def recvmsg(self, size: int, space: int) -> Any:
        return self._next(size), [], 0, None

    def _next(self, size: int) -> bytes:
        if self._at == len(self._data):
            return b""
        piece = self._pieces[self._turn % len(self._pieces)]
        self._turn += 1
        data = self._data[self._at : self._at + min(size, piece)]
        self._at += len(data)
        return data

    def recv_into(self, buffer: bytearray, size: int, flags: int) -> int:
        return len(self._next(size))


@settings(max_examples=200, deadline=None)
@given(
    sizes=st.lists(SIZES, max_size=8),
    pieces=st.lists(st.integers(1, 100_000), min_size=1, max_size=8),
    whole=st.sampled_from((0, 10, 1000, CHUNK, shell.LARGEST_MESSAGE_B)),
    head=st.integers(0, 40),
)
def test_the_same_messages_are_counted_whatever_the_pieces(
    sizes: List[int], pieces: List[int], whole: int, head: int
) -> None:
    sent = [payload(size)[:size] for size in sizes]
    cut: Any = Pieces(framed(*sent), pieces)
    reader = reading(Wanted(whole, head))
    while reader.read(cut):
        pass
    found = reader.take()
    assert len(found) == len(sent) and len(reader) == 0
    for frame, data in zip(found, sent):
        all_of_it = len(data) <= max(whole, head)
        assert frame[:2] == (data if all_of_it else data[:head], all_of_it)
