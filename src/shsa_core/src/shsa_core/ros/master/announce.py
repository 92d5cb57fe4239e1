"""Tells subscribers of new publishers: the master takes up to 0.1 s, or for ever.

It tells with three threads and no timeout: while three subscribers hang, nobody hears of a new
publisher. `remind` tells of our own; `Introductions` looks whether others were heard of.
"""
import threading
from contextlib import suppress
from functools import lru_cache, partial
from typing import Callable, FrozenSet, Iterable, List, Mapping, NamedTuple, Optional, Tuple

import rospy

from shsa_core.agenda import Agenda
from shsa_core.ros import settings
from shsa_core.ros.master.node_api import FAILURES, connected, master_api, node_api, uri_of
from shsa_core.ros.workers import Workers


def remind(topics: Iterable[str], served: Callable[[str], FrozenSet[str]]) -> None:
    """Tell the subscribers of `topics` that have not connected to us the publishers of each.

    Raises one of FAILURES. Who has just left, so that the master knows it no more, is left out.
    """
    uri = lru_cache(maxsize=None)(uri_of)  # the same few nodes have many topics
    publishing, subscribing = (dict(rows) for rows in master_api().getSystemState()[:2])
    for topic in topics:
        nodes = [node for node in subscribing.get(topic, ()) if node not in served(topic)]
        if nodes:
            publishers = filter(None, map(uri, publishing.get(topic, ())))
            tell(filter(None, map(uri, nodes)), topic, list(publishers))


def register_again() -> None:
    """Register what the master does not know of this process. Raises one of FAILURES."""
    manager, master, uri = rospy.topics.get_topic_manager(), master_api(), rospy.get_node_uri()
    with manager.lock:  # rospy reads both without it, while another thread may register
        ours = manager.get_publications(), manager.get_subscriptions()
    calls = (master.registerPublisher, False), (master.registerSubscriber, True)
    *topics_known, services = map(_of_our_name, master.getSystemState())
    for topics, (register, subscribes), known in zip(ours, calls, topics_known):
        for topic, kind in topics:
            if topic not in known:
                others = register(topic, kind, uri)
                if subscribes:  # of later ones the master tells us
                    node_api(uri).publisherUpdate("/master", topic, others)
    for service, where in rospy.impl.registration.get_service_manager().get_services():
        if service not in services:  # whoever has followed us under our name has it as well
            master.registerService(service, where, uri)


def _of_our_name(rows: Iterable[Tuple[str, List[str]]]) -> FrozenSet[str]:
    return frozenset(name for name, nodes in rows if rospy.get_name() in nodes)


def tell(subscribers: Iterable[str], topic: str, publishers: List[str]) -> None:
    """Tell the full list of publishers, each in a thread: a hung subscriber delays nobody."""

    def call(subscriber: str) -> None:
        with suppress(*FAILURES):  # it is away, or asks the master itself later
            node_api(subscriber).publisherUpdate("/master", topic, publishers)

    for subscriber in subscribers:
        threading.Thread(target=call, args=(subscriber,), daemon=True).start()


class Publisher(NamedTuple):
    """A node at its URI publishes a topic."""

    topic: str
    node: str
    uri: str


class Introductions:
    """Publishers that came a moment ago: looks a while later who has connected to each.

    The others are told after the master, not beside it: a rospy subscriber that is told twice at
    the same time connects twice, and may end without any connection. `first`: our own node; it may
    be the newest of all. `hung`: the subscribers that do not answer; a new set each time.
    """

    def __init__(self, first: str) -> None:
        self.hung: FrozenSet[str] = frozenset()
        self._first = first
        self._known: Optional[FrozenSet[Publisher]] = None
        self._looks: Agenda[Tuple[int, Publisher]] = Agenda()
        self._workers = Workers("introductions", settings.MOST_CALLS)

    @property
    def deadline(self) -> float:
        """Return when somebody is to be looked at, in s; infinite: nobody is."""
        return self._looks.next()

    def heed(self, time: float, publishers: FrozenSet[Publisher]) -> None:
        """Note the publishers of now."""
        known = self._known
        if known is None:
            known = frozenset(each for each in publishers if each.node != self._first)
        self._known = publishers
        for each in publishers - known:
            for looks in settings.INTRODUCTION_LOOKS:
                self._looks.set((looks, each), time + looks * settings.MASTER_LOOK_S)

    def due(self, time: float) -> List[Publisher]:
        """Return those to look at now, of those that are there still."""
        due = {publisher for _, publisher in self._looks.pop_due(time)}
        return sorted(due & (self._known or frozenset()))

    def introduce(self, new: Publisher, subscribers: Mapping[str, str]) -> None:
        """Tell those of the subscribers, by name their URI, that have not connected to it."""
        others = self._known or frozenset()
        publishers = sorted(each.uri for each in others if each.topic == new.topic)

        def look() -> None:
            try:
                served = set(connected(new.topic, new.uri).values())
            except (*FAILURES, TypeError, LookupError):
                return  # a node that does not answer gives no connection either
            for node in subscribers.keys() - served - {new.node}:  # nobody connects to itself
                self._workers.put(partial(self._tell, node, subscribers[node], new, publishers))

        self._workers.put(look)

    def _tell(self, node: str, uri: str, new: Publisher, publishers: List[str]) -> None:
        try:
            node_api(uri).publisherUpdate("/master", new.topic, publishers)
        except OSError as error:
            if not isinstance(error, ConnectionError) and node not in self.hung:
                self.hung = self.hung | {node}
                text = "%s does not answer, and the master waits for it. Healing tells the others."
                rospy.logwarn(text, node)
            return
        except FAILURES as error:
            rospy.logdebug("%s was not told of %s: %s", node, new.topic, error)
        self.hung = self.hung - {node}
