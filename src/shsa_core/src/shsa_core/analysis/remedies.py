"""Which one new sensor or relation would let a robot survive more failures."""
from typing import Collection, Dict, FrozenSet, List, NamedTuple, Optional, Sequence, Set, Tuple

from shsa_core.analysis.fragility import AS_IT_IS, Fragility
from shsa_core.analysis.report import ServiceReport, Suggestion, survival
from shsa_core.model.ontology import Ontology
from shsa_core.model.service import Service
from shsa_core.model.som import Som

CANDIDATES = 50  # properties for which a new one is considered, where all would take too long
FINALISTS = 3  # of them, those whose effect on failures of two causes is worked out
WORK = 300_000  # remedies times the properties and services that they may touch: some seconds

Remedy = Tuple[
    str, Optional[str]
]  # a property, and the input of a new relation; None: a new sensor
Fatal = Tuple[int, int]
"""How many causes must not fail, and how many pairs; 0 pairs where they were not counted."""


class Found(NamedTuple):
    """The remedy with which the robot survives most, None if none helps.

    `exact`: there is no better one.
    """

    best: Optional[Suggestion]
    exact: bool


class Remedies:
    """New sensors, each on a node of its own, and new relations with one measured input."""

    def __init__(
        self,
        ontology: Ontology,
        som: Som,
        fragility: Fragility,
        services: Collection[ServiceReport],
    ) -> None:
        self._som = som
        self._fragility = fragility
        self._services: Sequence[Service] = som.needed()
        self._hosted: Dict[str, List[Service]] = {}
        for service in self._services:
            for cause in service.causes:
                self._hosted.setdefault(cause, []).append(service)
        self._size = len(ontology.functions) + len(self._services) + 1
        weights: Dict[str, int] = {}
        own: Set[str] = set()
        for each in services:
            weight = sum(len(som) if len(cut) == 1 else 1 for cut in each.cuts)
            own.update(each.properties)
            for name in {*each.properties, *each.missing} if weight else ():
                weights[name] = weights.get(name, 0) + weight
        wanted = sorted(weights, key=lambda name: (-weights[name], name not in own, name))
        self._wanted = wanted[:CANDIDATES]
        self._all = list(dict.fromkeys([*wanted, *fragility.ancestors(own)]))
        # The bits of the causes whose services want a property.
        self._hosts = dict.fromkeys(self._wanted, 0)
        for each in services:
            for name in self._hosts.keys() & {*each.properties, *each.missing}:
                if each.cuts:
                    self._hosts[name] |= fragility.bit(each.node)

    def sensors(self) -> Found:
        """A new sensor of a property, on a node of its own."""
        if len(self._all) * self._size <= WORK:
            return self._most_helpful([(name, None) for name in self._all], everything=True)
        return self._most_helpful([(name, None) for name in self._wanted], everything=False)

    def relations(self) -> Found:
        """A new relation that yields a property from a measured one."""
        measured = dict.fromkeys(source.property for source in self._som.sources)
        if len(self._all) * len(measured) * self._size <= WORK:
            pairs = [(name, source) for name in self._all for source in measured if name != source]
            pairs.sort(key=lambda pair: self._shared(*pair))  # the likely one of those that tie
            return self._most_helpful(pairs, everything=True)
        likely: List[Remedy] = []
        for name in self._wanted:
            others = [source for source in measured if source != name]
            if others:
                likely.append((name, min(others, key=lambda other: self._shared(name, other))))
        return self._most_helpful(likely, everything=False)

    def _shared(self, name: str, source: str) -> Tuple[int, int]:
        """How many causes a source is lost with, those that host what wants `name` before all."""
        bits = self._fragility.bits([source])
        return _count(bits & self._hosts.get(name, 0)), _count(bits)

    def _most_helpful(self, candidates: Sequence[Remedy], everything: bool) -> Found:
        """The best by the failures of one cause; of those that tie, by those of two.

        These are counted only where that does not take too long.
        """
        alone = self._alone()
        rated: List[Tuple[int, Remedy]] = []
        for remedy in candidates:
            with self._fragility.remedied(*remedy):
                rated.append((self._alone(), remedy))
        least = min((count for count, _ in rated), default=alone)
        finalists = [remedy for count, remedy in rated if count == least]
        cost = len(self._hosted) * self._size
        exact = everything and len(finalists) * cost <= WORK
        pairs = exact or FINALISTS * cost <= WORK
        before = alone, self._pairs() if pairs else 0
        best: Tuple[Fatal, Optional[Remedy]] = (before, None)
        for remedy in finalists if exact else finalists[: FINALISTS if pairs else 1]:
            with self._fragility.remedied(*remedy):
                after = least, self._pairs() if pairs else 0
            if after < best[0]:
                best = after, remedy
        if best[1] is None:
            return Found(None, exact)
        causes = len(self._fragility.causes)
        left = survival(causes, best[0][0], best[0][1] if pairs else None)
        return Found(Suggestion(*best[1], left), exact)

    def _alone(self) -> int:
        """How many causes must not fail."""
        return sum(
            any(self._fragility.bits(s.properties) & self._fragility.bit(cause) for s in hosted)
            for cause, hosted in self._hosted.items()
        )

    def _pairs(self) -> int:
        """How many pairs of causes must not fail together."""
        fragility = self._fragility
        fatal: Set[FrozenSet[str]] = set()
        for cause, hosted in self._hosted.items():
            names = [name for service in hosted for name in service.properties]
            bits = fragility.bits(names, fragility.after([cause]))
            others = fragility.causes if bits & AS_IT_IS else fragility.names(bits)
            fatal.update(frozenset([cause, other]) for other in others if other != cause)
        return len(fatal)


def _count(bits: int) -> int:
    return bin(bits).count("1")
