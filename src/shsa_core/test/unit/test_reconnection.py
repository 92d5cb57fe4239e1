"""A lost connection is no failure while its node lives: real sockets, rospy's own connections."""
import os
import struct
import time
from typing import Any, List, Sized, Tuple

import pytest
import rospy
from plain_sockets import HOST, LISTED, Monitor, Node, framed
from plain_sockets import _master, _monitor, _node  # noqa: F401  fixtures

from shsa_core.ros import settings
from shsa_core.ros.sockets.connection import Wanted
from shsa_core.ros.sockets.reconnection import Doubt, Reconnection, refuses
from shsa_core.ros.sockets.subscriptions import Arrived, Tick
from shsa_testing.thorough import LONG
from shsa_testing.waiting import wait_until


def test_a_node_that_died_is_told_at_once(monitor: Monitor, node: Node) -> None:
    monitor.connect(node)
    node.die()
    begun = time.monotonic()
    monitor.until(lambda: bool(monitor.seen))
    assert monitor.kinds() == ["Disconnected"]
    assert time.monotonic() - begun < 0.1 and node.asked == 0


def test_to_look_whether_a_node_is_gone_takes_no_time(node: Node) -> None:
    assert not refuses(node.uri)
    node.die()
    begun = time.monotonic()
    assert all(refuses(node.uri) for _ in range(100))
    assert time.monotonic() - begun < 0.2


def test_one_look_does_for_all_topics_of_a_node(node: Node) -> None:
    reconnection = Reconnection(lambda *_: None)
    begun = time.monotonic()
    assert not any(reconnection.is_gone(node.uri) for _ in range(1000))
    assert time.monotonic() - begun < 0.5
    node.die()
    end = time.monotonic() + 5.0
    while not reconnection.is_gone(node.uri):
        assert time.monotonic() < end


@pytest.mark.parametrize("uri", ["", "nonsense", "http://x:99999999/", "http://[", "http://x"])
def test_a_strange_address_refuses_nothing(uri: str) -> None:
    assert not refuses(uri)


def test_a_node_that_drops_a_connection_is_connected_again(monitor: Monitor, node: Node) -> None:
    monitor.connect(node)
    for _ in range(3):
        node.close_connections()
        monitor.until(lambda: "Connected" in monitor.kinds())
        assert monitor.kinds() == ["Interrupted", "Connected"]
        monitor.seen.clear()
    node.send(struct.pack("<I", 3) + b"abc")
    monitor.until(lambda: monitor.data == [b"abc"])


def test_an_answer_to_an_earlier_question_is_none_to_this_one(monitor: Monitor, node: Node) -> None:
    """A node that drops its connection twice: the first answer may come after the second drop."""
    monitor.connect(node)
    node.answers = False
    node.close_connections()
    monitor.until(lambda: monitor.kinds() == ["Interrupted"])
    reconnection = monitor.connections._reconnection
    (now,) = reconnection._doubts.values()
    before = Doubt(now.topic, now.uri, now.implementation, "/node", now.at, now.until)
    assert reconnection._answered(before, True) == [] and now.waits
    monitor.turn()
    monitor.turn()
    assert monitor.kinds() == ["Interrupted"]


def test_two_connections_of_which_each_end_drops_another(monitor: Monitor, node: Node) -> None:
    """Do as a subscriber that is told twice, and a publisher that sees the second one first."""
    monitor.connect(node)
    implementation = monitor.connections.topics[monitor.topic]
    node.drops = 1
    first = implementation.connections[0]
    monitor.hear_of(node)  # rospy drops the first one, the publisher the second
    monitor.until(lambda: first.done and "Connected" in monitor.kinds())
    assert monitor.kinds() == ["Interrupted", "Connected"]


@pytest.mark.parametrize("how, times", [("drops", 2), ("refuses", 1)])
def test_a_connection_that_never_stood_is_asked_for_again(
    monitor: Monitor, node: Node, how: str, times: int
) -> None:
    """One that refuses has just unregistered the topic, and registers it again."""
    setattr(node, how, times)
    monitor.hear_of(node)
    monitor.until(lambda: "Connected" in monitor.kinds())
    assert monitor.kinds() == ["Connected"] and node.asked == times


def test_a_node_that_never_lets_it_stand_is_asked_a_few_times(monitor: Monitor, node: Node) -> None:
    node.drops = 1000
    monitor.hear_of(node)
    monitor.until(lambda: node.asked == settings.TRIES)
    end = time.monotonic() + 2 * settings.CALL_S
    monitor.until(lambda: time.monotonic() > end)
    assert monitor.seen == [] and node.asked == settings.TRIES


def test_a_node_that_offers_no_topic_any_more_is_gone(monitor: Monitor, node: Node) -> None:
    """As one that shuts down, and listens still."""
    monitor.connect(node)
    node.offers = False
    node.close_connections()
    monitor.until(lambda: "Disconnected" in monitor.kinds())
    assert monitor.kinds() == ["Interrupted", "Disconnected"]
    assert monitor.seen[-1].certain


@pytest.mark.parametrize("returns", [True, False])
def test_a_node_that_lives_has_left_the_topic_that_it_offers_no_more(
    monitor: Monitor, node: Node, monkeypatch: Any, returns: bool
) -> None:
    """As between `unregister` and the next `Publisher` of that topic."""
    monkeypatch.setattr(settings, "FIRST_PAUSE_S", 0.1)
    monitor.connect(node)
    node.offers, node.others = False, [("/rosout", "rosgraph_msgs/Log")]
    begun = time.monotonic()
    node.close_connections()
    monitor.until(lambda: "Disconnected" in monitor.kinds())
    assert time.monotonic() - begun < 0.5 * settings.CALL_S
    asked = node.asked
    monitor.until(lambda: node.asked >= asked + 2)  # it is looked at again
    assert monitor.kinds() == ["Interrupted", "Disconnected"]
    left = monitor.seen[-1]
    assert left.left and not left.certain
    if returns:
        node.offers = True
        monitor.until(lambda: monitor.kinds()[2:] == ["Connected"])
    else:
        node.die()
        monitor.until(lambda: monitor.kinds()[2:] == ["Disconnected"])
        assert monitor.seen[-1].certain
    assert not monitor.connections._reconnection._doubts


def test_a_node_that_says_nothing_is_gone_after_a_while(monitor: Monitor, node: Node) -> None:
    monitor.connect(node)
    node.answers = False
    begun = time.monotonic()
    node.close_connections()
    monitor.until(lambda: "Disconnected" in monitor.kinds())
    assert monitor.kinds() == ["Interrupted", "Disconnected"]
    assert settings.CALL_S <= time.monotonic() - begun < settings.CALL_S + 0.3
    assert not monitor.seen[-1].certain


def test_a_node_that_drops_the_question_is_gone_at_once(
    monitor: Monitor, node: Node, monkeypatch: Any
) -> None:
    """As one that leaves in order: it closes its connections before it stops to listen."""

    def drop(*_: object) -> None:
        raise ConnectionResetError

    monitor.connect(node)
    monkeypatch.setattr("shsa_core.ros.rospy_patches.subscribing.ask", drop)
    begun = time.monotonic()
    node.close_connections()
    monitor.until(lambda: "Disconnected" in monitor.kinds())
    assert monitor.seen[-1].certain and time.monotonic() - begun < 0.5 * settings.CALL_S


def cut_off(monitor: Monitor, node: Node, monkeypatch: Any) -> None:
    """Lose the connection to a node that does not answer; it is asked again every 0.5 s."""
    monkeypatch.setattr(settings, "LONGEST_PAUSE_S", 0.5)
    monitor.connect(node)
    node.answers = False
    node.close_connections()
    monitor.until(lambda: "Disconnected" in monitor.kinds())


def test_a_node_that_was_cut_off_for_long_is_connected_again(
    monitor: Monitor, node: Node, monkeypatch: Any
) -> None:
    """Nobody else asks: rospy does so when the master tells of a publisher, and no more."""
    cut_off(monitor, node, monkeypatch)
    monitor.until(lambda: node.asked > 2)
    assert monitor.kinds() == ["Interrupted", "Disconnected"]
    node.answers = True
    monitor.until(lambda: "Connected" in monitor.kinds())
    assert monitor.kinds() == ["Interrupted", "Disconnected", "Connected"]
    assert not monitor.connections._reconnection._doubts


def test_who_is_silent_for_long_holds_up_nobody_else(
    monitor: Monitor, node: Node, monkeypatch: Any
) -> None:
    """A computer that is off refuses nothing: a look at it takes as long as it may."""
    cut_off(monitor, node, monkeypatch)
    looks: List[str] = []
    look = "shsa_core.ros.sockets.reconnection.refuses"
    monkeypatch.setattr(look, looks.append)
    asked = node.asked
    monitor.until(lambda: node.asked >= asked + 2)
    assert looks == []


def test_who_dies_while_it_is_cut_off_is_gone_for_certain(
    monitor: Monitor, node: Node, monkeypatch: Any
) -> None:
    cut_off(monitor, node, monkeypatch)
    node.die()
    monitor.until(lambda: len(monitor.seen) == 3)
    assert monitor.kinds()[2] == "Disconnected" and monitor.seen[2].certain


def test_who_is_listed_no_more_while_it_is_cut_off_is_gone_for_certain(
    monitor: Monitor, node: Node, monkeypatch: Any
) -> None:
    """As one whose computer was switched off, which refuses nothing."""
    monkeypatch.setattr(settings, "FIRST_PAUSE_S", 0.1)
    cut_off(monitor, node, monkeypatch)
    doubts = monitor.connections._reconnection._doubts
    master = os.environ["ROS_MASTER_URI"]
    monkeypatch.setenv("ROS_MASTER_URI", f"http://{HOST}:1")
    LISTED.clear()
    asked = node.asked
    monitor.until(lambda: node.asked >= asked + 2, 15.0)
    assert doubts, "a master that does not answer says nothing"
    monkeypatch.setenv("ROS_MASTER_URI", master)
    monitor.until(lambda: len(monitor.seen) == 3)
    assert monitor.kinds()[2] == "Disconnected" and monitor.seen[2].certain
    assert not doubts


def test_the_old_process_of_a_node_that_was_started_again_is_missed_by_nobody(
    monitor: Monitor, node: Node
) -> None:
    monitor.connect(node)
    successor = Node(monitor.topic)
    monitor.hear_of(successor)
    standing = monitor.connections._standing
    monitor.until(lambda: monitor.kinds() == ["Connected"])
    node.die()
    monitor.until(lambda: len(standing) == 1)
    assert monitor.kinds() == ["Connected"]
    successor.die()
    monitor.until(lambda: monitor.kinds() == ["Connected", "Disconnected"])


def test_a_topic_that_is_left_while_its_node_is_in_doubt(monitor: Monitor, node: Node) -> None:
    monitor.connect(node)
    node.answers = False
    node.close_connections()
    monitor.until(lambda: monitor.kinds() == ["Interrupted"])
    monitor.connections.unsubscribe(monitor.topic)()
    end = time.monotonic() + 2 * settings.CALL_S
    monitor.until(lambda: time.monotonic() > end)
    assert monitor.kinds() == ["Interrupted"]
    monitor.connections.subscribe(monitor.topic)


def test_the_look_stands_between_what_came_before_and_after_it(
    monitor: Monitor, node: Node, monkeypatch: Any
) -> None:
    """Time passes only as far as all was read."""
    other = Node(monitor.topic, "/other", listed="/other")
    monitor.connect(node)
    monitor.connect(other)
    times = monitor.connections._times
    look = times.look

    def send_while_looking() -> Any:
        node.send(framed(b"before"))
        time.sleep(0.02)
        moment = look()
        other.send(framed(b"after"))
        time.sleep(0.02)
        return moment

    monkeypatch.setattr(times, "look", send_while_looking)

    def is_noted() -> bool:
        """The kernel does so a little after it was asked to."""
        found = monitor.connections.read()
        told = [each.data if isinstance(each, Arrived) else type(each) for each in found]
        assert told == [b"before", Tick, b"after"] or told[-1] is Tick
        return told[-1] is not Tick

    wait_until(is_noted, 10.0, "the kernel notes when something comes")
    other.die()


def test_who_sends_large_messages_that_nobody_judges_seldom_wakes(
    monitor: Monitor, node: Node
) -> None:
    monitor.connect(node)
    large = struct.pack("<I", 1 << 20) + bytes(1 << 20)
    node.send(large)
    monitor.until(lambda: len(monitor.data) == 1)
    (connection,) = monitor.connections._standing.values()
    connection.frames.wanted = Wanted(1000, 12)
    node.send(large)
    monitor.until(lambda: len(monitor.data) == 2)
    assert connection.expects == settings.EXPECTED_B
    node.send(large * 3 + large[:500_000])
    assert not monitor.inbox._waking.poll(0.1), "they wake nobody, nor hold up who sends them"
    node.send(large[500_000:])
    assert monitor.inbox._waking.poll(5.0)
    monitor.until(lambda: len(monitor.data) == 6)
    node.send(struct.pack("<I", 5) + b"small")
    monitor.until(lambda: monitor.data[6:] == [b"small"])  # though nobody was woken
    assert connection.expects == 1
    node.send(large[:100_000])
    monitor.until(lambda: connection.expects > 1)
    node.die()
    monitor.until(lambda: not monitor.connections._standing)


def test_a_message_that_is_too_large_is_not_kept(
    monitor: Monitor, node: Node, monkeypatch: Any
) -> None:
    monkeypatch.setattr(settings, "LARGEST_MESSAGE_B", 1000)
    monitor.connect(node)
    node.send(struct.pack("<I", 5) + b"first")
    node.send(struct.pack("<I", 500_000) + b"\0" * 500_000)
    node.send(struct.pack("<I", 4) + b"last")
    monitor.until(lambda: monitor.data == [b"first", b"last"])
    node.send(struct.pack("<I", 0xFFFFFFFF) + b"\0" * 300_000)
    end = time.monotonic() + 0.2
    monitor.until(lambda: time.monotonic() > end)
    (connection,) = monitor.connections._standing.values()
    assert len(connection.frames) < 1000 and monitor.seen == []


def test_nothing_is_kept_of_a_node_that_comes_and_goes(monitor: Monitor) -> None:
    connections = monitor.connections
    parts = connections, connections._caller_ids, connections._reconnection

    def kept() -> Tuple[int, int]:
        held = (each for part in parts for each in vars(part).values() if isinstance(each, Sized))
        return len(os.listdir("/proc/self/fd")), sum(map(len, held))

    counts = []
    for _ in range(1000 if LONG else 50):
        node = Node(monitor.topic)
        monitor.connect(node)
        node.send(framed(b"data"))
        monitor.until(lambda: bool(monitor.data))
        node.die()
        monitor.until(lambda: monitor.kinds() == ["Disconnected"])
        monitor.seen.clear()
        monitor.data.clear()
        counts.append(kept())
    for before, after in zip(counts[4], counts[-1]):  # what ends just now may count or not
        assert after <= before + 5


def test_a_topic_whose_subscription_could_not_be_ended_can_be_subscribed_again(
    monitor: Monitor, node: Node, monkeypatch: Any
) -> None:
    monitor.connect(node)
    with monkeypatch.context() as broken:
        broken.setattr(rospy.Subscriber, "unregister", lambda self: 1 / 0)
        with pytest.raises(ZeroDivisionError):
            monitor.connections.unsubscribe(monitor.topic)()
    assert not monitor.connections.topics
    monitor.connections.subscribe(monitor.topic)
    monitor.connect(node)
