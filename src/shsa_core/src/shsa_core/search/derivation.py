"""Derivations: how a property is obtained from sources, and how good that is."""
import math
from typing import Dict, Iterable, List, NamedTuple, Optional, Sequence, Set, Tuple

from shsa_core.model.network import Network
from shsa_core.model.quality import cost
from shsa_core.model.relation import TransferFunction
from shsa_core.model.service import Source

# Costs and uses are counted up to here: a derivation that uses one input twice may double them at
# every level.
MOST = 2**60


# How good a derivation is: cost, relations, inputs (each as often as it is used); what it is by;
# the product of the qualities. The least is the best, as the functions of a property are numbered
# in the order of their names. It is by a source, or by function number `by - FUNCTION`.
Rating = Tuple[int, int, int, int, float]
NOTHING, NOT_RATED, SOURCE, FUNCTION = -1, 0, 1, 2
LOST: Rating = (MOST + 1, 0, 0, NOTHING, 0.0)  # worse than any derivation
UNRATED: Rating = (0, 0, 0, NOT_RATED, 0.0)


Name = Tuple[float, str, str]


class Derivation:
    """How one property is obtained: from a source, or by a function from other derivations.

    Exactly one of `source` and `function` is set. `inputs` follow `function.inputs`. Derivations
    are shared: one object stands wherever its property is obtained that way. They are compared and
    hashed by identity.
    """

    __slots__ = ("property", "source", "function", "inputs")

    def __init__(
        self,
        property: str,
        source: Optional[Source],
        function: Optional[TransferFunction],
        inputs: Tuple["Derivation", ...] = (),
    ) -> None:
        self.property = property
        self.source = source
        self.function = function
        self.inputs = inputs

    def __repr__(self) -> str:
        return f"<{self.property} by {self.name[1]}>"

    @property
    def name(self) -> Name:
        """What it is ordered by: the period, path and node of the source, or the relation."""
        if self.source is not None:
            return _name(self.source)
        assert self.function is not None
        return math.inf, self.function.relation, ""

    def unique(self) -> List["Derivation"]:
        """This derivation and all that it is made of, each object once, in order of first use."""
        seen: Dict[Derivation, None] = {}
        stack = [self]
        while stack:
            derivation = stack.pop()
            if derivation not in seen:
                seen[derivation] = None
                stack.extend(reversed(derivation.inputs))
        return list(seen)

    def sources(self) -> Tuple[Source, ...]:
        """The sources used, each once, in order of first use."""
        return tuple(dict.fromkeys(d.source for d in self.unique() if d.source is not None))

    def relations(self) -> Tuple[str, ...]:
        """The names of the relations used, each once, in order of first use."""
        functions = [d.function for d in self.unique() if d.function is not None]
        return tuple(dict.fromkeys(function.relation for function in functions))


class JointDerivation(Derivation):
    """Derivations of several properties at once: its `inputs`."""

    __slots__ = ()

    def __init__(self, inputs: Tuple[Derivation, ...]) -> None:
        super().__init__("", None, None, inputs)

    @property
    def name(self) -> Name:
        """There is nothing to order it by but its inputs."""
        return 0.0, "", ""


def names_before(one: Derivation, other: Derivation) -> bool:
    """Whether `one` comes before `other` by name, for two derivations of one property.

    Names are compared from the result to the inputs, left to right: a source's period, path and
    node, a relation's name.
    """
    equal: Set[Tuple[Derivation, Derivation]] = set()
    stack = [(one, other)]
    while stack:
        pair = stack.pop()
        if pair[0] is not pair[1] and pair not in equal:
            if pair[0].name != pair[1].name:
                return pair[0].name < pair[1].name
            equal.add(pair)
            stack.extend(reversed(list(zip(pair[0].inputs, pair[1].inputs))))
    return False


class Rated(NamedTuple):
    """A derivation and how good it is.

    `key` is the cost of its quality (see quality.py), how many relations and how many inputs it
    uses, each as often as it is used: the lower, the better. `quality` is the product of the
    qualities.
    """

    key: Tuple[int, int, int]
    quality: float
    derivation: Derivation


def rate_source(source: Source) -> Rated:
    """The derivation of a property from a source alone."""
    key = cost(source.quality), 0, 1
    return Rated(key, source.quality, Derivation(source.property, source, None))


def rate_function(function: TransferFunction, price: int, inputs: Sequence[Rated]) -> Rated:
    """The derivation of a function's output from derivations of its inputs.

    `price`: what the function costs, by the network.
    """
    derivation = Derivation(function.output, None, function, tuple(r.derivation for r in inputs))
    return _rate(derivation, price, 1, function.quality, inputs)


def rate_joint(parts: Sequence[Rated]) -> Rated:
    """Derivations of several properties at once."""
    return _rate(JointDerivation(tuple(part.derivation for part in parts)), 0, 0, 1.0, parts)


def _rate(
    derivation: Derivation, price: int, relations: int, quality: float, inputs: Sequence[Rated]
) -> Rated:
    leaves = 0
    for rated in inputs:
        price += rated.key[0]
        relations += rated.key[1]
        leaves += rated.key[2]
        quality *= rated.quality
    return Rated((min(price, MOST), min(relations, MOST), min(leaves, MOST)), quality, derivation)


class SourceTable:
    """The sources that may be used, by the number of their property.

    Kept up by `add` and `discard`.
    """

    def __init__(self, network: Network, sources: Iterable[Source] = ()) -> None:
        self._network = network
        self._base: Optional[SourceTable] = None  # for the properties that are not in `_of`
        self._of: Dict[int, Dict[Source, None]] = {}
        self._best: Dict[int, Source] = {}
        self._ratings: Dict[int, Rating] = {}
        # By service, topic and node; made when something is left out for the first time.
        self._named: Optional[Dict[str, Dict[Source, None]]] = None
        for source in sources:
            self.add(source)

    def add(self, source: Source) -> None:
        """Takes a source in; one that is there already stays as it is."""
        assert self._base is None, "a table that leaves something out is not changed"
        number = self._network.number(source.provision.property)
        of = self._of.get(number)
        if not of:
            self._of[number] = {source: None}
            self._choose(number, source)
        elif source not in of:
            of[source] = None
            if _order(source) < _order(self._best[number]):
                self._choose(number, source)
        if self._named is not None:
            _index(self._named, source)

    def discard(self, source: Source) -> None:
        """Takes a source out, if it is there."""
        assert self._base is None, "a table that leaves something out is not changed"
        number = self._network.number(source.property)
        of = self._of.get(number, {})
        if source in of:
            del of[source]
            if self._named is not None:
                for name in source.names:
                    self._named[name].pop(source, None)
            if source == self._best[number]:
                self._choose(number, min(of, key=_order) if of else None)

    def excluding(self, names: Iterable[str]) -> "SourceTable":
        """The table without the sources of some services, topics or nodes.

        It is valid until the next change of this one.

        It costs as much as there is to leave out, not as much as there is.
        """
        gone: Dict[int, Set[Source]] = {}
        if self._named is None:
            self._named = {}
            for source in [source for of in self._of.values() for source in of]:
                _index(self._named, source)
        for name in names:
            for source in self._named.get(name, ()):
                gone.setdefault(self._network.number(source.property), set()).add(source)
        if not gone:
            return self
        table = SourceTable(self._network)
        table._base, table._named = self, self._named
        for number, sources in gone.items():
            left = {source: None for source in self.of(number) if source not in sources}
            table._of[number] = left
            table._choose(number, min(left, key=_order) if left else None)
        return table

    def rating(self, number: int) -> Rating:
        """The best source of a property, as a derivation; LOST if there is none."""
        rating = self._ratings.get(number)
        if rating is None:
            return LOST if self._base is None else self._base.rating(number)
        return rating

    def best(self, number: int) -> Source:
        """The best source of a property that has one."""
        if self._base is not None and number not in self._of:
            return self._base.best(number)
        return self._best[number]

    def of(self, number: int) -> Sequence[Source]:
        """The sources of a property, each once, in the order of their names."""
        if self._base is not None and number not in self._of:
            return self._base.of(number)
        return sorted(self._of.get(number, ()), key=lambda source: (source.path, source.node))

    def _choose(self, number: int, source: Optional[Source]) -> None:
        if source is None:
            self._best.pop(number, None)
            self._ratings[number] = LOST
        else:
            self._best[number] = source
            quality = source.provision.quality
            self._ratings[number] = cost(quality), 0, 1, SOURCE, quality


def _index(named: Dict[str, Dict[Source, None]], source: Source) -> None:
    for name in source.names:
        named.setdefault(name, {})[source] = None


def _order(source: Source) -> Tuple[int, Name]:
    """The best first."""
    return cost(source.quality), _name(source)


def _name(source: Source) -> Name:
    """Of two that are as good the faster comes first: its value is the newer one."""
    period = source.service.period
    return math.inf if period is None else period, source.path, source.node
