"""A lost connection is no failure while its node lives, and a name is a claim.

Real sockets, rospy's own connections, and a master of two calls.
"""
import socket
import struct
import threading
import time
from typing import Any, Callable, Dict, Iterator, List, Tuple
from xmlrpc.server import SimpleXMLRPCServer

import pytest
from rospy.impl import tcpros_base
from rospy.impl.tcpros import get_tcpros_handler

from shsa_core.ros.graph import claims
from shsa_core.ros.graph import connections as module
from shsa_core.ros.graph import stream
from shsa_core.ros.graph.connections import (
    Arrived,
    Closed,
    Connected,
    Connections,
    Made,
)
from shsa_core.ros.graph.identities import Identified
from shsa_core.ros.graph.inbox import Inbox
from shsa_core.ros.graph.reconnection import Answered, Reconnection, refuses

HOST, RECONNECT_S = "127.0.0.1", 0.4
LISTED: Dict[str, str] = {}
"""What the master knows: nodes and their addresses. All publish every topic."""


class Server(SimpleXMLRPCServer):
    allow_reuse_address = True


class Node:
    """A publisher in plain sockets that does as it is told.

    `offers`: it agrees to publish; `answers`: at all; `drops`: so many connections are closed
    before their header. `listed`: its name at the master, which knows it by no other; empty: none.
    """

    def __init__(self, topic: str, name: str = "/node", listed: str = "/node") -> None:
        self.topic, self.name = topic, name
        self.offers, self.answers, self.drops = True, True, 0
        self.asked = 0
        self.connections: List[socket.socket] = []
        self._data = socket.create_server((HOST, 0))
        self.api = Server((HOST, 0), logRequests=False)
        self.api.register_function(self.request, "requestTopic")  # type: ignore[arg-type]
        self.uri = f"http://{HOST}:{self.api.server_address[1]}"
        if listed:
            LISTED[listed] = self.uri
        serve = lambda: self.api.serve_forever(poll_interval=0.01)
        for work in (serve, self._accept):
            threading.Thread(target=work, daemon=True).start()

    def request(self, caller: str, topic: str, protocols: Any) -> List[Any]:
        self.asked += 1
        if not self.answers:
            time.sleep(2.0)
        return [1, "", self.protocol] if self.offers else [0, "not a publisher", []]

    @property
    def protocol(self) -> List[Any]:
        return ["TCPROS", HOST, self._data.getsockname()[1]]

    def _accept(self) -> None:
        while True:
            try:
                made, _ = self._data.accept()
            except OSError:
                return
            size = struct.unpack("<I", made.recv(4, socket.MSG_WAITALL))[0]
            made.recv(size, socket.MSG_WAITALL)
            if self.drops:
                self.drops -= 1
                made.close()
                continue
            fields = {"callerid": self.name, "md5sum": "*", "type": "x/Y", "topic": self.topic}
            lines = [f"{key}={value}".encode() for key, value in fields.items()]
            header = b"".join(struct.pack("<I", len(line)) + line for line in lines)
            self.connections.append(made)  # first: the test may close it as soon as it stands
            made.sendall(struct.pack("<I", len(header)) + header)

    def send(self, data: bytes) -> None:
        self.connections[-1].sendall(data)

    def close_connections(self) -> None:
        for each in self.connections:
            each.close()
        self.connections.clear()

    def die(self) -> None:
        """As the kernel does it: in the order in which they were opened."""
        self.api.shutdown()  # or its thread would hold the socket open
        self.api.server_close()
        self._data.close()
        self.close_connections()


class Monitor:
    """Whoever reads the connections."""

    def __init__(self, topic: str) -> None:
        self.inbox = Inbox()
        self.refused: List[Tuple[str, str, str]] = []
        refused = lambda *words: self.refused.append(words)
        self.connections = Connections(self.inbox, RECONNECT_S, refused)
        self.topic = topic
        self.connections.subscribe(topic)
        self.seen: List[Any] = []
        self.data: List[bytes] = []
        self.heard: List[Tuple[str, bytes]] = []

    def hear_of(self, node: Node) -> None:
        """As rospy does when it is told of a publisher."""
        code, why, _ = get_tcpros_handler().create_transport(self.topic, node.uri, node.protocol)
        assert code == 1, why

    def turn(self) -> None:
        self.inbox.wait(0.02)
        ready = self.inbox.ready()
        for item in self.inbox.take():
            assert isinstance(item, (Made, Closed, Answered, Identified))
            for happening in self.connections.heed(item):
                self.note(happening)
        for happening in self.connections.read(ready):
            self.note(happening)

    def note(self, happening: Any) -> None:
        if isinstance(happening, Arrived):
            self.data.append(happening.data)
            self.heard.append((happening.connection.publisher, happening.data))
        else:
            self.seen.append(happening)

    def until(self, condition: Callable[[], bool], seconds: float = 5.0) -> None:
        end = time.monotonic() + seconds
        while not condition():
            assert time.monotonic() < end, self.seen
            self.turn()

    def connect(self, node: Node) -> None:
        self.connect_as(node, node.name)

    def connect_as(self, node: Node, name: str) -> None:
        self.hear_of(node)
        self.until(lambda: Connected(self.topic, name) in self.seen)
        self.seen.clear()

    def kinds(self) -> List[str]:
        return [type(each).__name__ for each in self.seen]


NUMBERS = iter(range(1000))


class Master:
    """Lists nodes; `answers`: at all."""

    def __init__(self) -> None:
        self.answers, self.asked = True, 0
        self.server = Server((HOST, 0), logRequests=False)
        self.server.register_function(self.look_up, "lookupNode")  # type: ignore[arg-type]
        self.server.register_function(self.state, "getSystemState")  # type: ignore[arg-type]
        serve = lambda: self.server.serve_forever(poll_interval=0.01)
        threading.Thread(target=serve, daemon=True).start()

    def look_up(self, caller: str, node: str) -> List[Any]:
        self.asked += 1
        if not self.answers:
            time.sleep(1.0)
        return [1, "", LISTED[node]] if node in LISTED else [-1, "unknown node", ""]

    def state(self, caller: str) -> List[Any]:
        topics = {f"/topic_{number}" for number in range(100)}
        return [1, "", [[[topic, list(LISTED)] for topic in topics], [], []]]


@pytest.fixture(autouse=True)
def master(monkeypatch: Any) -> Iterator[Master]:
    LISTED.clear()
    made = Master()
    address = made.server.server_address
    monkeypatch.setenv("ROS_MASTER_URI", f"http://{HOST}:{address[1]}")
    yield made
    made.answers = True
    made.server.shutdown()
    made.server.server_close()


@pytest.fixture
def monitor(master: Master, monkeypatch: Any) -> Iterator[Monitor]:
    monkeypatch.setattr(tcpros_base, "_use_tcp_keepalive", False)  # else the master is asked
    made = Monitor(f"/topic_{next(NUMBERS)}")
    yield made
    made.connections.unsubscribe(made.topic)


@pytest.fixture
def node(monitor: Monitor) -> Iterator[Node]:
    made = Node(monitor.topic)
    yield made
    made.answers = True
    made.die()


def test_a_node_that_died_is_told_at_once(monitor: Monitor, node: Node) -> None:
    monitor.connect(node)
    node.die()
    begun = time.monotonic()
    monitor.until(lambda: bool(monitor.seen))
    assert monitor.kinds() == ["Lost"]
    assert time.monotonic() - begun < 0.1 and node.asked == 0


def test_to_look_whether_a_node_is_gone_takes_no_time(node: Node) -> None:
    assert not refuses(HOST, node.uri)
    node.die()
    begun = time.monotonic()
    assert all(refuses(HOST, node.uri) for _ in range(100))
    assert time.monotonic() - begun < 0.2


def test_one_look_does_for_all_topics_of_a_node(node: Node) -> None:
    reconnection = Reconnection(Inbox())
    begun = time.monotonic()
    assert not any(reconnection.is_gone(HOST, node.uri) for _ in range(1000))
    assert time.monotonic() - begun < 0.5
    node.die()
    end = time.monotonic() + 5.0
    while not reconnection.is_gone(HOST, node.uri):
        assert time.monotonic() < end


@pytest.mark.parametrize("uri", ["", "nonsense", "http://x:99999999/", "http://[", "http://x"])
def test_a_strange_address_refuses_nothing(uri: str) -> None:
    assert not refuses(HOST, uri) and not refuses("", uri)


def test_a_node_that_drops_a_connection_is_connected_again(monitor: Monitor, node: Node) -> None:
    monitor.connect(node)
    for _ in range(3):
        node.close_connections()
        monitor.until(lambda: "Connected" in monitor.kinds())
        assert monitor.kinds() == ["Interrupted", "Connected"]
        monitor.seen.clear()
    node.send(struct.pack("<I", 3) + b"abc")
    monitor.until(lambda: monitor.data == [b"abc"])


def test_two_connections_of_which_each_end_drops_another(monitor: Monitor, node: Node) -> None:
    """What a subscriber does that is told twice, and a publisher that sees the second one first."""
    monitor.connect(node)
    implementation = monitor.connections._implementation(monitor.topic)
    node.drops = 1
    first = implementation.connections[0]
    monitor.hear_of(node)  # rospy drops the first one, the publisher the second
    monitor.until(lambda: first.done and "Connected" in monitor.kinds())
    assert monitor.kinds() == ["Interrupted", "Connected"]


def test_a_connection_that_is_dropped_before_it_stands_is_asked_for_again(
    monitor: Monitor, node: Node
) -> None:
    node.drops = 2
    monitor.hear_of(node)
    monitor.until(lambda: "Connected" in monitor.kinds())
    assert monitor.kinds() == ["Connected"] and node.asked == 2


def test_a_node_that_never_lets_it_stand_is_asked_a_few_times(monitor: Monitor, node: Node) -> None:
    node.drops = 1000
    monitor.hear_of(node)
    monitor.until(lambda: node.asked == module.TRIES)
    end = time.monotonic() + 2 * RECONNECT_S
    monitor.until(lambda: time.monotonic() > end)
    assert monitor.seen == [] and node.asked == module.TRIES


def test_a_node_that_offers_the_topic_no_more_is_gone(monitor: Monitor, node: Node) -> None:
    monitor.connect(node)
    node.offers = False
    node.close_connections()
    monitor.until(lambda: "Lost" in monitor.kinds())
    assert monitor.kinds() == ["Interrupted", "Lost"]


def test_a_node_that_says_nothing_is_gone_after_a_while(monitor: Monitor, node: Node) -> None:
    monitor.connect(node)
    node.answers = False
    begun = time.monotonic()
    node.close_connections()
    monitor.until(lambda: "Lost" in monitor.kinds())
    assert monitor.kinds() == ["Interrupted", "Lost"]
    assert RECONNECT_S <= time.monotonic() - begun < RECONNECT_S + 0.3


def test_the_old_process_of_a_node_that_was_started_again_is_missed_by_nobody(
    monitor: Monitor, node: Node
) -> None:
    monitor.connect(node)
    successor = Node(monitor.topic)
    monitor.hear_of(successor)
    both = (
        lambda: len(monitor.connections._standing) == 2 and not monitor.connections._claims._claims
    )
    monitor.until(both)
    node.die()
    monitor.until(lambda: len(monitor.connections._standing) == 1)
    assert monitor.seen == []
    successor.die()
    monitor.until(lambda: bool(monitor.seen))
    assert monitor.kinds() == ["Lost"]


def test_a_topic_that_is_left_while_its_node_is_in_doubt(monitor: Monitor, node: Node) -> None:
    monitor.connect(node)
    node.answers = False
    node.close_connections()
    monitor.until(lambda: monitor.kinds() == ["Interrupted"])
    monitor.connections.unsubscribe(monitor.topic)
    end = time.monotonic() + 2 * RECONNECT_S
    monitor.until(lambda: time.monotonic() > end)
    assert monitor.kinds() == ["Interrupted"]
    monitor.connections.subscribe(monitor.topic)


def test_a_message_that_is_too_large_is_not_kept(
    monitor: Monitor, node: Node, monkeypatch: Any
) -> None:
    monkeypatch.setattr(stream, "LARGEST_MESSAGE", 1000)
    monitor.connect(node)
    node.send(struct.pack("<I", 5) + b"first")
    node.send(struct.pack("<I", 500_000) + b"\0" * 500_000)
    node.send(struct.pack("<I", 4) + b"last")
    monitor.until(lambda: monitor.data == [b"first", b"last"])
    node.send(struct.pack("<I", 0xFFFFFFFF) + b"\0" * 300_000)
    end = time.monotonic() + 0.2
    monitor.until(lambda: time.monotonic() > end)
    (connection,) = monitor.connections._standing.values()
    assert len(connection.buffer) < 1000 and monitor.seen == []


# Who is at the other end


def framed(data: bytes) -> bytes:
    return struct.pack("<I", len(data)) + data


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
    assert monitor.kinds() == ["Lost"] and monitor.seen[0].publisher == "/stranger"
    why = "it is /stranger, by the master's word"
    assert monitor.refused == [(monitor.topic, node.name, why)]


def test_who_is_not_listed_counts_for_nobody(
    monitor: Monitor, node: Node, monkeypatch: Any
) -> None:
    monkeypatch.setattr(claims, "ASK_AGAIN_S", (0.05,))
    monitor.connect(node)
    stranger = Node(monitor.topic, node.name, listed="")
    monitor.hear_of(stranger)
    monitor.until(lambda: bool(monitor.refused))
    assert monitor.refused[0] == (monitor.topic, node.name, claims.NOT_LISTED)
    for _ in range(100):
        stranger.send(framed(b"forged" * 1000))
    node.send(framed(b"true"))
    monitor.until(lambda: monitor.data == [b"true"])
    stranger.die()
    monitor.until(lambda: not monitor.connections._claims._claims)
    assert monitor.seen == [] and monitor.data == [b"true"]


def test_who_registers_later_is_heard_from_then_on_with_its_newest_message(
    monitor: Monitor, monkeypatch: Any
) -> None:
    monkeypatch.setattr(claims, "ASK_AGAIN_S", (0.05,))
    late = Node(monitor.topic, "/late", listed="")
    monitor.hear_of(late)
    monitor.until(lambda: bool(late.connections))
    late.send(framed(b"old") + framed(b"new"))
    monitor.until(
        lambda: any(each.newest == b"new" for each in monitor.connections._claims._claims.values())
    )
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


def test_whoever_comes_to_the_address_of_a_node_that_is_gone_is_asked_about(
    monitor: Monitor, node: Node
) -> None:
    monitor.connect(node)
    assert monitor.connections._claims._identities.is_known(node.name, node.uri)
    node.die()
    monitor.until(lambda: "Lost" in monitor.kinds())
    assert not monitor.connections._claims._identities.is_known(node.name, node.uri)


def test_a_connection_that_ends_before_the_master_has_answered_is_asked_for_again(
    monitor: Monitor, node: Node, master: Master, monkeypatch: Any
) -> None:
    monkeypatch.setattr(claims, "ASK_AGAIN_S", (0.05,))
    master.answers = False
    monitor.hear_of(node)
    monitor.until(lambda: bool(monitor.connections._claims._claims))
    node.close_connections()
    monitor.until(lambda: node.asked == 1)
    master.answers = True
    monitor.until(lambda: "Connected" in monitor.kinds())
    assert monitor.kinds() == ["Connected"]
