"""Which services an event concerns, so that a decision costs what it concerns."""
from typing import Dict, FrozenSet, Iterable, List, NamedTuple, Set, Tuple

from shsa_core.codegen.plans import Plan
from shsa_core.healing.planner import AnyPlan


class Computed(NamedTuple):
    """A service whose value is computed: without which node, and which plans were tried in vain."""

    faulty_node: str
    tried: FrozenSet[Plan]


class Indexes:
    """Services by what they read and wait for, kept up as they decide.

    `stuck`: those that nothing can heal now. `kept`: those whose faulty node is kept. `computed`:
    those that a substitute computes, or is to.
    """

    def __init__(self) -> None:
        self.stuck: Dict[str, None] = {}
        self.kept: Dict[str, None] = {}
        self.computed: Dict[str, Computed] = {}
        self.working: Dict[str, Tuple[float, AnyPlan]] = {}
        self.refused: Dict[str, str] = {}
        self._reads: Dict[str, Tuple[str, ...]] = {}
        self._readers: Dict[str, Set[str]] = {}

    def readers(self, services: Iterable[str]) -> List[str]:
        """Return the services whose substitute reads one of some services."""
        return sorted({name for each in services for name in self._readers.get(each, ())})

    def follow(self, name: str, reads: Tuple[str, ...]) -> None:
        """Note what the substitute of a service reads now."""
        for read in self._reads.get(name, ()):
            self._readers[read].discard(name)
        self._reads[name] = reads
        for read in reads:
            self._readers.setdefault(read, set()).add(name)
