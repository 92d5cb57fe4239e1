"""How a substitute looks whether the others on its topic are silent, and not just unread."""
import socket
from types import SimpleNamespace
from typing import Any, Iterator, List, Tuple

import pytest
from std_msgs.msg import Float64

from shsa_core.ros.graph.overhearing import Overhearing

TOPIC, NODE, OURS = "/out", "/original", "/substitute_1"


class Bench:
    """Connections of one topic, as rospy has them."""

    def __init__(self) -> None:
        self.heard: List[Tuple[str, str, int]] = []
        self.gone: List[Tuple[str, str]] = []
        self.others = Overhearing(OURS, self.hear, lambda *who: self.gone.append((who[0], who[1])))
        impl: Any = SimpleNamespace(connections=[])
        self.connections = impl.connections
        self.others._subscribers[TOPIC] = SimpleNamespace(impl=impl)
        self.sockets: List[socket.socket] = []

    def hear(self, topic: str, publisher: str, stamp: int) -> None:
        """Somebody else was heard."""
        self.heard.append((topic, publisher, stamp))

    def connect(self, node: str) -> socket.socket:
        """A connection to a publisher: its end."""
        here, there = socket.socketpair()
        self.sockets += [here, there]
        transport = SimpleNamespace(socket=here, callerid_pub=node, done=False)
        self.connections.append(transport)
        return there


@pytest.fixture
def bench() -> Iterator[Bench]:
    made = Bench()
    yield made
    for each in made.sockets:
        each.close()


def test_a_connection_stands_while_nothing_comes(bench: Bench) -> None:
    assert not bench.others.stands(TOPIC, NODE) and not bench.others.stands("/another", NODE)
    bench.connect("/idle")
    assert not bench.others.stands(TOPIC, NODE)
    bench.connect(NODE)
    assert bench.others.stands(TOPIC, NODE) and bench.heard == []


def test_what_is_not_read_yet_is_heard_and_stays_to_be_read(bench: Bench) -> None:
    bench.connect(OURS).send(b"our own")
    bench.connect(NODE).send(b"a message")
    assert bench.others.stands(TOPIC, NODE)
    assert bench.heard == [(TOPIC, NODE, 0)]
    assert bench.connections[1].socket.recv(100) == b"a message"


def test_one_that_has_ended_does_not_stand(bench: Bench) -> None:
    bench.connect(NODE).close()
    assert not bench.others.stands(TOPIC, NODE)
    bench.connections[0].socket.close()
    assert not bench.others.stands(TOPIC, NODE)
    bench.connections[0].socket = None  # rospy connects again
    assert not bench.others.stands(TOPIC, NODE) and bench.heard == []


def test_the_newest_message_of_another_one_is_kept(bench: Bench) -> None:
    assert bench.others.newest(TOPIC) == b""
    for node, value in ((NODE, 1.0), (NODE, 2.0), (OURS, 3.0)):
        message = Float64(value)
        message._connection_header = {"callerid": node}
        bench.others._received(message, TOPIC)
    assert Float64().deserialize(bench.others.newest(TOPIC)).data == 2.0
    assert [each[1] for each in bench.heard] == [NODE, NODE]


def ended(node: str, port: int) -> Any:
    """A connection to a node that listens at a port, as rospy has it once it has ended."""
    uri = f"http://localhost:{port}/"
    return SimpleNamespace(callerid_pub=node, dest_address=("127.0.0.1", 1), endpoint_id=uri)


def test_who_has_ended_is_gone_once_nobody_listens_where_it_did(bench: Bench) -> None:
    with socket.create_server(("127.0.0.1", 0)) as listening:
        port = listening.getsockname()[1]
        bench.others.ended(TOPIC, ended(NODE, port))
        assert bench.gone == []
    bench.others.ended(TOPIC, ended(OURS, port))
    bench.others.ended("/another", ended(NODE, port))
    assert bench.gone == []
    bench.others.ended(TOPIC, ended(NODE, port))
    assert bench.gone == [(TOPIC, NODE)]
