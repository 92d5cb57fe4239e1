"""Messages of a table are taken on top of others: in order, once, of one sender.

And what a publisher sends to whom.
"""
import io
import socket
import threading
from typing import Any, Callable, List, Tuple

import pytest
import rospy
from rospy.impl.registration import get_registration_listeners, get_topic_manager
from rospy.impl.tcpros_base import TCPROSTransport
from rospy.impl.tcpros_pubsub import QueuedConnection, TCPROSPub
from shsa_msgs.msg import Health, Substitution, Substitutions

from shsa_core.ros import settings
from shsa_core.ros.messages import tables
from shsa_core.ros.messages.tables import TablePublisher, TableSubscriber
from shsa_core.ros.wire.rows import own_rows
from shsa_testing.waiting import wait_until


class Trusting:
    """Signing of which everything is right."""

    def checked(self, topic: str, kind: Any) -> Any:
        return kind

    def subscribe(
        self, topic: str, kind: Any, heard: Callable[[Any], None], lost: Callable[[], None]
    ) -> None:
        """Nobody is connected."""


class Checked(Health):  # type: ignore[misc]
    """A message that is not refused."""

    sent_here = 0


class Bench:
    def __init__(self, signed: bool = True) -> None:
        self.heard: List[Tuple[int, int, bool]] = []
        signing: Any = Trusting() if signed else None
        self.subscriber = TableSubscriber("health", Health, self.note, signing)

    def note(self, message: Health) -> None:
        self.heard.append((message.began, message.sequence, message.whole))

    def send(self, began: int, sequence: int, whole: bool, sent: int = 0, ahead: int = 0) -> bool:
        """Return whether a message is heard. `ahead`: of our clock is its computer's by so much."""
        before = len(self.heard)
        boot = bytes([ahead % 256] * 16)
        message = Checked(began=began, sequence=sequence, whole=whole, sent=sent + ahead, boot=boot)
        message.sent_here = sent
        self.subscriber._received(message)
        return len(self.heard) > before

    @property
    def asks_again(self) -> bool:
        return self.subscriber._retry is not None


@pytest.fixture(autouse=True)
def _alone(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(tables, "subscribe", lambda *_: None)
    monkeypatch.setattr(settings, "FIRST_PAUSE_S", 3600.0)


def test_the_whole_and_then_each_change_once() -> None:
    bench = Bench()
    assert not bench.send(1, 4, False, 10) and bench.asks_again
    assert bench.send(1, 5, True, 11)
    assert bench.send(1, 6, False, 12)
    assert bench.send(1, 7, False, 13)


def test_what_comes_by_a_second_connection_changes_nothing() -> None:
    bench = Bench()
    assert bench.send(1, 5, True, 10) and bench.send(1, 6, False, 11)
    assert not bench.send(1, 6, False, 11)
    assert bench.send(1, 6, True, 12), "who connects twice gets the whole twice"
    assert not bench.send(1, 6, False, 11)
    assert bench.send(1, 7, False, 13) and not bench.asks_again


def test_a_whole_that_was_kept_back_is_not_taken() -> None:
    """Somebody who had it sent to himself may bring it to others later."""
    bench = Bench()
    assert bench.send(1, 5, True, 10) and bench.send(1, 6, False, 12)
    assert not bench.send(1, 5, True, 11) and not bench.asks_again
    assert not bench.send(1, 9, False, 20) and bench.asks_again, "two were missed"
    assert not bench.send(1, 6, True, 13)
    assert bench.send(1, 9, True, 21)


def test_a_sender_that_was_started_again_replaces_the_former_one() -> None:
    bench = Bench()
    assert bench.send(100, 5, True, 110) and bench.send(100, 6, False, 120)
    assert bench.send(200, 0, True, 210) and bench.send(200, 1, False, 220)
    assert not bench.send(100, 7, False, 130) and not bench.asks_again


def test_of_two_senders_the_one_counts_that_still_sends() -> None:
    bench = Bench()
    assert bench.send(100, 5, True, 110)
    assert bench.send(200, 0, True, 210)
    assert not bench.send(100, 6, False, 220) and bench.asks_again
    assert bench.send(100, 6, True, 221) and bench.send(100, 7, False, 222)


def test_of_two_computers_the_table_counts_that_was_sent_last_by_our_clock() -> None:
    bench = Bench()
    assert bench.send(5, 3, True, 100, ahead=9999) and bench.send(5, 4, False, 110, ahead=9999)
    assert bench.send(7, 0, True, 120, ahead=0), "its clock alone is behind"
    assert not bench.send(5, 4, True, 115, ahead=9999), "it was kept back"
    assert bench.send(7, 1, False, 130, ahead=0)


def test_a_whole_that_may_have_been_right_is_asked_for_again() -> None:
    bench = Bench()
    bench.subscriber._lost()
    assert bench.asks_again
    bench = Bench()
    assert bench.send(1, 5, True, 10)
    bench.subscriber._lost()
    assert not bench.asks_again, "nothing is missing"


def test_for_show_whoever_sends_the_whole_is_believed_after_a_reboot_too() -> None:
    bench = Bench(signed=False)
    assert bench.send(10**15, 5, True) and bench.send(10**15, 6, False)
    assert not bench.send(10**15, 6, False) and not bench.asks_again
    assert bench.send(10**9, 0, True) and bench.send(10**9, 1, False)


def test_a_whole_that_is_asked_for_is_awaited_before_anything_else_counts() -> None:
    bench = Bench()
    assert bench.send(7, 1, whole=True, sent=1)
    bench.subscriber.ask_again()
    assert not bench.send(7, 2, whole=False, sent=2)
    assert bench.send(7, 2, whole=True, sent=3) and bench.send(7, 3, whole=False, sent=4)


def test_what_is_addressed_to_another_is_not_heard() -> None:
    """It would say by its silence that we have no row."""
    heard: List[int] = []
    trusting: Any = Trusting()
    subscriber = TableSubscriber(
        "table", Substitutions, lambda each: heard.append(each.sequence), trusting, "/mine"
    )
    for number, to in enumerate(("/mine", "/other", "/mine", "")):
        message = Addressed(began=1, sequence=number, whole=True, sent=10 + number, to=to)
        message.sent_here = 10 + number
        subscriber._received(message)
    assert heard == [0, 2, 3]


class Addressed(Substitutions):  # type: ignore[misc]
    """A table that is not refused."""

    sent_here = 0


class Connection:
    """One subscriber's, and what it was sent."""

    def __init__(self, name: str) -> None:
        self.endpoint_id, self.done = name, False
        self.sent: List[bytes] = []

    @property
    def read(self) -> List[Substitutions]:
        return [Substitutions().deserialize(data) for data in self.sent]


class Impl:
    """A publisher as rospy has it."""

    def __init__(self) -> None:
        self.connections: List[Connection] = []

    def acquire(self) -> None:
        """Nobody else publishes."""

    def release(self) -> None:
        """Nobody waits."""

    def publish(self, message: Any, connection_override: Connection) -> None:
        data = io.BytesIO()
        message.serialize(data)
        connection_override.sent.append(data.getvalue())


class Robot:
    """A table with so many rows, and each row's substitute."""

    def __init__(self, monkeypatch: pytest.MonkeyPatch, count: int) -> None:
        impl = Impl()
        self._up = impl.connections
        publisher = type("Publisher", (), {"impl": impl})()
        monkeypatch.setattr(tables, "advertise", lambda *_: publisher)
        monkeypatch.setattr(tables.rospy.Time, "now", staticmethod(rospy.Time))
        self.table = TablePublisher(
            "table",
            Substitutions,
            "substitutions",
            lambda row: row.node or row.service,
            concerning=own_rows("/substitute_"),
        )
        self.names = [f"/substitute_a_{number:04}" for number in range(count)]
        self.rows = [Substitution(node=name, service="s", code="y=1") for name in self.names]
        self.table.update(self.rows)
        self.substitutes = [self.connect(name) for name in self.names]

    def connect(self, name: str) -> Connection:
        connection = Connection(name)
        self._up.append(connection)
        self.table.peer_subscribe("table", None, lambda _: None)
        return connection

    def change_all(self) -> None:
        for row in self.rows:
            row.publishing = True
            self.table.update([row])
        self.table.update([], self.names[:1])


def test_what_a_substitute_is_sent_does_not_grow_with_the_robot(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    sizes = []
    for count in (3, 300):
        robot = Robot(monkeypatch, count)
        robot.change_all()
        first, second = (each.read for each in robot.substitutes[:2])
        assert [(each.sequence, each.whole, each.to) for each in second] == [
            (0, True, robot.names[1]),
            (1, False, robot.names[1]),
        ]
        assert [row.node for each in second for row in each.substitutions] == 2 * [robot.names[1]]
        assert first[-1].removed == [robot.names[0]] and first[-1].sequence == 2
        sizes.append(sum(len(data) for data in robot.substitutes[1].sent))
    assert sizes[0] == sizes[1]


def test_everybody_else_is_sent_the_whole_and_every_change(monkeypatch: pytest.MonkeyPatch) -> None:
    robot = Robot(monkeypatch, 4)
    person = robot.connect("/rostopic_1")
    robot.change_all()
    assert len(person.read[0].substitutions) == 4 and person.read[0].whole
    assert [each.sequence for each in person.read] == list(range(1, 7))
    assert {each.to for each in person.read} == {""}


def test_who_is_connected_twice_is_sent_the_same_bytes(monkeypatch: pytest.MonkeyPatch) -> None:
    robot = Robot(monkeypatch, 2)
    second = robot.connect(robot.names[0])
    robot.rows[0].publishing = True
    robot.table.update(robot.rows[:1])
    assert second.sent[-1] == robot.substitutes[0].sent[-1]


def test_who_comes_back_begins_anew(monkeypatch: pytest.MonkeyPatch) -> None:
    """So no change that was kept back can ever follow on what he hears now."""
    robot = Robot(monkeypatch, 2)
    robot.substitutes[0].done = True
    again = robot.connect(robot.names[0])
    assert again.read[0].whole and again.read[0].began > robot.substitutes[0].read[0].began


def test_who_connects_while_a_table_is_registered_is_sent_the_whole(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """The master tells subscribers of us before it answers us; rospy's listeners miss them."""
    ours, theirs = socket.socketpair()
    early = TCPROSTransport(TCPROSPub("/early", Substitutions), "/early")
    early.set_socket(ours, "/reconfigurator")
    threads: List[threading.Thread] = []

    def meanwhile(name: str, *_: object) -> None:
        impl = get_topic_manager().get_publisher_impl(name)
        threads.append(threading.Thread(target=impl.add_connection, args=(early,)))
        threads[0].start()
        wait_until(lambda: impl.connections, 5.0, "it has connected")

    monkeypatch.setattr(get_registration_listeners(), "notify_added", meanwhile)
    monkeypatch.setattr(tables.rospy.Time, "now", staticmethod(rospy.Time))
    table = TablePublisher("/early", Substitutions, "substitutions", lambda row: str(row.node))
    try:
        theirs.settimeout(5.0)
        assert Substitutions().deserialize(theirs.recv(1000)[4:]).whole
        assert isinstance(table._publisher.impl.connections[0], QueuedConnection)
        threads[0].join()
    finally:
        table._publisher.unregister()
        theirs.close()
