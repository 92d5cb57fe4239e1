"""The table of substitutions as the monitor needs it, and who fills in for late messages."""
from collections import defaultdict
from math import inf
from typing import DefaultDict, Dict, Iterable, List, Optional, Set, Tuple

from shsa_core.model.substitution import Substitution, row_key
from shsa_core.monitoring.events import Key, SubstitutionsChanged, Told
from shsa_core.monitoring.settings import BRIDGES_APART, CHANGEOVER_S, TELL_S

Change = Tuple[str, Optional[Substitution], Optional[Substitution]]
"""A node, and its row before and now."""


class Substitutes:
    """The table of substitutions, and the substitutes that have left it but are connected still."""

    def __init__(self) -> None:
        self._rows: Dict[str, Substitution] = {}
        self._of_node: DefaultDict[str, Dict[str, Substitution]] = defaultdict(dict)
        self.retired: Set[Key] = set()

    def change(self, event: SubstitutionsChanged) -> List[Change]:
        """Take a change of the table; return which rows it changes."""
        new = {row_key(row): row for row in event.rows if row.node}  # the others are plans
        gone = list(self._rows) if event.whole else event.removed
        changes: List[Change] = []
        for key in [key for key in gone if key in self._rows and key not in new]:
            row = self._rows.pop(key)
            del self._of_node[row.node][key]
            changes.append((row.node, row, None))
        for key, row in new.items():
            before = self._rows.get(key)
            if before != row:
                changes.append((row.node, before, row))
            self._rows[key] = self._of_node[row.node][key] = row
        return changes

    def _row(self, topic: str, node: str) -> Optional[Substitution]:
        """Return the row of a node that has to do with a topic; None: the node is no substitute.

        An idle one, or one that publishes elsewhere, may have advertised this topic as well.
        """
        rows = self._of_node.get(node)
        if not rows:
            return None
        here = [row for row in rows.values() if topic in row.topics]
        return (here or [*rows.values()])[0]

    def service(self, topic: str, node: str) -> str:
        """Return the service whose place a node takes on a topic; empty: none."""
        row = self._row(topic, node)
        return row.service if row else ""

    def is_known(self, topic: str, node: str) -> bool:
        """Tell if the table names a node, or did until now."""
        return self._row(topic, node) is not None or (topic, node) in self.retired

    def written(self, topic: str, node: str) -> Optional[Set[str]]:
        """Return the fields that a substitute computes; None: it is none, or does so elsewhere."""
        row = self._row(topic, node)
        return {each.field for each in row.outputs} if row and topic in row.topics else None

    def bridging(self, topic: str, node: str) -> Optional[Substitution]:
        """Return the row of a muted substitute that may fill in on `topic`; None: it is none."""
        row = self._row(topic, node)
        fills_in = row is not None and row.bridge > 0.0 and not row.publishing
        return row if row is not None and fills_in and topic in row.topics else None

    def may_be_silent(self, topic: str, node: str) -> bool:
        """Tell if silence is no fault: of a muted substitute, or of one that is being stopped."""
        row = self._row(topic, node)
        return (topic, node) in self.retired or row is not None and not publishes(row, topic)

    def is_kept_back(self, topic: str, node: str) -> bool:
        """Tell if a gate keeps back for the time being what a substitute publishes."""
        row = self._row(topic, node)
        return row is not None and row.gated and topic in row.topics and not row.publishing


class Bridges:
    """The messages of muted substitutes. Times in s."""

    def __init__(self) -> None:
        self._counts: DefaultDict[str, int] = defaultdict(int)
        self._tell: Dict[str, float] = {}  # when the next one is told
        self._latest: Dict[Key, float] = {}

    def muted(self, key: Key, time: float) -> None:
        """Mute a substitute: what comes soon is for those whom it still serves."""
        self._latest[key] = time + CHANGEOVER_S

    def heard(self, key: Key, row: Substitution, time: float) -> Optional[Told]:
        """Count a bridge of a muted substitute; return what people are told of that now."""
        latest = self._latest.get(key, -inf)
        self._latest[key] = max(time, latest)
        if time - latest <= BRIDGES_APART * row.bridge:
            return None
        self._counts[row.service] += 1
        if time < self._tell.get(row.service, -inf):
            return None
        self._tell[row.service] = time + TELL_S
        count = self._counts[row.service]
        times = "once" if count == 1 else f"{count} times"
        what = f"{key[1]} has filled in for a late message, {times} so far"
        return Told(time, f"{key[0]}: {what}. This is no failure")

    def times(self, service: str) -> int:
        """Return how often a service was bridged so far."""
        return self._counts.get(service, 0)


def publishes(row: Optional[Substitution], topic: str) -> bool:
    """Tell if a substitute is to publish on `topic`."""
    return row is not None and row.publishing and topic in row.topics


def topics_of(rows: Iterable[Optional[Substitution]]) -> List[str]:
    """Return the topics of some rows, each once."""
    return list(dict.fromkeys(topic for row in rows if row for topic in row.topics))
