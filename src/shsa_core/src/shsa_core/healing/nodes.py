"""What the reconfigurator knows of the nodes: their health, and what it has done to them."""
from dataclasses import replace
from typing import Collection, Dict, FrozenSet, Iterable, List, Optional, Set, Tuple

from shsa_core.agenda import Agenda
from shsa_core.healing.events import Command, FailureSeen, HealthSeen, LearnNode, NodeLearned
from shsa_core.model.kinds import Kind
from shsa_core.model.names import RecentNames
from shsa_core.monitoring.events import PublisherHealth, PublisherState

LEARN_PAUSES_S = (0.5, 2.0, 10.0)
"""Before each further try to learn which process a node is: a busy one may not answer at once.

The last one comes again and again: a node that is not known cannot be ended when it hangs.
"""

MONITOR_START_S = 5.0
"""How long a monitor that has just started may take to hear those who were well before."""

NOBODY: Dict[str, PublisherHealth] = {}


class Nodes:
    """The monitors' tables, and which nodes were killed or started again since.

    `substitutes`: the names of substitutes that run, or did not long ago. `excluded`: the nodes
    that were killed and have not been well since. `protected`: those that are never killed unless
    the SOM says so, and why. `verified`: those whose process is known.
    """

    def __init__(self) -> None:
        self.substitutes = RecentNames()
        self.excluded: FrozenSet[str] = frozenset()
        self.protected: Dict[str, str] = {}
        self.verified: Set[str] = set()
        self._health: Dict[str, Dict[str, PublisherHealth]] = {}
        self._told_at: Dict[Tuple[str, str], str] = {}  # the host of the monitor that tells
        self._lost: Set[str] = set()  # the hosts whose monitors are not heard
        self._stranded: Set[Tuple[str, str]] = set()  # who did well when its monitor was lost
        self._topics: Dict[str, Set[str]] = {}
        self._good: Set[Tuple[str, str]] = set()
        self._killed: Dict[str, float] = {}
        self._restarting: Set[str] = set()
        self._unheard: Dict[Tuple[str, str], Optional[PublisherHealth]] = {}
        self._unheard_until: Optional[float] = None

    @property
    def deadline(self) -> Optional[float]:
        """When `unheard` has something to tell, in s; None: never."""
        return self._unheard_until

    def unheard(self, time: float) -> Optional[HealthSeen]:
        """What is so for those whom a new monitor has not heard in time."""
        if self._unheard_until is None or time < self._unheard_until:
            return None
        told, self._unheard, self._unheard_until = self._unheard, {}, None
        rows = tuple(row for row in told.values() if row is not None)
        return HealthSeen(time, rows, tuple(key for key, row in told.items() if row is None))

    def heed(self, change: HealthSeen) -> List[Tuple[str, str]]:
        """Take over what has changed in a monitor's table; the rows of other monitors stay.

        Returns the topics and publishers that it concerns. Who was well when the monitor ended is
        so until the next one has heard it, or should have.
        """
        self._lost.discard(change.host)
        if change.anew:
            self._unheard_until = change.time + MONITOR_START_S
            for key in self._told(change.host):
                if self._health[key[0]][key[1]].state is PublisherState.HEALTHY:
                    self._unheard[key] = None
        change = self._returned(self._heard(change))
        concerned = [(row.topic, row.publisher) for row in change.rows]
        gone = list(change.removed)
        if change.whole:
            told = set(concerned)
            known = self._told(change.host)
            gone = [key for key in known if key not in told and key not in self._unheard]
        for topic, publisher in gone:
            self._forget(topic, publisher)
        for row in change.rows:
            self._put(row)
            self._told_at[row.topic, row.publisher] = change.host
            if row.state is PublisherState.HEALTHY and self._has_recovered(row):
                concerned += [(topic, row.publisher) for topic in self.topics(row.publisher)]
        return concerned + gone

    def _told(self, host: str) -> List[Tuple[str, str]]:
        """The topics and publishers of which a monitor tells; what was only recalled is any's."""
        known = [(t, p) for t, publishers in self._health.items() for p in publishers]
        return [key for key in known if self._told_at.get(key, host) == host]

    def _heard(self, change: HealthSeen) -> HealthSeen:
        """A change without those of whom a new monitor knows nothing yet."""
        if not self._unheard:
            return change
        rows = []
        for row in change.rows:
            key = (row.topic, row.publisher)
            if key in self._unheard and row.state is PublisherState.UNKNOWN:
                self._unheard[key] = row
            else:
                self._unheard.pop(key, None)
                rows.append(row)
        for key in change.removed:
            self._unheard.pop(key, None)
        return replace(change, rows=tuple(rows))

    def has_monitor(self, host: str) -> bool:
        """Whether a monitor of a computer has told of anybody."""
        return host in self._told_at.values()

    def lose_monitor(
        self, time: float, host: str, why: str, elsewhere: Collection[str]
    ) -> List[Tuple[str, str]]:
        """The monitor of a computer is lost: nobody says any more that those do well it watched.

        They count as silent, but for substitutes that run `elsewhere`. Returns the topics and
        publishers that it concerns.
        """
        self._lost.add(host)
        lost = [
            key
            for key, told in self._told_at.items()
            if told == host and key[1] not in elsewhere and self.healthy(*key)
        ]
        self.strand(time, lost, why)
        return lost

    def strand(self, time: float, keys: Iterable[Tuple[str, str]], why: str) -> None:
        """Nobody can say whether some do well; they count as silent."""
        for topic, publisher in keys:
            row = self._health[topic][publisher]
            failed, kind = PublisherState.FAILED, Kind.SILENT
            self._put(replace(row, state=failed, since=time, kind=kind, detail=why))
            self._stranded.add((topic, publisher))

    def watched(self, topic: str, away: bool) -> bool:
        """Whether the monitors of a topic are heard, as far as is known.

        `away`: its computer is not heard; then nobody does who has not told of it yet.
        """
        keys = ((topic, publisher) for publisher in self.health(topic))
        told = {self._told_at[key] for key in keys if key in self._told_at}
        return not told & self._lost if told else not away

    def doubt(self, topic: str, publisher: str) -> None:
        """One was silent before we started: if a monitor tells that it does well, it does now."""
        self._stranded.add((topic, publisher))

    def _returned(self, change: HealthSeen) -> HealthSeen:
        """A change in which those who do well are back whose monitor was lost: since now."""
        if not self._stranded:
            return change
        rows = []
        for row in change.rows:
            if row.key in self._stranded and row.state is PublisherState.HEALTHY:
                before = self.health(row.topic).get(row.publisher)
                later = before is not None and row.since > before.since
                row = row if later else replace(row, since=change.time)
            rows.append(row)
        self._stranded.difference_update(row.key for row in rows)
        return replace(change, rows=tuple(rows))

    def healthy(self, topic: str, publisher: str) -> Optional[PublisherHealth]:
        """The row of a publisher that does well; None if it does not."""
        row = self.health(topic).get(publisher)
        return row if row is not None and row.state is PublisherState.HEALTHY else None

    def recall(self, time: float, rows: Iterable[PublisherHealth]) -> None:
        """These did well when a former reconfigurator ended.

        They do so until the monitor has told of them, or should have.
        """
        for row in rows:
            self._put(row)
            self._unheard[row.topic, row.publisher] = None
            self._unheard_until = time + MONITOR_START_S

    def note(self, failure: FailureSeen) -> None:
        """Note a failure that the table does not tell yet."""
        row = self.health(failure.topic).get(failure.publisher)
        if row is None or row.since < failure.time:
            self._put(
                PublisherHealth(
                    failure.topic,
                    failure.publisher,
                    PublisherState.FAILED,
                    failure.time,
                    None,
                    failure.last_good,
                    failure.kind,
                    failure.detail,
                )
            )

    def health(self, topic: str) -> Dict[str, PublisherHealth]:
        """How the publishers of `topic` do."""
        return self._health.get(topic, NOBODY)

    def was_good(self, topic: str, node: str) -> bool:
        """Whether a node has ever published a topic well, in this process or a former one."""
        return (topic, node) in self._good

    def note_good(self, topic: str, node: str) -> None:
        """A node has published a topic well."""
        self._good.add((topic, node))

    def topics(self, node: str) -> Tuple[str, ...]:
        """The topics that `node` publishes."""
        return tuple(sorted(self._topics.get(node, ())))

    def learned(self, event: NodeLearned) -> None:
        """It was looked which process a node is."""
        if event.known:
            self.verified.add(event.node)
        if event.protected:
            self.protected[event.node] = event.protected
        elif event.known:
            self.protected.pop(event.node, None)

    def killed(self, node: str, time: float) -> None:
        """`node` was gone at `time`; if it is well since, that is another process."""
        self.protected.pop(node, None)
        self.verified.discard(node)
        self._restarting.discard(node)
        self._killed[node] = time
        self.excluded = frozenset(self._killed)
        for topic in self.topics(node):
            row = self._health[topic][node]
            if row.state is PublisherState.HEALTHY and self._has_recovered(row):
                return

    def _forget(self, topic: str, publisher: str) -> None:
        self._health.get(topic, {}).pop(publisher, None)
        self._told_at.pop((topic, publisher), None)
        self._stranded.discard((topic, publisher))
        topics = self._topics.get(publisher, set())
        topics.discard(topic)
        if not topics:
            self._topics.pop(publisher, None)
            self.verified.discard(publisher)
        if publisher in self.substitutes:
            self._good.discard((topic, publisher))  # its name is not used again

    def begin_restart(self, node: str) -> bool:
        """Whether `node` is to be started again now: it is not if that is under way."""
        if node in self._restarting:
            return False
        self._restarting.add(node)
        return True

    def end_restart(self, node: str) -> None:
        """The restart of `node` has failed."""
        self._restarting.discard(node)

    def _put(self, row: PublisherHealth) -> None:
        self._health.setdefault(row.topic, {})[row.publisher] = row
        if row.state is PublisherState.HEALTHY or row.last_good is not None:
            self._good.add((row.topic, row.publisher))
        if row.kind is Kind.NODE_GONE:
            self.verified.discard(row.publisher)
        if row.publisher:
            self._topics.setdefault(row.publisher, set()).add(row.topic)

    def _has_recovered(self, row: PublisherHealth) -> bool:
        """Whether a healthy publisher counts again, after it was killed."""
        if row.since <= self._killed.get(row.publisher, row.since):
            return False
        del self._killed[row.publisher]
        self.excluded = frozenset(self._killed)
        self._restarting.discard(row.publisher)
        return True


class Acquaintance:
    """Which processes the nodes are.

    They are learned while they are healthy, once each time that they come up.
    """

    def __init__(self) -> None:
        self._tries: Dict[str, int] = {}
        self._topics: Dict[str, str] = {}
        self._agenda: Agenda[str] = Agenda()

    @property
    def deadline(self) -> Optional[float]:
        """When a further try is due, in s; None: none is."""
        return self._agenda.next()

    def came_up(self, node: str, topic: str) -> List[Command]:
        """`node` is healthy on a topic: it is learned, unless it is known."""
        if node in self._tries:
            return []
        self._tries[node] = 0
        self._topics[node] = topic
        return [LearnNode(node, topic)]

    def learned(self, event: NodeLearned) -> None:
        """A try is over; the next one follows after a pause if it failed."""
        tries = self._tries.get(event.node)
        if not event.known and tries is not None:
            self._tries[event.node] = min(tries + 1, len(LEARN_PAUSES_S) - 1)
            self._agenda.set(event.node, event.time + LEARN_PAUSES_S[tries])

    def went(self, node: str) -> None:
        """`node` is gone: what comes up under its name is another process."""
        if self._tries.pop(node, None) is not None:
            self._agenda.set(node, None)

    def tick(self, time: float) -> List[Command]:
        """Time passed: try again."""
        return [LearnNode(node, self._topics[node]) for node in self._agenda.pop_due(time)]
