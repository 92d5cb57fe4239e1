"""A name is a claim: who is at the other end of a connection is what the master says."""
import time
from types import SimpleNamespace
from typing import Any, List

from plain_sockets import LISTED, Master, Monitor, Node, framed
from plain_sockets import _master, _monitor, _node  # noqa: F401  fixtures

from shsa_core.ros import settings
from shsa_core.ros.sockets.caller_ids import NOT_LISTED, CallerIds


class Stranger:
    """A connection to somebody whom the master does not list."""

    topic, publisher, uri, transport = (
        "/odom",
        "/stranger",
        "http://localhost:1/",
        SimpleNamespace(socket=None),
    )


def test_who_claims_the_name_of_another_is_whom_the_master_lists(
    monitor: Monitor, node: Node
) -> None:
    monitor.connect(node)
    stranger = Node(monitor.topic, node.name, listed="/stranger")
    monitor.connect_as(stranger, "/stranger")
    stranger.send(framed(b"forged"))
    monitor.until(lambda: monitor.heard == [("/stranger", b"forged")])
    stranger.die()
    monitor.until(lambda: bool(monitor.seen))
    assert monitor.kinds() == ["Disconnected"] and monitor.seen[0].publisher == "/stranger"
    why = "it is /stranger, by the master's word"
    assert monitor.refused == [(monitor.topic, node.name, why)]


def test_who_is_not_listed_counts_for_nobody(
    monitor: Monitor, node: Node, monkeypatch: Any
) -> None:
    monkeypatch.setattr(settings, "FIRST_PAUSE_S", 0.05)
    monitor.connect(node)
    stranger = Node(monitor.topic, node.name, listed="")
    monitor.hear_of(stranger)
    monitor.until(lambda: bool(monitor.refused))
    assert monitor.refused[0] == (monitor.topic, node.name, NOT_LISTED)
    for _ in range(100):
        stranger.send(framed(b"forged" * 1000))
    node.send(framed(b"true"))
    monitor.until(lambda: monitor.data == [b"true"])
    stranger.die()
    monitor.until(lambda: not monitor.connections._caller_ids._tries)
    assert monitor.seen == [] and monitor.data == [b"true"]


def test_who_registers_later_is_heard_from_then_on_with_its_newest_message(
    monitor: Monitor, monkeypatch: Any
) -> None:
    monkeypatch.setattr(settings, "FIRST_PAUSE_S", 0.05)
    late = Node(monitor.topic, "/late", listed="")
    monitor.hear_of(late)
    monitor.until(lambda: bool(late.connections))
    late.send(framed(b"old") + framed(b"new"))
    standing = monitor.connections._standing
    monitor.until(lambda: b"new" in [each.newest for each in standing.values()])
    LISTED["/late"] = late.uri
    monitor.until(lambda: monitor.data == [b"new"])
    assert monitor.kinds() == ["Connected"]
    late.die()


def test_a_master_that_hangs_holds_up_nobody_who_publishes(
    monitor: Monitor, node: Node, master: Master
) -> None:
    master.answers = False
    monitor.hear_of(node)
    monitor.until(lambda: bool(node.connections))
    begun = time.monotonic()
    for _ in range(200):
        node.send(framed(bytes(50_000)))
        monitor.turn()
    assert time.monotonic() - begun < 5.0 and monitor.data == []
    master.answers = True
    monitor.until(lambda: "Connected" in monitor.kinds())
    monitor.until(lambda: len(monitor.data) == 1)


def test_the_master_is_asked_once_for_a_node_that_connects_again(
    monitor: Monitor, node: Node, master: Master
) -> None:
    monitor.connect(node)
    asked = master.asked
    master.answers = False
    node.close_connections()
    monitor.until(lambda: "Connected" in monitor.kinds(), 1.0)
    assert monitor.kinds() == ["Interrupted", "Connected"] and master.asked == asked == 1


def test_a_connection_counts_no_more_for_a_name_that_another_process_has_taken(
    monitor: Monitor, node: Node, monkeypatch: Any
) -> None:
    monkeypatch.setattr(settings, "FIRST_PAUSE_S", 0.05)
    monitor.connect(node)
    returned = Node(monitor.topic)
    monitor.hear_of(returned)
    monitor.until(lambda: "Connected" in monitor.kinds())
    assert monitor.seen[0].uri == returned.uri + "/"
    node.send(framed(b"bad") * 100)
    monitor.until(lambda: bool(monitor.refused))
    returned.send(framed(b"good"))
    monitor.until(lambda: bool(monitor.data))
    assert monitor.data == [b"good"] and monitor.kinds() == ["Connected"]
    returned.die()


def test_who_sends_as_another_user_than_the_one_who_listens_counts_for_nobody(
    monitor: Monitor, node: Node, monkeypatch: Any
) -> None:
    """As one who answers at [::1] for a node that is at 127.0.0.1, of the same port."""
    monkeypatch.setattr(settings, "FIRST_PAUSE_S", 0.05)
    monkeypatch.setattr("shsa_core.ros.sockets.caller_ids.speaker", lambda connected: 4002)
    monitor.hear_of(node)
    monitor.until(lambda: bool(monitor.refused))
    assert monitor.refused == [(monitor.topic, node.name, NOT_LISTED)] and monitor.seen == []


def test_whoever_comes_to_the_address_of_a_node_that_is_gone_is_asked_about(
    monitor: Monitor, node: Node
) -> None:
    monitor.connect(node)
    assert monitor.connections._caller_ids._nodes[node.name] == node.uri
    node.die()
    monitor.until(lambda: "Disconnected" in monitor.kinds())
    assert node.name not in monitor.connections._caller_ids._nodes


def test_a_connection_that_ends_before_the_master_has_answered_is_asked_for_again(
    monitor: Monitor, node: Node, master: Master, monkeypatch: Any
) -> None:
    monkeypatch.setattr(settings, "FIRST_PAUSE_S", 0.05)
    master.answers = False
    monitor.hear_of(node)
    monitor.until(lambda: bool(monitor.connections._caller_ids._tries))
    node.close_connections()
    monitor.until(lambda: node.asked == 1)
    master.answers = True
    monitor.until(lambda: "Connected" in monitor.kinds())
    assert monitor.kinds() == ["Connected"]


def test_who_is_never_listed_is_asked_about_for_days() -> None:
    refused: List[str] = []
    caller_ids = CallerIds(lambda *_: None, lambda topic, claim, why: refused.append(why))
    connection: Any = Stranger()
    caller_ids.claim(connection)
    for _ in range(3000):  # 8 h
        assert not caller_ids.answered(connection, "", "")
    assert refused == [NOT_LISTED] * 2999
