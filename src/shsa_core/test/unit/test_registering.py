"""A master that does not answer keeps the monitor from no topic that it watches already."""
import threading
from types import SimpleNamespace
from typing import Any, Callable, Iterator, List, Set

import pytest

from shsa_core.monitoring import events
from shsa_core.ros import clock
from shsa_core.ros.workers import UrgentFirst
from shsa_testing.waiting import wait_until

monitor = pytest.importorskip("shsa_core.ros.monitor")


class Waiting:
    """Subscriptions at a master that answers once `answers` is set."""

    def __init__(self) -> None:
        self.answers, self.topics = threading.Event(), {}  # type: ignore[var-annotated]
        self.fails, self.ended = 0, []  # type: ignore[var-annotated]

    def subscribe(self, topic: str) -> None:
        self.topics[topic] = None
        self.answers.wait(10.0)
        if self.fails:
            self.fails -= 1
            raise OSError("no descriptor")

    def unsubscribe(self, topic: str) -> Callable[[], None]:
        del self.topics[topic]
        return lambda: self.ended.append(topic) if self.answers.wait(10.0) else None


class Node(monitor.MonitorNode):  # type: ignore[name-defined,misc]
    """What the monitor's loop has of registrations."""

    def __init__(self) -> None:
        self.items: List[Callable[[], None]] = []
        self.fed: List[Any] = []
        self._inbox: Any = SimpleNamespace(put=self.items.append)
        self._subscriptions: Any = Waiting()
        self._registrations = UrgentFirst("registrations", 0.0)
        self._topics: Set[str] = set()
        self._pending: Set[str] = set()
        self._arguments: Any = None
        self._core: Any = SimpleNamespace(service_of=lambda *_: None)

    def _feed(self, event: events.Event) -> None:
        self.fed.append(event)

    def take(self) -> None:
        while self.items:
            self.items.pop(0)()

    def watch(self, *topics: str) -> None:
        self._som_changed(SimpleNamespace(topics=lambda: topics))

    @property
    def subscribed(self) -> List[str]:
        self.take()
        return [each.topic for each in self.fed if isinstance(each, events.Subscribed)]


@pytest.fixture(name="node")
def _node(monkeypatch: Any) -> Iterator[Node]:
    monkeypatch.setattr(monitor, "_share", lambda arguments, som: som)
    monkeypatch.setattr(monitor, "with_unknowns", lambda som, layout: som)
    monkeypatch.setattr(clock, "now", lambda: 1.0)
    made = Node()
    yield made
    made._subscriptions.answers.set()


def test_the_loop_goes_on_while_the_master_stalls(node: Node) -> None:
    node.watch("/a", "/b")
    assert node.subscribed == []
    node._subscriptions.answers.set()
    wait_until(lambda: node.subscribed == ["/a", "/b"], 5.0, "both are subscribed")
    node._subscriptions.answers.clear()
    node.watch("/b")
    assert not node._subscriptions.ended and list(node._subscriptions.topics) == ["/b"]
    node._subscriptions.answers.set()
    wait_until(lambda: node._subscriptions.ended == ["/a"], 5.0, "the master knows")


def test_a_topic_that_leaves_while_it_is_subscribed_is_left_then(node: Node) -> None:
    node.watch("/a")
    wait_until(lambda: node._subscriptions.topics, 5.0, "it is being subscribed")
    node.watch()
    node._subscriptions.answers.set()
    wait_until(lambda: node.subscribed and node._subscriptions.ended, 5.0, "it is left")
    assert node._subscriptions.topics == {} and node._pending == set()


def test_who_connects_first_is_told_after_that_it_can_be_heard(node: Node) -> None:
    node.watch("/a")
    node._happened(events.Connected(1.0, "/a", "/node"))
    kinds = [events.SomChanged, events.Subscribed, events.Connected]
    assert [type(each) for each in node.fed] == kinds


def test_what_fails_is_tried_again(node: Node) -> None:
    node._subscriptions.fails = 2
    node._subscriptions.answers.set()
    node.watch("/a")
    wait_until(lambda: node.subscribed == ["/a"], 5.0, "it is subscribed")
    assert node._subscriptions.fails == 0
