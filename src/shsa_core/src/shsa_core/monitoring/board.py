"""Keeps up the table of health: who publishes what, how each is doing, and what changed."""
from math import inf
from typing import Dict, Iterable, Iterator, List, NamedTuple, Optional, Tuple, Union

from shsa_core.agenda import Agenda
from shsa_core.errors import ShsaError
from shsa_core.model.checks import BY_VALUE
from shsa_core.model.kinds import Kind
from shsa_core.model.service import Service
from shsa_core.monitoring.events import (
    Command,
    HealthChanged,
    Key,
    PublisherHealth,
    PublisherState,
    Told,
)
from shsa_core.monitoring.publishers import (
    NOBODY,
    Publisher,
    WatchedService,
    WatchedTopic,
    without_numbers,
)
from shsa_core.monitoring.substitutes import Bridges, Substitutes

UNKNOWN, HEALTHY, FAILED = PublisherState.UNKNOWN, PublisherState.HEALTHY, PublisherState.FAILED


class Silence(NamedTuple):
    """A publisher may have been silent for too long."""

    topic: str
    publisher: str


class Grace(NamedTuple):
    """The start-up grace of a service may be over."""

    topic: str
    service: str


Due = Union[Silence, Grace]

NEVER_GOOD = "it was never good by these numbers: the SOM may be wrong, and not the node"


class Board:
    """The watched topics with their publishers; notes every change until `commands` takes them."""

    def __init__(self) -> None:
        self.topics: Dict[str, WatchedTopic] = {}
        self.substitutes = Substitutes()
        self.bridges = Bridges()
        self.agenda: Agenda[Due] = Agenda()
        self._failed: List[PublisherHealth] = []
        self._told: List[Command] = []
        self._touched: Dict[Key, None] = {}

    def all(self) -> Iterable[Tuple[WatchedTopic, Publisher]]:
        """Yield every publisher with its topic."""
        for topic in self.topics.values():
            for publisher in topic.publishers.values():
                yield topic, publisher

    def find(self, topic: str, name: str) -> Optional[Tuple[WatchedTopic, Publisher]]:
        """Return a publisher with its topic; None if there is none of that name."""
        found = self.topics.get(topic)
        publisher = found.publishers.get(name) if found else None
        return (found, publisher) if found and publisher else None

    def table(self) -> Tuple[PublisherHealth, ...]:
        """Return the row of every publisher."""
        return tuple(publisher.row(topic.name) for topic, publisher in self.all())

    def commands(self, time: float) -> List[Command]:
        """Return the changed rows, and what is told to people, since the last call."""
        commands: List[Command] = []
        if self._touched:
            found = {key: self.find(*key) for key in self._touched}
            rows = tuple(each[1].row(each[0].name) for each in found.values() if each)
            removed = tuple(key for key, each in found.items() if not each)
            commands.append(HealthChanged(time, rows, removed, tuple(self._failed)))
        commands += self._told
        self._failed, self._touched, self._told = [], {}, []
        return commands

    # Who is who

    def watched_of(self, topic: WatchedTopic, publisher: str) -> Optional[WatchedService]:
        """Return the service that a publisher provides; None if nobody can tell."""
        return topic.service_of(publisher, self.substitutes.service(topic.name, publisher))

    def is_named(self, topic: WatchedTopic, publisher: Publisher) -> bool:
        """Tell if the SOM or the table of substitutions names a publisher, or did until now."""
        name = publisher.name
        return name in topic.nodes or self.substitutes.is_known(topic.name, name)

    def upstream(self, service: Service) -> Iterator[Tuple[str, Publisher]]:
        """Yield the publishers of what a service is computed from, with their topics."""
        for topic in self.topics.values():
            if not topic.services.keys().isdisjoint(service.upstream):
                yield from ((topic.name, each) for each in topic.publishers.values())

    def may_be_silent(self, topic: WatchedTopic, publisher: Publisher) -> bool:
        """Tell if a publisher is a substitute that need not publish here."""
        return self.substitutes.may_be_silent(topic.name, publisher.name)

    # Changes

    def look_when_due(self, topic: WatchedTopic, publisher: Publisher) -> None:
        """Have a publisher looked at once its silence is due."""
        self.agenda.bring_forward(Silence(topic.name, publisher.name), publisher.deadline)

    def bridge(self, topic: WatchedTopic, publisher: str, time: float) -> bool:
        """Count a message of a muted substitute that fills in; tell if it was one.

        Once the original has failed it is none: the substitute may know sooner that it took over.
        """
        row = self.substitutes.bridging(topic.name, publisher)
        if row is None:
            return False
        watched = topic.services.get(row.service)
        original = topic.publishers.get(watched.service.node) if watched else None
        if original is not None and original.state is FAILED:
            return False
        bridged = self.bridges.heard((topic.name, publisher), row, time)
        if bridged is not None:
            self._told.append(bridged)
        return True

    def meet(self, topic: WatchedTopic, name: str, time: float, uri: str = "") -> Publisher:
        """Put a new publisher in place of an old one of that name."""
        self.substitutes.retired.discard((topic.name, name))
        publisher = Publisher(name, time, self.watched_of(topic, name), uri=uri)
        topic.publishers[name] = publisher
        self.touch(topic, name)
        self._miss_no_more(topic, publisher.watched)
        self.notice(topic, publisher, time)
        return publisher

    def notice(self, topic: WatchedTopic, publisher: Publisher, time: float) -> None:
        """Note that a publisher is connected: all that an event-driven service asks of its node."""
        watched = publisher.watched
        if watched is None or not publisher.connected or self.may_be_silent(topic, publisher):
            return
        watched.appeared = True
        if publisher.last_heard is None:
            named = publisher.name == watched.service.node
            if watched.service.event_driven and named and publisher.state is UNKNOWN:
                self.become_healthy(topic, publisher, time)
            elif not watched.service.event_driven and publisher.state is HEALTHY:
                self.mute(topic, publisher, time)

    def expect(self, topic: WatchedTopic, time: float) -> Publisher:
        """Return the publisher without a name: somebody should be there."""
        self.touch(topic, NOBODY)
        if NOBODY not in topic.publishers:
            topic.publishers[NOBODY] = Publisher(NOBODY, time, None, connected=False)
        return topic.publishers[NOBODY]

    def miss(self, topic: WatchedTopic, name: str, time: float) -> Publisher:
        """Put a publisher that should be there, and is not connected."""
        if NOBODY in topic.publishers:
            self.drop(topic, NOBODY)
        missed = self.meet(topic, name, time)
        missed.connected = False
        return missed

    def fail(
        self, topic: WatchedTopic, publisher: Publisher, time: float, kind: Kind, detail: str
    ) -> None:
        """Fail a publisher."""
        if _never_good(publisher, kind):
            detail = f"{detail}; {NEVER_GOOD}"
        publisher.become(time, FAILED, kind, detail)
        self._failed.append(publisher.row(topic.name))
        self.touch(topic, publisher.name)

    def note(
        self, topic: WatchedTopic, publisher: Publisher, detail: str, time: float, log: bool = False
    ) -> None:
        """Tell why one that has not failed is not blamed, or what is unusual; empty: nothing is.

        `log`: people are told as well, once in a life of it, whatever its numbers.
        """
        if publisher.detail != detail:
            publisher.detail = detail
            self.touch(topic, publisher.name)
        if log and not publisher.was_logged:
            publisher.logged.add(without_numbers(detail))
            self._told.append(Told(time, f"{topic.name}: {publisher.name}: {detail}"))

    def become_healthy(self, topic: WatchedTopic, publisher: Publisher, time: float) -> None:
        """Find a publisher healthy."""
        publisher.become(time, HEALTHY)
        self.look_when_due(topic, publisher)
        self.touch(topic, publisher.name)
        self._miss_no_more(topic, publisher.watched)
        self.forget_gone(topic)

    def mute(self, topic: WatchedTopic, publisher: Publisher, time: float) -> None:
        """Mute a publisher, which need not publish; it begins anew when it does."""
        publisher.mute(time)
        self.touch(topic, publisher.name)

    def drop(self, topic: WatchedTopic, name: str) -> None:
        """Forget a publisher."""
        del topic.publishers[name]
        self.substitutes.retired.discard((topic.name, name))
        self.touch(topic, name)

    def drop_topic(self, name: str) -> None:
        """Watch a topic no more."""
        topic = self.topics[name]
        for publisher in list(topic.publishers):
            self.drop(topic, publisher)
        del self.topics[name]

    def forget_gone(self, topic: WatchedTopic) -> None:
        """Drop the publishers that are gone and missed by nobody: a healthy one is there."""
        gone = [p.name for p in topic.publishers.values() if not p.connected and p.name != NOBODY]
        for name in gone if topic.healthy() else ():
            if name not in topic.nodes:
                self.drop(topic, name)

    def _miss_no_more(self, topic: WatchedTopic, watched: Optional[WatchedService]) -> None:
        """Somebody provides a service: drop the publisher without a name.

        It stays if it stands for another service.
        """
        nobody = topic.publishers.get(NOBODY)
        if nobody is not None and (nobody.state is not FAILED or nobody.watched is watched):
            self.drop(topic, NOBODY)

    def touch(self, topic: WatchedTopic, publisher: str) -> None:
        """Have a row told: it has changed."""
        self._touched[topic.name, publisher] = None

    # For tests

    def validate(self) -> None:
        """Raise ShsaError if anything is as it must never be."""
        for topic in self.topics.values():
            self._validate_topic(topic)
        for topic, publisher in self.all():
            self._validate_publisher(topic, publisher)
        for key in self.substitutes.retired:
            _must(self.find(*key) is not None, f"{key} is retired, but not there")

    def _validate_topic(self, topic: WatchedTopic) -> None:
        _must(bool(topic.services), f"{topic.name} is watched for no service")
        _must(bool(topic.publishers), f"{topic.name} has no row")
        for watched in topic.services.values():
            come = watched.published or watched.service.event_driven and watched.appeared
            due = self.agenda.when(Grace(topic.name, watched.service.name))
            told = come or watched.overdue or not topic.subscribed
            _must(told or due < inf, f"nobody waits for {watched.service.name}")

    def _validate_publisher(self, topic: WatchedTopic, publisher: Publisher) -> None:
        where = f"{publisher.name or 'nobody'} on {topic.name}"
        state, watched = publisher.state, publisher.watched
        own = watched is None or topic.services.get(watched.service.name) is watched
        _must(own, f"{where} provides a service of another topic")
        _must((state is FAILED) == (publisher.kind is not None), f"{where} is {state} without why")
        _must(publisher.connected or state is not HEALTHY, f"{where} is gone, and healthy")
        _must(publisher.name != NOBODY or not publisher.connected, f"{where} is connected")
        due = self.agenda.when(Silence(topic.name, publisher.name))
        _must(due <= publisher.deadline, f"nobody looks at {where} when it is due")


def _never_good(publisher: Publisher, kind: Kind) -> bool:
    """Tell if a publisher does what it is blamed for since it was first seen."""
    if kind in (Kind.RATE_LOW, Kind.RATE_HIGH):
        return publisher.evidence is not None and not publisher.evidence.rate_was_good
    if kind is Kind.SILENT:
        return not publisher.steady
    return kind in BY_VALUE and publisher.last_good is None


def _must(holds: bool, otherwise: str) -> None:
    if not holds:
        raise ShsaError(f"the monitor's table is wrong: {otherwise}")
