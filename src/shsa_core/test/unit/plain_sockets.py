"""Nodes in plain sockets, a monitor that reads them by rospy, and a master of two calls."""
import socket
import struct
import threading
import time
from typing import Any, Callable, Dict, Iterator, List, Tuple
from xmlrpc.server import SimpleXMLRPCServer

import pytest
import rospy
from rospy.impl import tcpros_base
from rospy.impl.tcpros import get_tcpros_handler

from shsa_core.ros import clock
from shsa_core.ros.sockets.subscriptions import Arrived, Subscriptions, Tick

HOST = "127.0.0.1"
LISTED: Dict[str, str] = {}
"""The nodes of the master and their addresses. All publish every topic."""


def connected() -> Tuple[socket.socket, socket.socket]:
    """Two ends of a TCP connection; the second does not block."""
    with socket.create_server((HOST, 0)) as server:
        there = socket.create_connection(server.getsockname())
        here, _ = server.accept()
    here.setblocking(False)
    return there, here


class Server(SimpleXMLRPCServer):
    allow_reuse_address = True


class Node:
    """A publisher in plain sockets that does as it is told.

    `offers`: it agrees to publish; `others`: what else it does; `answers`: at all; `drops`: so many
    connections are closed before their header, and then `refuses` so many with an error. `listed`:
    its name at the master, which knows it by no other; empty: none.
    """

    def __init__(self, topic: str, name: str = "/node", listed: str = "/node") -> None:
        self.topic, self.name = topic, name
        self.offers, self.answers, self.drops, self.refuses = True, True, 0, 0
        self.others: List[Tuple[str, str]] = []
        self.asked = 0
        self.connections: List[socket.socket] = []
        self._data = socket.create_server((HOST, 0))
        self.api = Server((HOST, 0), logRequests=False)
        self.api.register_function(self.request, "requestTopic")  # type: ignore[arg-type]
        offered = lambda _caller: [1, "", self.others]
        self.api.register_function(offered, "getPublications")  # type: ignore[arg-type]
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
            if self.refuses:
                fields = {"error": f"{self.topic} is no topic of this node"}
            lines = [f"{key}={value}".encode() for key, value in fields.items()]
            header = b"".join(struct.pack("<I", len(line)) + line for line in lines)
            self.connections.append(made)  # first: the test may close it as soon as it stands
            made.sendall(struct.pack("<I", len(header)) + header)
            if self.refuses:
                self.refuses -= 1
                self.connections.remove(made)
                made.close()

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
        self.refused: List[Tuple[str, str, str]] = []
        refused = lambda *words: self.refused.append(words)
        self.connections = Subscriptions(clock.now, refused)
        self.inbox = self.connections.inbox
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
        assert self.inbox.take() == []
        for happening in self.connections.read():
            self.note(happening)

    def note(self, happening: Any) -> None:
        if isinstance(happening, Arrived):
            self.data.append(happening.data)
            self.heard.append((happening.connection.publisher, happening.data))
        elif not isinstance(happening, Tick):
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
        self.until(
            lambda: [(each.topic, each.publisher) for each in self.seen] == [(self.topic, name)]
        )
        assert self.kinds() == ["Connected"]
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


@pytest.fixture(name="master", autouse=True)
def _master(monkeypatch: Any) -> Iterator[Master]:
    LISTED.clear()
    made = Master()
    address = made.server.server_address
    monkeypatch.setenv("ROS_MASTER_URI", f"http://{HOST}:{address[1]}")
    yield made
    made.answers = True
    made.server.shutdown()
    made.server.server_close()


@pytest.fixture(name="monitor")
def _monitor(master: Master, monkeypatch: Any) -> Iterator[Monitor]:
    monkeypatch.setattr(tcpros_base, "_use_tcp_keepalive", False)  # else the master is asked
    rospy.rostime.set_rostime_initialized(True)
    made = Monitor(f"/topic_{next(NUMBERS)}")
    yield made
    made.connections.unsubscribe(made.topic)()


@pytest.fixture(name="node")
def _node(monitor: Monitor) -> Iterator[Node]:
    made = Node(monitor.topic)
    yield made
    made.answers = True
    made.die()


def framed(*messages: bytes) -> bytes:
    return b"".join(struct.pack("<I", len(each)) + each for each in messages)
