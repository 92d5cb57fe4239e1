"""Keeps up the table of health: who publishes what, how each is doing, and what changed."""
from math import inf
from typing import Callable, Dict, Iterable, Iterator, List, Optional, Tuple, Union

from shsa_core.agenda import Agenda
from shsa_core.backlog import Backlog
from shsa_core.model.checks import BY_VALUE
from shsa_core.model.health import Key, PublisherHealth, PublisherState
from shsa_core.model.kinds import Kind
from shsa_core.model.log import Level, Log
from shsa_core.model.service import Service
from shsa_core.model.substitution import Substitution, row_key
from shsa_core.monitoring.events import Command, HealthChanged, SubstitutionsChanged
from shsa_core.monitoring.publishers import (
    NOBODY,
    Publisher,
    WatchedService,
    WatchedTopic,
    without_numbers,
)
from shsa_core.monitoring.settings import BRIDGES_APART, RECONNECT_S

UNKNOWN, HEALTHY, FAILED = PublisherState.UNKNOWN, PublisherState.HEALTHY, PublisherState.FAILED

Due = Union[Publisher, WatchedService]
"""A publisher may have been silent for too long, or nobody was there for a service in time."""
Change = Tuple[str, Optional[Substitution], Optional[Substitution]]
"""A node, and its row of the table of substitutions before and now."""

NEVER_GOOD = "it was never good by these numbers: the SOM may be wrong, and not the node"


class Substitutes:
    """The rows of the table of substitutions, by their nodes."""

    def __init__(self) -> None:
        self._rows: Dict[str, Substitution] = {}
        self._of_node: Dict[str, Dict[str, Substitution]] = {}

    def change(self, event: SubstitutionsChanged) -> List[Change]:
        """Take a change of the table; return which rows it changes."""
        new = {row_key(row): row for row in event.rows if row.node}  # the others are plans
        gone = list(self._rows) if event.whole else event.removed
        changes: List[Change] = []
        for key in [key for key in gone if key in self._rows and key not in new]:
            row = self._rows.pop(key)
            del self._of_node[row.node][key]
            if not self._of_node[row.node]:
                del self._of_node[row.node]
            changes.append((row.node, row, None))
        for key, row in new.items():
            before = self._rows.get(key)
            if before != row:
                changes.append((row.node, before, row))
            self._rows[key] = self._of_node.setdefault(row.node, {})[key] = row
        return changes

    def row(self, topic: str, node: str) -> Optional[Substitution]:
        """Return the row of a node that has to do with a topic; None: the node is no substitute.

        An idle one, or one that publishes elsewhere, may have advertised this topic as well.
        """
        rows = self._of_node.get(node, {}).values()
        return next((row for row in rows if topic in row.topics), next(iter(rows), None))


class Board:
    """The watched topics with their publishers, as of `now`, in s, and every change of them.

    `ours`: make a moment by which publishers are judged one of our clock, as rows have it.
    """

    def __init__(self, ours: Callable[[float], float]) -> None:
        self.ours = ours
        self.now = -inf
        self.topics: Dict[str, WatchedTopic] = {}
        self.substitutes = Substitutes()
        self.agenda: Agenda[Due] = Agenda()
        self._failed: List[PublisherHealth] = []
        self._said: List[Command] = []
        self._touched: Dict[Key, None] = {}

    def all(self) -> Iterator[Publisher]:
        """Yield every publisher."""
        for topic in self.topics.values():
            yield from topic.publishers.values()

    def find(self, topic: str, name: str) -> Optional[Publisher]:
        """Return a publisher; None if there is none of that name."""
        found = self.topics.get(topic)
        return found.publishers.get(name) if found else None

    def is_there(self, service: Service) -> bool:
        """Tell if the own node of a service is healthy, and has told something."""
        node = self.find(service.topic, service.node)
        return node is not None and node.is_healthy and node.last_good is not None

    def say(self, commands: Iterable[Command]) -> None:
        """Say something beside the rows that have changed."""
        self._said += commands

    def warn(self, text: str) -> None:
        """Warn people."""
        self.say([Log(Level.WARN, text)])

    def commands(self) -> List[Command]:
        """Return the changed rows, and what else is said, since the last call."""
        commands, self._said = self._said, []
        if self._touched:
            found = {key: self.find(*key) for key in self._touched}
            rows = tuple(each.row(self.ours) for each in found.values() if each)
            removed = tuple(key for key, publisher in found.items() if not publisher)
            failed = tuple(self._failed)
            commands.insert(0, HealthChanged(self.ours(self.now), rows, removed, failed))
        self._failed, self._touched = [], {}
        return commands

    # Who is who

    def watched_of(self, topic: WatchedTopic, publisher: str) -> WatchedService:
        """Return the service that a publisher provides."""
        row = self.substitutes.row(topic.name, publisher)
        return topic.service_of(publisher, row.service if row else "")

    def substitution(self, publisher: Publisher) -> Optional[Substitution]:
        """Return its row in the table of substitutions; None: it is no substitute."""
        return self.substitutes.row(*publisher.key)

    def is_substitute(self, publisher: Publisher) -> bool:
        """Tell if the table of substitutions names a publisher, or did until now."""
        return publisher.retired or self.substitution(publisher) is not None

    def is_replaced(self, publisher: Publisher) -> bool:
        """Tell if a substitute publishes in place of the node of a service."""
        topic, name = publisher.topic, publisher.service.name
        rows = map(self.substitution, topic.publishers.values())
        return any(publishes(row, topic.name) and row.service == name for row in rows if row)

    def is_named(self, publisher: Publisher) -> bool:
        """Tell if the SOM or the table of substitutions names a publisher, or did until now."""
        return publisher.name in publisher.topic.nodes or self.is_substitute(publisher)

    def may_be_silent(self, publisher: Publisher) -> bool:
        """Tell if it is a substitute that need not publish here: a muted one, or a retired one."""
        row = self.substitution(publisher)
        silent = row is not None and not publishes(row, publisher.topic.name)
        return publisher.retired or silent

    # Changes

    def look_when_due(self, publisher: Publisher) -> None:
        """Have a publisher looked at once its silence is due."""
        self.agenda.bring_forward(publisher, publisher.deadline)

    def is_heard(self, publisher: Publisher) -> bool:
        """Tell if a message of a publisher counts: no muted substitute fills in, or is kept back.

        Once the original has failed none fills in: it may know sooner that it took over.
        """
        row, topic = self.substitution(publisher), publisher.topic
        if row is None or row.publishing or topic.name not in row.topics:
            return True
        watched = topic.services.get(row.service)
        original = topic.publishers.get(watched.service.node) if watched else None
        bridges = row.bridge > 0.0 and (original is None or original.state is not FAILED)
        if bridges and watched is not None:
            watched.bridged += self.now - publisher.filled_in > BRIDGES_APART * row.bridge
            publisher.filled_in = max(self.now, publisher.filled_in)
        return not (bridges or row.gated)

    def meet(self, topic: WatchedTopic, name: str, uri: str = "") -> Publisher:
        """Put a new publisher in place of an old one of that name."""
        publisher = Publisher(topic, name, self.now, self.watched_of(topic, name), uri=uri)
        topic.publishers[name] = publisher
        if self.now <= topic.heard_from + RECONNECT_S:
            topic.there.add(name)
        self.touch(publisher)
        self._miss_no_more(topic, publisher.watched)
        self.notice(publisher)
        return publisher

    def notice(self, publisher: Publisher) -> None:
        """Note that a publisher is connected: all that an event-driven service asks of its node."""
        watched = publisher.watched
        if not publisher.connected or self.may_be_silent(publisher):
            return
        if watched.service.event_driven:
            watched.come(publisher.name)
        if publisher.last_heard is None:
            named = publisher.name == watched.service.node
            if watched.service.event_driven and named and publisher.state is UNKNOWN:
                self.become_healthy(publisher)
            elif not watched.service.event_driven and publisher.state is HEALTHY:
                self.mute(publisher)

    def expect(self, topic: WatchedTopic, name: str = NOBODY) -> Publisher:
        """Return the publisher that should be there, and is not connected."""
        nobody = topic.publishers.get(NOBODY)
        if nobody is not None and name:
            self.drop(nobody)
        if nobody is None or name:
            watched = self.watched_of(topic, name) if name else topic.unknown
            topic.publishers[name] = Publisher(topic, name, self.now, watched, connected=False)
        self.touch(topic.publishers[name])
        return topic.publishers[name]

    def fail(self, publisher: Publisher, kind: Kind, detail: str) -> None:
        """Fail a publisher."""
        if _never_good(publisher, kind):
            detail = f"{detail}; {NEVER_GOOD}"
        publisher.become(self.now, FAILED, kind, detail)
        self._failed.append(publisher.row(self.ours))
        self.touch(publisher)

    def note(self, publisher: Publisher, detail: str, log: bool = False) -> None:
        """Tell why one is not blamed, or what is unusual, or nothing; `log`: people too, once."""
        if publisher.detail != detail:
            publisher.detail = detail
            self.touch(publisher)
        if log and not publisher.was_logged:
            publisher.logged.add(without_numbers(detail))
            self.warn(f"{publisher.topic.name}: {publisher.name}: {detail}")

    def become_healthy(self, publisher: Publisher) -> None:
        """Find a publisher healthy."""
        publisher.become(self.now, HEALTHY)
        self.look_when_due(publisher)
        self.touch(publisher)
        self._miss_no_more(publisher.topic, publisher.watched)
        self.forget_gone(publisher.topic)

    def mute(self, publisher: Publisher) -> None:
        """Mute a publisher, which need not publish: it begins anew once it does."""
        publisher.become(self.now, UNKNOWN)
        publisher.begin_anew()
        publisher.first_message = publisher.last_heard = publisher.silent_since = None
        publisher.evidence.backlog = Backlog()
        self.touch(publisher)

    def drop(self, publisher: Publisher) -> None:
        """Forget a publisher."""
        del publisher.topic.publishers[publisher.name]
        self.touch(publisher)

    def forget_gone(self, topic: WatchedTopic) -> None:
        """Drop the publishers that are gone and missed by nobody: a healthy one is there."""
        gone = [p for p in topic.publishers.values() if not p.connected and p.name != NOBODY]
        for publisher in gone if topic.healthy() else ():
            if publisher.name not in topic.nodes:
                self.drop(publisher)

    def _miss_no_more(self, topic: WatchedTopic, watched: WatchedService) -> None:
        """Drop the publisher without a name, unless it stands for another service."""
        nobody = topic.publishers.get(NOBODY)
        if nobody is not None and (nobody.state is not FAILED or nobody.watched is watched):
            self.drop(nobody)

    def touch(self, publisher: Publisher) -> None:
        """Have a row told: it has changed."""
        self._touched[publisher.key] = None


def _never_good(publisher: Publisher, kind: Kind) -> bool:
    """Tell if a publisher does what it is blamed for since it was first seen."""
    if kind in (Kind.RATE_LOW, Kind.RATE_HIGH):
        return not publisher.evidence.rate_was_good
    if kind is Kind.SILENT:
        return not (publisher.steady or publisher.service.event_driven)
    return kind in BY_VALUE and publisher.last_good is None


def publishes(row: Optional[Substitution], topic: str) -> bool:
    """Tell if a substitute is to publish on `topic`."""
    return row is not None and row.publishing and topic in row.topics
