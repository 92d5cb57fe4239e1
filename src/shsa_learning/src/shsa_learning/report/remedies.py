"""Finds the new sensor or relation with which a robot survives most failures."""
from typing import Collection, Dict, FrozenSet, List, NamedTuple, Optional, Sequence, Set, Tuple

from shsa_learning.fragility import AS_IT_IS, Fragility
from shsa_learning.report.report import ServiceReport, Suggestion, survival
from shsa_core.model.ontology import Ontology
from shsa_core.model.service import Service
from shsa_core.model.som import Som

WORK = 300_000
"""The most remedies, or remedies times causes, that are tried, by the properties and services that
each may touch: some seconds.
"""

Remedy = Tuple[str, Optional[str]]
"""A property, and the input of a new relation for it; None: a new sensor."""
Fatal = Tuple[int, int]
"""The numbers of causes and of pairs that must not fail; 0 pairs where they were not counted."""


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
        self._services: Sequence[Service] = som.may_be_needed()
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
        self._wanted = wanted[: self._most(1)]
        self._all = list(dict.fromkeys([*wanted, *fragility.ancestors(own)]))
        # The bits of the causes whose services want a property.
        self._hosts = dict.fromkeys(self._wanted, 0)
        for each in services:
            for name in self._hosts.keys() & {*each.properties, *each.missing}:
                if each.cuts:
                    self._hosts[name] |= fragility.bit(each.node)

    def _most(self, each: int) -> int:
        """Return how many remedies may be tried, `each` times; one at least."""
        return max(1, WORK // (self._size * each))

    def sensors(self) -> Found:
        """Return the best new sensor of a property, on a node of its own."""
        return self._most_helpful([(name, None) for name in self._all], len(self._all))

    def relations(self) -> Found:
        """Return the best new relation that yields a property from a measured one."""
        measured = list(dict.fromkeys(source.property for source in self._som.sources))
        every = len(self._all) * len(measured)
        if every <= self._most(1):
            pairs = [(name, source) for name in self._all for source in measured]
        else:
            pairs = [
                (name, min(measured, key=lambda other: self._shared(name, other)))
                for name in self._wanted
            ]
        pairs = [(name, source) for name, source in pairs if name != source]
        pairs.sort(key=lambda pair: self._shared(*pair))  # the likely one of those that tie
        return self._most_helpful(pairs, every)

    def _shared(self, name: str, source: str) -> Tuple[int, int]:
        """Count the causes that a source is lost with, those that host what wants `name` first."""
        bits = self._fragility.bits([source])
        return _count(bits & self._hosts.get(name, 0)), _count(bits)

    def _most_helpful(self, candidates: Sequence[Remedy], every: int) -> Found:
        """Return the best by the failures of one cause; of those that tie, by those of two.

        `candidates`: the likely ones first, out of `every` one. As many are tried as WORK allows.
        """
        alone = self._alone()
        rated: List[Tuple[int, Remedy]] = []
        for remedy in candidates[: self._most(1)]:
            with self._fragility.remedied(*remedy):
                rated.append((self._alone(), remedy))
        least = min((count for count, _ in rated), default=alone)
        tied = [remedy for count, remedy in rated if count == least]
        finalists = tied[: self._most(len(self._hosted) or 1)]
        exact = every <= self._most(1) and len(finalists) == len(tied)
        pairs = len(self._hosted) <= self._most(1)
        before = alone, self._pairs() if pairs else 0
        best: Tuple[Fatal, Optional[Remedy]] = (before, None)
        for remedy in finalists:
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
        """Count the causes that must not fail."""
        return sum(
            any(self._fragility.bits(s.properties) & self._fragility.bit(cause) for s in hosted)
            for cause, hosted in self._hosted.items()
        )

    def _pairs(self) -> int:
        """Count the pairs of causes that must not fail together."""
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
