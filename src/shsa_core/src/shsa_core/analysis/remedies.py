"""Which one new sensor or relation would let a robot survive more failures."""
from math import comb
from typing import Collection, Dict, FrozenSet, List, Optional, Sequence, Set, Tuple

from shsa_core.analysis.fragility import AS_IT_IS, Fragility
from shsa_core.analysis.report import Suggestion, Survival, ServiceReport
from shsa_core.model.ontology import Ontology
from shsa_core.model.som import Som

CANDIDATES = 50  # properties for which a new sensor or relation is considered
FINALISTS = 3  # of them, those whose effect on failures of two nodes is worked out
SMALL = 10**6  # needed services times functions, up to which that is done


Remedy = Tuple[
    str, Optional[str]
]  # a property, and the input of a new relation; None: a new sensor


class Remedies:
    """New sensors, each on a node of its own, and new relations with one input.

    They give what the needed services lack.
    """

    def __init__(
        self,
        ontology: Ontology,
        som: Som,
        fragility: Fragility,
        services: Collection[ServiceReport],
    ) -> None:
        self._ontology = ontology
        self._som = som
        self._fragility = fragility
        self._services = services
        weights: Dict[str, int] = {}
        own: Set[str] = set()
        for service in services:
            weight = sum(len(som) if len(cut) == 1 else 1 for cut in service.cuts)
            own.update(service.properties)
            for name in {*service.properties, *service.missing} if weight else ():
                weights[name] = weights.get(name, 0) + weight
        wanted = sorted(weights, key=lambda name: (-weights[name], name not in own, name))
        self._wanted = wanted[:CANDIDATES]
        # The bits of the nodes whose services want a property.
        self._hosts = dict.fromkeys(self._wanted, 0)
        for service in services:
            for name in self._hosts.keys() & {*service.properties, *service.missing}:
                if service.cuts:
                    self._hosts[name] |= fragility.bit(service.node)

    def sensors(self) -> List[Remedy]:
        """A new sensor for each property that is wanted most."""
        return [(name, None) for name in self._wanted]

    def relations(self) -> List[Remedy]:
        """A new relation for each property that is wanted most."""
        pairs = [(name, self._source(name)) for name in self._wanted]
        return [pair for pair in pairs if pair[1] is not None]

    def _source(self, name: str) -> Optional[str]:
        """The measured property lost with the fewest nodes.

        Those that host the services count first of all.
        """

        def shared(other: str) -> Tuple[int, int]:
            bits = self._fragility.bits([other])
            return _count(bits & self._hosts[name]), _count(bits)

        others = dict.fromkeys(s.property for s in self._som.sources if s.property != name)
        return min(others, key=shared) if others else None

    def most_helpful(
        self, candidates: Sequence[Remedy], survival: Survival
    ) -> Optional[Suggestion]:
        """The remedy with which the robot survives most, None if none helps.

        Of two that do the same for the failure of one node, that of two nodes decides, in a robot
        that is not large.
        """
        rated = []
        for name, source in candidates:
            with self._fragility.remedied(name, source):
                rated.append((self._fatal_alone(), name, source))
        rated.sort(key=lambda row: row[0])
        small = len(self._services) * len(self._ontology.functions) <= SMALL
        suggestions = []
        for alone, name, source in rated[: FINALISTS if small else 1]:
            with self._fragility.remedied(name, source):
                suggestions.append(Suggestion(name, source, self._survival(alone, small)))
        best = max(suggestions, key=lambda s: _gain(s.survival), default=None)
        return best if best is not None and _gain(best.survival) > _gain(survival) else None

    def _fatal_alone(self) -> int:
        """How many nodes must not fail."""
        fatal = {
            service.node
            for service in self._services
            if self._fragility.bits(service.properties) & self._fragility.bit(service.node)
        }
        return len(fatal)

    def _survival(self, alone: int, both: bool) -> Survival:
        """The share of failures survived; of two nodes only if asked for."""
        fragility = self._fragility
        nodes = len(fragility.nodes)
        single = 1 - alone / nodes
        if not both:
            return Survival(single, None)
        fatal: Set[FrozenSet[str]] = set()
        for node in {service.node for service in self._services}:
            names = [n for s in self._services if s.node == node for n in s.properties]
            bits = fragility.bits(names, fragility.after([node]))
            others = fragility.nodes if bits & AS_IT_IS else fragility.names(bits)
            fatal.update(frozenset([node, other]) for other in others if other != node)
        return Survival(single, 1 - len(fatal) / comb(nodes, 2) if nodes > 1 else 1.0)


def _gain(survival: Survival) -> Tuple[float, float]:
    return survival.single, survival.double or 0.0


def _count(bits: int) -> int:
    return bin(bits).count("1")
