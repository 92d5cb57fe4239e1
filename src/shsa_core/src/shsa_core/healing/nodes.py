"""What the reconfigurator knows of the nodes: how they do as publishers, and what it has done to them."""
from math import inf
from typing import Dict, Optional, Set, Tuple

from shsa_core.healing.events import FailureSeen, HealthSeen, PublisherHealth


class Nodes:
    """The monitor's newest table, and which nodes were killed or started again since.

    `substitutes`: the names of all substitutes that ever were.
    """

    def __init__(self) -> None:
        self.substitutes: Set[str] = set()
        self._health: Dict[Tuple[str, str], PublisherHealth] = {}
        self._made = -inf
        self._killing: Set[str] = set()
        self._killed: Dict[str, float] = {}
        self._restarting: Set[str] = set()

    def heed(self, table: HealthSeen) -> bool:
        """Take over a table of the monitor; False: it is older than the last one."""
        if table.made < self._made:
            return False
        self._made = table.made
        self._health = {(row.topic, row.publisher): row for row in table.publishers}
        for row in table.publishers:
            if row.state == "healthy" and row.since > self._killed.get(row.publisher, row.since):
                del self._killed[row.publisher]
                self._restarting.discard(row.publisher)
        return True

    def note(self, failure: FailureSeen) -> None:
        """Note a failure that the table does not tell yet."""
        topic, node = failure.topic, failure.publisher
        row = self._health.get((topic, node))
        if row is None or row.since < failure.time:
            kind, detail, last_good = failure.kind, failure.detail, failure.last_good
            self._health[topic, node] = PublisherHealth(
                topic, node, "failed", failure.time, None, last_good, kind, detail
            )

    def health(self, topic: str, node: str) -> Optional[PublisherHealth]:
        """How `node` does on `topic`."""
        return self._health.get((topic, node))

    def originals(self, topic: str) -> Tuple[PublisherHealth, ...]:
        """How the publishers of `topic` do that are not substitutes."""
        rows = (row for row in self._health.values() if row.topic == topic)
        return tuple(r for r in rows if r.publisher and r.publisher not in self.substitutes)

    @property
    def excluded(self) -> Set[str]:
        """The nodes that are being killed, or were and have not been well since."""
        return self._killing | set(self._killed)

    def begin_kill(self, node: str) -> bool:
        """Whether `node` is to be killed now: it is not if that is under way."""
        if not node or node in self._killing:
            return False
        self._killing.add(node)
        return True

    def end_kill(self, node: str, time: float) -> None:
        """The kill of `node` is over."""
        self._killing.discard(node)
        self._restarting.discard(node)
        self._killed[node] = time

    def dying(self, node: str) -> bool:
        """Whether the kill of `node` is under way."""
        return node in self._killing

    def begin_restart(self, node: str) -> bool:
        """Whether `node` is to be started again now: it is not if that is under way."""
        if node in self._restarting:
            return False
        self._restarting.add(node)
        return True

    def end_restart(self, node: str) -> None:
        """The restart of `node` has failed."""
        self._restarting.discard(node)
