"""Whom an event concerns: the services that a node, a process or another service has to do with."""
from typing import Dict, Iterable, List, Optional, Set, Tuple

from shsa_core.codegen.plans import Plan
from shsa_core.healing.incident import Incident, State
from shsa_core.healing.judgement import STUCK
from shsa_core.healing.topic import TopicHealing


class Concern:
    """Indexes of healings, kept up as they decide.

    `by_process`: the services that the substitutes in a process work for. `stuck`: those that
    nothing can heal now. `kept`: those whose faulty node is kept.
    """

    def __init__(self) -> None:
        self.by_process: Dict[str, Dict[str, None]] = {}
        self.stuck: Dict[str, None] = {}
        self.kept: Dict[str, None] = {}
        self._refusing: Dict[str, str] = {}
        self._reads: Dict[str, Tuple[str, ...]] = {}
        self._readers: Dict[str, Set[str]] = {}
        self._faulty: Dict[str, Set[str]] = {}

    @property
    def kept_out(self) -> Set[str]:
        """The nodes that may not return."""
        return set(self._refusing.values())

    def served(self, process: str) -> Tuple[str, ...]:
        """The services that the substitutes in a process work for."""
        return tuple(self.by_process.get(process, ()))

    @property
    def substituted(self) -> List[str]:
        """The services that have a substitute."""
        return sorted(name for served in self.by_process.values() for name in served)

    def readers(self, services: Iterable[str]) -> List[str]:
        """The services whose substitute reads one of some services."""
        return sorted({name for each in services for name in self._readers.get(each, ())})

    def blaming(self, node: str) -> List[str]:
        """The services whose incident blames a node."""
        return sorted(self._faulty.get(node, ()))

    def follow(self, healing: TopicHealing, before: Optional[Incident], node: str) -> None:
        """A healing has decided; `before` and `node` were its incident and substitute's node."""
        name, incident = healing.service, healing.incident
        self._refusing.pop(name, None)
        if incident is not None and healing.refuses:
            self._refusing[name] = incident.faulty_node
        if before is not None:
            self._faulty.get(before.faulty_node, set()).discard(name)
        if incident is not None:
            self._faulty.setdefault(incident.faulty_node, set()).add(name)
        served = self.by_process.get(node, {})
        served.pop(name, None)
        if not served:
            self.by_process.pop(node, None)
        if healing.node:
            self.by_process.setdefault(healing.node, {})[name] = None
        self.stuck.pop(name, None)
        if healing.state in STUCK:
            self.stuck[name] = None
        self.kept.pop(name, None)
        if healing.state is State.KEPT or (incident is not None and incident.kept):
            self.kept[name] = None
        for read in self._reads.get(name, ()):
            self._readers[read].discard(name)
        plan = healing.substitute.plan
        reads = plan.inputs if isinstance(plan, Plan) else ()
        self._reads[name] = tuple(dict.fromkeys(source.service.name for source in reads))
        for read in self._reads[name]:
            self._readers.setdefault(read, set()).add(name)
