"""The search for the best substitute of a property."""
from collections import deque
from dataclasses import dataclass
from typing import Callable, Iterable, Iterator, Set

from shsa_core.errors import NoSubstitute
from shsa_core.model.network import Network
from shsa_core.model.ontology import Ontology
from shsa_core.model.service import Source
from shsa_core.search.best import BestDerivations
from shsa_core.search.derivation import LOST, Derivation, SourceTable
from shsa_core.search.depth_first import first_found
from shsa_core.search.ranking import Ranking

__all__ = [
    "Derivation",
    "Substitute",
    "find_first",
    "find_substitute",
    "improving_substitutes",
    "iter_substitutes",
]

SMALLEST_QUALITY = (
    5e-324  # a product of many qualities may be too small for a float, but it is not 0
)


@dataclass(frozen=True)
class Substitute:
    """The result of a search: derivation, quality in (0, 1], and whether it is proven best."""

    derivation: Derivation
    quality: float
    proven_best: bool


def find_substitute(
    ontology: Ontology, sources: Iterable[Source], target: str, excluded: Iterable[str] = ()
) -> Substitute:
    """The best substitute of the property `target`.

    `excluded` names nodes, topics and services not to be used.

    Best is the highest quality, then the fewest relations, then the fewest inputs, then names in
    order. The time is linear in the relations that the target can be reached from, save n log n
    within a cycle of n properties. Raises NoSubstitute with what is missing.
    """
    network = ontology.network
    number = network.number(target)
    best = BestDerivations(network, _table(network, sources, excluded))
    if not best.settle(number):
        raise NoSubstitute([target], best.missing(number))
    return _substitute(best, number, proven_best=True)


def iter_substitutes(
    ontology: Ontology, sources: Iterable[Source], target: str, excluded: Iterable[str] = ()
) -> Iterator[Substitute]:
    """Every substitute of the property `target`, best first, each found when it is asked for.

    Maybe none.
    """
    network = ontology.network
    number = network.number(target)
    ranking = Ranking(network, _table(network, sources, excluded))
    for place, rated in enumerate(ranking.joint([number])):
        (derivation,) = rated.derivation.inputs
        yield Substitute(derivation, max(rated.quality, SMALLEST_QUALITY), place == 0)


def improving_substitutes(
    ontology: Ontology,
    sources: Iterable[Source],
    target: str,
    excluded: Iterable[str] = (),
    expired: Callable[[], bool] = lambda: False,
    first_circle: int = 64,
) -> Iterator[Substitute]:
    """A substitute of `target` early, then better ones, until the best is proven.

    It ends as well when time has expired.

    The search starts with the `first_circle` properties nearest to the target and takes in four
    times as many each time, while `expired` says False. The last substitute says whether it is
    `proven_best`; there is none if time expired before one was found. Raises NoSubstitute, with
    what is missing, if it is proven that there is none.
    """
    network = ontology.network
    number = network.number(target)
    table = _table(network, sources, excluded)
    clock = _Deadline(expired)
    whole = BestDerivations(network, table, tick=clock.tick)
    circle = _Circle(network, whole, number)
    size = first_circle
    worst = LOST
    try:
        while circle.widen(size, clock.tick):
            best = BestDerivations(network, table, circle.usable, tick=clock.tick)
            if best.settle(number) and best.ratings[number][:3] < worst[:3]:
                worst = best.ratings[number]
                yield _substitute(best, number, proven_best=False)
            size *= 4
        found = whole.settle(number)
    except _Expired:
        return
    if not found:
        raise NoSubstitute([target], whole.missing(number))
    yield _substitute(whole, number, proven_best=True)


def find_first(
    ontology: Ontology, sources: Iterable[Source], target: str, excluded: Iterable[str] = ()
) -> Substitute:
    """The substitute of the property `target` that the paper's search finds first.

    Raises NoSubstitute with what is missing.
    """
    network = ontology.network
    number = network.number(target)
    table = _table(network, sources, excluded)
    rated = first_found(network, table, number)
    if rated is None:
        best = BestDerivations(network, table)
        best.settle(number)
        raise NoSubstitute([target], best.missing(number))
    return Substitute(rated.derivation, max(rated.quality, SMALLEST_QUALITY), False)


def _table(network: Network, sources: Iterable[Source], excluded: Iterable[str]) -> SourceTable:
    without = frozenset(excluded)
    left = [s for s in sources if without.isdisjoint(s.names)] if without else sources
    return SourceTable(network, left)


def _substitute(best: BestDerivations, number: int, proven_best: bool) -> Substitute:
    quality = max(best.ratings[number][4], SMALLEST_QUALITY)
    return Substitute(best.ratings.derivation(number), quality, proven_best)


class _Expired(Exception):
    """The deadline has passed."""


class _Deadline:
    """Looks at the time at every 256th step, so that looking costs little."""

    def __init__(self, expired: Callable[[], bool]) -> None:
        self._expired = expired
        self._steps = 0

    def tick(self) -> None:
        if self._steps % 256 == 0 and self._expired():
            raise _Expired
        self._steps += 1


class _Circle:
    """The properties nearest to a target: those whose functions are followed."""

    def __init__(self, network: Network, best: BestDerivations, target: int) -> None:
        self._network = network
        self._best = best
        self._inside: Set[int] = set()
        self._seen = {target}
        self._next = deque([target])

    def widen(self, size: int, tick: Callable[[], None]) -> bool:
        """Takes in more properties, up to `size`. False if everything within reach is inside."""
        while self._next and len(self._inside) < size:
            tick()
            number = self._next.popleft()
            self._inside.add(number)
            for function in self._best.functions(number):
                for input_ in self._network.inputs_of(function):
                    if input_ not in self._seen:
                        self._seen.add(input_)
                        self._next.append(input_)
        return bool(self._next)

    def usable(self, function: int) -> bool:
        return self._network.outputs[function] in self._inside
