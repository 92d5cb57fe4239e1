"""A subscription of ours that has lost its connection gets another, as nobody else asks for one."""
import struct
import time
from typing import Any, Callable, Iterator, List

import pytest
import rospy
from plain_sockets import NUMBERS, Master, Node
from plain_sockets import _master  # noqa: F401  a fixture
from rospy.impl.registration import get_topic_manager
from rospy.impl.tcpros import get_tcpros_handler
from rospy.impl import tcpros_base
from std_msgs.msg import String

from shsa_core.ros import settings
from shsa_core.ros.rospy_patches.subscribing import subscribe


class Reader:
    """A subscription, and the node whose word it has once heard."""

    def __init__(self) -> None:
        self.topic = f"/table_{next(NUMBERS)}"
        self.heard: List[str] = []
        told = lambda message: self.heard.append(message.data)
        self.subscriber = subscribe(self.topic, String, told, 1000)
        self.impl: Any = get_topic_manager().get_subscriber_impl(self.topic)
        self.node = Node(self.topic)

    def connect(self) -> None:
        """As rospy does when it is told of a publisher."""
        made = get_tcpros_handler().create_transport(self.topic, self.node.uri, self.node.protocol)
        assert made[0] == 1

    def until(self, condition: Callable[[], object]) -> None:
        """Look as rospy does every 0.5 s."""
        end = time.monotonic() + 10.0
        while not condition():
            assert time.monotonic() < end, self.impl._lost
            self.impl.check()
            rospy.rostime.wallsleep(0.01)

    def hear(self, word: str) -> None:
        self.until(lambda: self.node.connections)
        self.node.send(struct.pack("<II", 4 + len(word), len(word)) + word.encode())
        self.until(lambda: word in self.heard)


@pytest.fixture(name="reader")
def _reader(monkeypatch: Any, master: Master) -> Iterator[Reader]:
    monkeypatch.setattr(tcpros_base, "_use_tcp_keepalive", False)
    monkeypatch.setattr(settings, "FIRST_PAUSE_S", 0.05)
    made = Reader()
    yield made
    made.subscriber.unregister()
    made.node.die()


def test_a_connection_that_its_publisher_ends_is_made_anew(reader: Reader) -> None:
    reader.connect()
    for word in ("first", "second", "third"):
        reader.hear(word)
        reader.node.close_connections()
    reader.hear("fourth")
    reader.until(lambda: not reader.impl._lost)


@pytest.mark.parametrize("how", ["drops", "refuses"])
def test_a_connection_that_is_refused_is_asked_for_again(reader: Reader, how: str) -> None:
    """So often that one more try would not do."""
    setattr(reader.node, how, 3)
    reader.connect()
    reader.until(lambda: not getattr(reader.node, how))
    reader.hear("word")
    assert reader.node.asked == 3


def test_who_never_lets_it_stand_is_asked_ever_more_seldom(reader: Reader) -> None:
    reader.node.drops = 1000
    reader.connect()
    reader.until(lambda: reader.node.asked == 4)
    (lost,) = reader.impl._lost.values()
    reader.until(lambda: lost.pauses == 4)
    assert lost.due - time.monotonic() > 8 * settings.FIRST_PAUSE_S


def test_a_publisher_that_is_dead_is_asked_no_more(reader: Reader) -> None:
    reader.connect()
    reader.hear("word")
    reader.node.die()
    reader.until(lambda: reader.impl._lost)
    reader.until(lambda: not reader.impl._lost)


def test_who_is_silent_is_asked_while_the_master_lists_it(
    reader: Reader, master: Master, monkeypatch: Any
) -> None:
    monkeypatch.setattr(settings, "CALL_S", 0.1)
    reader.connect()
    reader.hear("word")
    reader.node.answers = False
    reader.node.close_connections()
    reader.until(lambda: master.asked == 2)
    assert reader.impl._lost
    reader.node.answers = True
    reader.hear("another")


def test_a_subscription_that_we_end_asks_nobody(reader: Reader) -> None:
    reader.connect()
    reader.hear("word")
    reader.subscriber.unregister()
    reader.until(lambda: not reader.impl._lost)
    assert reader.node.asked == 0
