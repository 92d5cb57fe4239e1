"""Which services a decision concerns."""
from typing import Dict, FrozenSet, Iterable, List, Optional, Set, Tuple

from shsa_core.codegen.plans import Plan
from shsa_core.healing.incident import STUCK, SUBSTITUTED, Incident, State


class Indexes:
    """Services by what they read and wait for, kept up as they decide.

    `healing`: those with an incident. `stuck`: those that nothing can heal now, or not with all
    values. `kept`: those whose faulty node is kept. `computed`: those that a substitute computes,
    or is to: without which node, and which plans were tried in vain.
    """

    def __init__(self) -> None:
        self.stuck: Dict[str, None] = {}
        self.kept: Dict[str, None] = {}
        self.healing: Dict[str, None] = {}
        self.computed: Dict[str, Tuple[str, FrozenSet[Plan]]] = {}
        self.refused: Dict[str, str] = {}
        self._reads: Dict[str, Dict[str, None]] = {}
        self._readers: Dict[str, Set[str]] = {}

    def readers(self, services: Iterable[str]) -> List[str]:
        """Return the services whose substitute reads one of some services."""
        return sorted({name for each in services for name in self._readers.get(each, ())})

    def follow(
        self, incident: Incident, name: str, plan: Optional[Plan], tried: FrozenSet[Plan]
    ) -> None:
        """Note how a service has decided, and what its substitute reads now."""
        self.stuck.pop(name, None)
        self.kept.pop(name, None)
        self.healing.pop(name, None)
        self.computed.pop(name, None)
        sources = plan.inputs if plan else ()
        for read in self._reads.get(name, ()):
            self._readers[read].discard(name)
        self._reads[name] = {each.service.name: None for each in sources}
        for read in self._reads[name]:
            self._readers.setdefault(read, set()).add(name)
        if incident.state is not State.WELL:
            self.healing[name] = None
        if incident.state in STUCK or (plan and plan.left_out):
            self.stuck[name] = None
        if incident.state is State.KEPT or incident.kept:
            self.kept[name] = None
        if incident.state in SUBSTITUTED:
            self.computed[name] = incident.faulty_node, tried
