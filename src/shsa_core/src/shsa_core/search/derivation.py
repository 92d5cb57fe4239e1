"""Derivations: how a property is obtained from sources, and how good that is."""
import math
from dataclasses import dataclass
from typing import Dict, Iterable, List, NamedTuple, Optional, Sequence, Set, Tuple

from shsa_core.model.ontology import Network, TransferFunction, cost
from shsa_core.model.service import Source

Rating = Tuple[float, int, int, int, float]
"""The least is the best: cost, relations and what its inputs cost (each as often as it is used);
what it is by, a source or the function number `by - FUNCTION`; the product of the qualities.
"""
NOTHING, NOT_RATED, SOURCE, FUNCTION = -1, 0, 1, 2
LOST: Rating = (math.inf, 0, 0, NOTHING, 0.0)  # worse than any derivation
UNRATED: Rating = (0, 0, 0, NOT_RATED, 0.0)

Name = Tuple[float, str, str]


@dataclass(eq=False)
class Derivation:
    """A property obtained from a source, or by a function from other derivations.

    One of `source` and `function` is set, or neither: it is several properties at once, its
    `inputs`. Else they follow `function.inputs`. One object
    stands wherever its property is obtained that way: they are compared and hashed by identity.
    """

    property: str
    source: Optional[Source]
    function: Optional[TransferFunction]
    inputs: Tuple["Derivation", ...] = ()

    def __repr__(self) -> str:
        return f"<{self.property} by {self.name()[1]}>"

    def name(self) -> Name:
        """Return the sort key: the period, path and node of the source, or the relation."""
        if self.source is not None:
            return _name(self.source)
        return math.inf, "" if self.function is None else self.function.relation, ""

    def unique(self) -> List["Derivation"]:
        """Return this derivation and all its parts, each object once, in order of first use."""
        seen: Dict[Derivation, None] = {}
        stack = [self]
        while stack:
            derivation = stack.pop()
            if derivation not in seen:
                seen[derivation] = None
                stack.extend(reversed(derivation.inputs))
        return list(seen)

    def sources(self) -> Tuple[Source, ...]:
        """Return the sources used, each once, in order of first use."""
        return tuple(dict.fromkeys(d.source for d in self.unique() if d.source is not None))

    def relations(self) -> Tuple[str, ...]:
        """Return the names of the relations used, each once, in order of first use."""
        functions = [d.function for d in self.unique() if d.function is not None]
        return tuple(dict.fromkeys(function.relation for function in functions))


def names_before(one: Derivation, other: Derivation) -> bool:
    """Return True if `one` comes before `other` by name, from the result to the inputs."""
    equal: Set[Tuple[Derivation, Derivation]] = set()
    stack = [(one, other)]
    while stack:
        pair = stack.pop()
        if pair[0] is not pair[1] and pair not in equal:
            if pair[0].name() != pair[1].name():
                return pair[0].name() < pair[1].name()
            equal.add(pair)
            stack.extend(reversed(list(zip(pair[0].inputs, pair[1].inputs))))
    return False


class Rated(NamedTuple):
    """A derivation and how good it is; `key` has the first three of its Rating."""

    key: Tuple[float, int, int]
    quality: float
    derivation: Derivation


def rate_source(source: Source) -> Rated:
    """Return the derivation of a property from a source alone."""
    key = cost(source.quality), 0, source.service.cost
    return Rated(key, source.quality, Derivation(source.property, source, None))


def rate_function(function: TransferFunction, price: int, inputs: Sequence[Rated]) -> Rated:
    """Return the derivation of a function's output; `price` is the function's cost."""
    derivation = Derivation(function.output, None, function, tuple(r.derivation for r in inputs))
    return _rate(derivation, price, 1, function.quality, inputs)


def rate_joint(parts: Sequence[Rated]) -> Rated:
    """Return derivations of several properties at once."""
    joint = Derivation("", None, None, tuple(part.derivation for part in parts))
    return _rate(joint, 0, 0, 1.0, parts)


def _rate(
    derivation: Derivation, price: float, relations: int, quality: float, inputs: Sequence[Rated]
) -> Rated:
    leaves = 0
    for rated in inputs:
        price += rated.key[0]
        relations += rated.key[1]
        leaves += rated.key[2]
        quality *= rated.quality
    return Rated((price, relations, leaves), quality, derivation)


class SourceTable:
    """The sources that may be used, by the number of their property."""

    def __init__(self, network: Network, sources: Iterable[Source] = ()) -> None:
        self.network = network
        self._base: Optional[SourceTable] = None  # for the properties that are not in `_of`
        self._of: Dict[int, Dict[Source, None]] = {}
        self._best: Dict[int, Tuple[Rating, Optional[Source]]] = {}
        self._named: Dict[str, Dict[Source, None]] = {}  # by service, topic, node and cause
        for source in sources:
            self.add(source)

    def add(self, source: Source) -> None:
        """Add a source; one that is there already stays as it is."""
        assert self._base is None, "a table that leaves something out is not changed"
        of = self._of.setdefault(self.network.number(source.property), {})
        if source not in of:
            of[source] = None
            self._choose(self.network.number(source.property))
            for name in source.names:
                self._named.setdefault(name, {})[source] = None

    def discard(self, source: Source) -> None:
        """Remove a source, if it is there."""
        assert self._base is None, "a table that leaves something out is not changed"
        of = self._of.get(self.network.number(source.property), {})
        if source in of:
            del of[source]
            self._choose(self.network.number(source.property))
            for name in source.names:
                self._named[name].pop(source, None)

    def excluding(self, names: Iterable[str]) -> "SourceTable":
        """Return the table without the sources of some services, topics, nodes and causes.

        It is valid until the next change of this one, and costs as much as there is to leave out.
        """
        gone = {source for name in names for source in self._named.get(name, ())}
        if not gone:
            return self
        table = SourceTable(self.network)
        table._base, table._named = self, self._named
        for number in {self.network.number(source.property) for source in gone}:
            table._of[number] = {each: None for each in self.of(number) if each not in gone}
            table._choose(number)
        return table

    def rating(self, number: int) -> Rating:
        """Return the rating of a property's best source; LOST if there is none."""
        found = self._best.get(number)
        if found is None:
            return LOST if self._base is None else self._base.rating(number)
        return found[0]

    def best(self, number: int) -> Source:
        """Return the best source of a property that has one."""
        if self._base is not None and number not in self._of:
            return self._base.best(number)
        source = self._best[number][1]
        assert source is not None
        return source

    def of(self, number: int) -> Sequence[Source]:
        """Return the sources of a property, each once, in the order of their names."""
        if self._base is not None and number not in self._of:
            return self._base.of(number)
        return sorted(self._of.get(number, ()), key=lambda source: (source.path, source.node))

    def _choose(self, number: int) -> None:
        best = min(self._of[number], key=_order, default=None)
        rating = LOST
        if best is not None:
            rating = (*rate_source(best).key, SOURCE, best.quality)
        self._best[number] = rating, best


def _order(source: Source) -> Tuple[int, int, Name]:
    return cost(source.quality), source.service.cost, _name(source)


def _name(source: Source) -> Name:
    """Return what orders sources that are equally good: the faster first, as its value is newer."""
    period = source.service.period
    return math.inf if period is None else period, source.path, source.node
