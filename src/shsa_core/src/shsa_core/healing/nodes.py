"""What the reconfigurator knows of the nodes: their health, and what it has done to them."""
from typing import Dict, FrozenSet, List, Optional, Set, Tuple

from shsa_core.agenda import Agenda
from shsa_core.healing.events import Command, FailureSeen, HealthSeen, LearnNode, NodeLearned
from shsa_core.monitoring.events import PublisherHealth, PublisherState

LEARN_PAUSES_S = (0.5, 2.0)
"""Before each further try to learn which process a node is: a busy one may not answer at once."""

NOBODY: Dict[str, PublisherHealth] = {}


class Nodes:
    """The monitor's table, and which nodes were killed or started again since.

    `substitutes`: the names of all substitutes that ever were. `excluded`: the nodes that were
    killed and have not been well since.
    """

    def __init__(self) -> None:
        self.substitutes: Set[str] = set()
        self.excluded: FrozenSet[str] = frozenset()
        self._health: Dict[str, Dict[str, PublisherHealth]] = {}
        self._topics: Dict[str, Set[str]] = {}
        self._killed: Dict[str, float] = {}
        self._restarting: Set[str] = set()

    def heed(self, change: HealthSeen) -> List[Tuple[str, str]]:
        """Take over what has changed in the monitor's table.

        Returns the topics and publishers that it concerns.
        """
        concerned = [(row.topic, row.publisher) for row in change.rows]
        gone = list(change.removed)
        if change.whole:
            told = set(concerned)
            known = [(t, p) for t, publishers in self._health.items() for p in publishers]
            gone = [key for key in known if key not in told]
        for topic, publisher in gone:
            self._health.get(topic, {}).pop(publisher, None)
            self._topics.get(publisher, set()).discard(topic)
        for row in change.rows:
            self._put(row)
            if row.state is PublisherState.HEALTHY and self._has_recovered(row):
                concerned += [(topic, row.publisher) for topic in self.topics(row.publisher)]
        return concerned + gone

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

    def topics(self, node: str) -> Tuple[str, ...]:
        """The topics that `node` publishes."""
        return tuple(sorted(self._topics.get(node, ())))

    def killed(self, node: str, time: float) -> None:
        """`node` was gone at `time`; if it is well since, that is another process."""
        self._restarting.discard(node)
        self._killed[node] = time
        self.excluded = frozenset(self._killed)
        for topic in self.topics(node):
            row = self._health[topic][node]
            if row.state is PublisherState.HEALTHY and self._has_recovered(row):
                return

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
        self._agenda: Agenda[str] = Agenda()

    @property
    def deadline(self) -> Optional[float]:
        """When a further try is due, in s; None: none is."""
        return self._agenda.next()

    def came_up(self, time: float, node: str) -> List[Command]:
        """`node` is healthy on a topic: it is learned, unless it is known."""
        if node in self._tries:
            return []
        self._tries[node] = 0
        return [LearnNode(node)]

    def learned(self, event: NodeLearned) -> None:
        """A try is over; the next one follows after a pause if it failed."""
        tries = self._tries.get(event.node)
        if not event.known and tries is not None and tries < len(LEARN_PAUSES_S):
            self._tries[event.node] = tries + 1
            self._agenda.set(event.node, event.time + LEARN_PAUSES_S[tries])

    def went(self, node: str) -> None:
        """`node` is gone: what comes up under its name is another process."""
        if self._tries.pop(node, None) is not None:
            self._agenda.set(node, None)

    def tick(self, time: float) -> List[Command]:
        """Time passed: try again."""
        return [LearnNode(node) for node in self._agenda.pop_due(time)]
