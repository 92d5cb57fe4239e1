"""Times of arrival, by the kernel's note and the clocks of the robot."""
import socket
import time
from typing import Iterator, List, Tuple

import pytest
import rospy
from plain_sockets import Monitor, Node, connected, framed
from plain_sockets import _master, _monitor, _node  # noqa: F401  fixtures

from shsa_core.ros import clock, settings
from shsa_core.ros.sockets import connection
from shsa_core.ros.sockets.connection import SPACE, ArrivalTimes, Moment, noted_in
from shsa_core.ros.sockets.subscriptions import Arrived
from shsa_testing.waiting import wait_until

S = 10**9
Pair = Tuple[socket.socket, socket.socket]


@pytest.fixture
def pair() -> Iterator[Pair]:
    there, here = connected()
    here.setblocking(True)
    with there, here:
        yield there, here


def is_noted(pair: Pair) -> bool:
    """Return whether the kernel notes when something comes."""
    there, here = pair
    there.send(b"?")
    return noted_in(here.recvmsg(1, SPACE)[1]) > 0


class Clocks:
    """Clocks that a test sets."""

    def __init__(self, monkeypatch: pytest.MonkeyPatch) -> None:
        self.moments: List[Moment] = [Moment(100 * S, 10.0, 5.0, 50 * S)]
        monkeypatch.setattr(ArrivalTimes, "_moment", lambda _: self.moments.pop(0))
        self.times = ArrivalTimes(lambda: 0.0)

    def look(self, wall: int, here: float, robots: float, ros_time: int) -> ArrivalTimes:
        self.moments.append(Moment(wall, here, robots, ros_time))
        self.times.look()
        return self.times


@pytest.fixture
def clocks(monkeypatch: pytest.MonkeyPatch) -> Clocks:
    return Clocks(monkeypatch)


def test_the_kernel_tells_when_something_came_however_late_it_is_read(pair: Pair) -> None:
    there, here = pair
    here.setsockopt(socket.SOL_SOCKET, connection.SO_TIMESTAMPNS, 1)
    wait_until(lambda: is_noted(pair), 10.0, "the kernel, who does so a little later, notes it")
    rospy.rostime.set_rostime_initialized(True)
    times = ArrivalTimes(time.monotonic)
    before = time.monotonic()
    there.send(b"x")
    after = time.monotonic()
    time.sleep(0.2)
    data, extra, _, _ = here.recvmsg(10, SPACE)
    times.look()
    came, ros_time = times.of(noted_in(extra), time.monotonic(), times.before)
    assert data == b"x" and before - 0.01 < came < after + 0.1
    assert 0.05 * S < rospy.Time.now().to_nsec() - ros_time < 10 * S


def test_what_nobody_noted_came_when_it_was_looked(clocks: Clocks) -> None:
    assert noted_in([]) == 0 == noted_in([(1, 2, b"")])
    assert noted_in([(socket.SOL_SOCKET, connection.SO_TIMESTAMPNS, b"short")]) == 0
    times = clocks.look(101 * S, 11.0, 6.0, 51 * S)
    assert times.of(0, 11.0, times.before) == (6.0, 51 * S)


@pytest.mark.parametrize(
    "ago, share", [(0.0, 0.0), (0.25, 0.25), (1.0, 1.0), (7.0, 1.0), (-3.0, 0.0)]
)
def test_it_came_between_two_looks(clocks: Clocks, ago: float, share: float) -> None:
    """Whatever the wall clock says: it may have been set."""
    times = clocks.look(101 * S, 11.0, 6.0, 51 * S)
    came, ros_time = times.of(101 * S - int(ago * S), 11.0, times.before)
    assert came == pytest.approx(6.0 - share)
    assert ros_time == 51 * S - int(share * S)


@pytest.mark.parametrize("since, found", [(0.25, 0.25), (0.5, 0.5), (7.0, 0.5)])
def test_what_came_while_it_was_read_came_after_the_look(
    clocks: Clocks, since: float, found: float
) -> None:
    """But not after it was read, whatever the wall clock says."""
    times = clocks.look(101 * S, 11.0, 6.0, 51 * S)
    came, ros_time = times.of(101 * S + int(since * S), 11.5, times.before)
    assert came == pytest.approx(6.0 + found)
    assert ros_time == 51 * S + int(found * S)


def test_simulated_time_goes_evenly_between_two_looks(clocks: Clocks) -> None:
    times = clocks.look(101 * S, 11.0, 5.1, 50 * S + S // 10)
    came, ros_time = times.of(101 * S - S // 2, 11.0, times.before)
    assert came == pytest.approx(5.05)
    assert ros_time == 50 * S + S // 20


def test_two_looks_at_once_tell_of_no_time_between(clocks: Clocks) -> None:
    times = clocks.look(100 * S, 10.0, 5.0, 50 * S)
    assert times.of(99 * S, 10.0, times.before) == (5.0, 50 * S)


def test_what_is_left_for_the_next_turn_came_when_it_did(
    monitor: Monitor, node: Node, monkeypatch: pytest.MonkeyPatch
) -> None:
    monitor.connect(node)
    monkeypatch.setattr(settings, "READS_A_TURN", 1)
    monkeypatch.setattr(settings, "READ_B", 10_000)
    sent: List[Tuple[float, float]] = []
    for _ in range(8):  # no more than has room
        sent.append(clock.both())
        node.send(framed(bytes(6000)))
        time.sleep(0.05)
    came: List[Arrived] = []
    while len(came) < len(sent):
        came += [each for each in monitor.connections.read() if isinstance(each, Arrived)]
    for (before, ros_time), each in zip(sent, came):
        assert each.time - each.waited - 0.01 < before < each.time
        assert each.ros_time / S - each.waited - 0.01 < ros_time < each.ros_time / S
