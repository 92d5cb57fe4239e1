"""Derivations: how a property is obtained from services, and how good that is."""
from typing import Dict, Iterable, List, NamedTuple, Optional, Sequence, Set, Tuple

from shsa_core.model.network import Network
from shsa_core.model.relation import TransferFunction
from shsa_core.model.quality import cost
from shsa_core.model.som import Service

# Costs and uses are counted up to here: a derivation that uses one input twice may double them at every level.
MOST = 2**60


# How good a derivation is: cost, relations, inputs (each as often as it is used); what it is by; the product of the
# qualities. The least is the best, as the functions of a property are numbered in the order of their names.
# It is by a service, or by function number `by - FUNCTION`.
Rating = Tuple[int, int, int, int, float]
NOTHING, NOT_RATED, SERVICE, FUNCTION = -1, 0, 1, 2
LOST: Rating = (MOST + 1, 0, 0, NOTHING, 0.0)  # worse than any derivation
UNRATED: Rating = (0, 0, 0, NOT_RATED, 0.0)


class Derivation:
    """How one property is obtained: from a service, or by a function from other derivations.

    Exactly one of `service` and `function` is set. `inputs` follow `function.inputs`. Derivations are shared: one
    object stands wherever its property is obtained that way. They are compared and hashed by identity.
    """

    __slots__ = ("property", "service", "function", "inputs")

    def __init__(
        self,
        property: str,
        service: Optional[Service],
        function: Optional[TransferFunction],
        inputs: Tuple["Derivation", ...] = (),
    ) -> None:
        self.property = property
        self.service = service
        self.function = function
        self.inputs = inputs

    def __repr__(self) -> str:
        return f"<{self.property} by {self.name[0]}>"

    @property
    def name(self) -> Tuple[str, str]:
        """What it is ordered by: the path and node of the service, or the relation."""
        if self.service is not None:
            return self.service.path, self.service.node
        assert self.function is not None
        return self.function.relation, ""

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

    def services(self) -> Tuple[Service, ...]:
        """The services used, each once, in order of first use."""
        return tuple(dict.fromkeys(d.service for d in self.unique() if d.service is not None))

    def relations(self) -> Tuple[str, ...]:
        """The names of the relations used, each once, in order of first use."""
        functions = [d.function for d in self.unique() if d.function is not None]
        return tuple(dict.fromkeys(function.relation for function in functions))


def names_before(one: Derivation, other: Derivation) -> bool:
    """Whether `one` comes before `other` in the order of names, for two derivations of one property.

    Names are compared from the result to the inputs, left to right: a service's path and node, a relation's name.
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

    `key` is the cost of its quality (see quality.py), how many relations and how many inputs it uses, each as often
    as it is used: the lower, the better. `quality` is the product of the qualities.
    """

    key: Tuple[int, int, int]
    quality: float
    derivation: Derivation


def rate_service(service: Service) -> Rated:
    """The derivation of a property from a service alone."""
    key = cost(service.quality), 0, 1
    return Rated(key, service.quality, Derivation(service.property, service, None))


def rate_function(function: TransferFunction, inputs: Sequence[Rated]) -> Rated:
    """The derivation of a function's output from derivations of its inputs."""
    price, relations, leaves, quality = cost(function.quality), 1, 0, function.quality
    for rated in inputs:
        price += rated.key[0]
        relations += rated.key[1]
        leaves += rated.key[2]
        quality *= rated.quality
    key = min(price, MOST), min(relations, MOST), min(leaves, MOST)
    derivation = Derivation(function.output, None, function, tuple(r.derivation for r in inputs))
    return Rated(key, quality, derivation)


def joint(names: Sequence[str]) -> TransferFunction:
    """A function of quality 1 that stands for several properties at once."""
    return TransferFunction("", "", tuple(names), None)


class ServiceTable:
    """The services that may be used, by the number of their property: all but those on an excluded node or topic.

    `ratings` and `best` have the best service of each property that has one.
    """

    def __init__(
        self, network: Network, services: Iterable[Service], excluded: Iterable[str] = ()
    ) -> None:
        self.ratings: Dict[int, Rating] = {}
        self.best: Dict[int, Service] = {}
        self._several: Dict[int, List[Service]] = {}
        without = frozenset(excluded)
        for service in services:
            if service.node in without or service.topic in without:
                continue
            number = network.number(service.property)
            if number in self.best:
                self._several.setdefault(number, [self.best[number]]).append(service)
            else:
                self.best[number] = service
                self.ratings[number] = cost(service.quality), 0, 1, SERVICE, service.quality
        for number in self._several:
            service = min(self.of(number), key=lambda service: cost(service.quality))
            self.best[number] = service
            self.ratings[number] = cost(service.quality), 0, 1, SERVICE, service.quality

    def of(self, number: int) -> Sequence[Service]:
        """The services of a property, each once, in the order of their names."""
        if number in self._several:
            services = dict.fromkeys(self._several[number])
            return sorted(services, key=lambda service: (service.path, service.node))
        return [self.best[number]] if number in self.best else []
