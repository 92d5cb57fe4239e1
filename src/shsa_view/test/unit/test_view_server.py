"""The server by itself, fed with facts: what is bounded, and what is said about it."""
import itertools
import json
import socket
import threading
from contextlib import ExitStack, closing
from http.client import HTTPConnection
from typing import Any, Dict, Iterator, List, Tuple

import pytest
from shsa_core.errors import ShsaError
from shsa_testing.waiting import wait_until
from shsa_view import facts, handlers, live, server, streams
from shsa_view.server import Settings, View, serve
from view_facts import NODES, well

Document = Dict[str, Any]


class Slow:
    """Answers when it is told to."""

    def __init__(self) -> None:
        self.go = threading.Event()

    def graph(self) -> Document:
        self.go.wait(10.0)
        return {"svg": ""}

    def what_if(self, service: str, node: str) -> Document:
        raise ValueError("a fault of ours")

    def act(self, action: str, body: Any, who: str) -> Document:
        return {"action": action, "body": body, "who": who}


class Served:
    """A view that is served in a thread."""

    def __init__(self, **settings: Any) -> None:
        self.answers = Slow()
        self.facts: List[facts.Fact] = [facts.TrustTold("checked")]
        self.said: List[str] = []
        self.ports: List[int] = []
        self._ended = threading.Event()
        given = Settings(**{"port": 0, "token": "secret", **settings})  # type: ignore[arg-type]
        self.view = View(given, well(), self.answers, self._take, lambda: 1.0, self.said.append)
        arguments = (self.view, self._ended.is_set, self.ports.append)
        self._thread = threading.Thread(target=serve, args=arguments, daemon=True)
        self._thread.start()

    def _take(self) -> Iterator[facts.Fact]:
        while self.facts:
            yield self.facts.pop()

    @property
    def port(self) -> int:
        return int(wait_until(lambda: self.ports, 10.0, "it is served")[0])

    def ask(self, path: str, body: Any = None, **headers: str) -> Tuple[int, Document]:
        with closing(HTTPConnection("127.0.0.1", self.port, timeout=20.0)) as connection:
            connection.request("POST" if body else "GET", path, body, headers)
            answer = connection.getresponse()
            return answer.status, json.loads(answer.read())

    def end(self) -> None:
        self._ended.set()
        self.answers.go.set()
        self._thread.join(10.0)
        assert not self._thread.is_alive()


@pytest.fixture(name="served")
def _served() -> Iterator[Served]:
    served = Served()
    yield served
    served.end()


def text(served: Served, path: str) -> Tuple[str, str]:
    """Return the type and the text of an answer that is no JSON."""
    with closing(HTTPConnection("127.0.0.1", served.port, timeout=20.0)) as connection:
        connection.request("GET", path)
        answer = connection.getresponse()
        assert answer.status == 200
        return str(answer.getheader("Content-Type")), answer.read().decode()


def test_values_the_last_hour_and_metrics_are_served(served: Served) -> None:
    ammeter = "/api/values?service=ammeter"
    wait_until(lambda: served.ask(ammeter)[1].get("times"), 10.0, "a sample")
    status, told = served.ask("/api/values")
    assert status == 400 and "name a service" in told["error"]
    status, told = served.ask("/api/values?service=nope")
    assert (status, told) == (400, {"error": "there is no service 'nope' here"})
    assert set(served.ask("/api/timeline.json")[1]["services"]) == {*NODES}
    kind, lines_ = text(served, "/api/timeline.csv")
    assert kind.startswith("text/csv") and lines_.startswith("what,service,")
    kind, lines_ = text(served, "/metrics")
    assert kind.startswith("text/plain; version=0.0.4") and 'shsa_up{part="master"} 1' in lines_


def lines(served: Served, count: int) -> List[bytes]:
    """Return the first lines of a stream."""
    with closing(HTTPConnection("127.0.0.1", served.port, timeout=20.0)) as connection:
        connection.request("GET", "/api/events")
        answer = connection.getresponse()
        return [answer.readline() for _ in range(count)]


def test_a_stream_begins_with_the_whole_state_and_goes_on_with_signs_of_life(
    served: Served, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(streams, "KEEP_ALIVE_S", 0.05)
    first = lines(served, 40)
    assert first[0].startswith(b"id: ") and first[1] == b"event: state\n"
    assert json.loads(first[2][len(b"data: ") :])["version"] == 1
    assert b": alive\n" in first


def test_who_reads_nothing_is_dropped(served: Served, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(handlers, "SLOW_S", 0.2)
    with closing(socket.socket()) as reader:
        reader.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 4096)
        reader.connect(("127.0.0.1", served.port))
        reader.sendall(b"GET /api/events HTTP/1.1\r\nHost: localhost\r\n\r\n")
        wait_until(lambda: len(served.view.streams), 5.0, "it is open")
        turns = itertools.count()

        def flooded() -> bool:
            text = str(next(turns)) + "x" * 900
            served.facts += [facts.HostTold(f"h{i}", "heard", text) for i in range(1000)]
            wait_until(lambda: not served.facts, 5.0, "all is told")
            return not len(served.view.streams)

        wait_until(flooded, 20.0, "it is dropped")
    assert not served.said


def test_questions_are_bounded(served: Served, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(live, "ANSWER_S", 0.2)
    assert served.ask("/api/graph") == (504, {"error": "no answer within 0.2 s"})
    found: List[int] = []
    asking = [
        threading.Thread(target=lambda: found.append(served.ask("/api/graph")[0]))
        for _ in range(live.MOST_ASKED + 3)
    ]
    for each in asking:
        each.start()
    for each in asking:
        each.join(10.0)
    assert sorted(set(found)) == [503, 504]
    served.answers.go.set()
    wait_until(lambda: served.ask("/api/graph")[0] == 200, 5.0, "it answers again")


def test_a_fault_of_ours_stops_nothing(served: Served) -> None:
    assert served.ask("/api/what_if?service=x")[0] == 500
    served.facts.append("no fact")  # type: ignore[arg-type]
    wait_until(lambda: served.said, 5.0, "it is said")
    assert served.ask("/api/state")[0] == 200


def test_an_action_has_its_body_and_who_asks(served: Served) -> None:
    path, bearer = "/api/actions/release", {"Authorization": "Bearer secret"}
    told = {"action": "release", "body": {"topic": "/t"}, "who": "127.0.0.1"}
    assert served.ask(path, '{"topic": "/t"}', **bearer) == (200, told)
    for body in ("[1]", "{", "\ud800".encode("utf-8", "surrogatepass"), "[" * 4000):
        assert served.ask(path, body, **bearer)[0] == 400


def test_a_port_in_use_is_said_once_and_waited_for(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(server, "RETRY_S", 0.05)
    with closing(socket.socket()) as other:
        other.bind(("127.0.0.1", 0))
        other.listen()
        port = other.getsockname()[1]
        served = Served(port=port)
        wait_until(lambda: served.said, 5.0, "it is said")
        assert str(port) in served.said[0] and "in use" in served.said[0]
    assert served.port == port and len(served.said) == 1
    served.end()


@pytest.mark.parametrize("address", ["no.such.host.invalid", "203.0.113.1"])
def test_an_address_that_is_not_ours_is_refused(address: str) -> None:
    view = View(Settings(address, 0), well(), Slow(), lambda: (), lambda: 0.0, print)
    with pytest.raises(ShsaError, match=address):
        serve(view, lambda: False, lambda port: None)


def test_slow_connections_shut_nobody_out(served: Served) -> None:
    with ExitStack() as slow:
        for _ in range(120):
            connection = slow.enter_context(socket.create_connection(("127.0.0.1", served.port)))
            connection.sendall(b"GET / HTTP/1.1\r\n")
        assert served.ask("/api/state")[0] == 200


def test_without_a_token_nobody_acts() -> None:
    served = Served(token="")
    status, told = served.ask("/api/actions/release", "{}", Authorization="Bearer ")
    assert status == 403 and "actions:=true" in told["error"]
    served.end()
