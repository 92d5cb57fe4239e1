"""Lists every derivation of a property, best first, each found on demand.

A derivation is a source, or a function with one derivation of each input; the next best differs
from one found before in one input alone, by one place (L. Huang, D. Chiang: Better k-best parsing,
IWPT 2005). Where properties depend on one another, an input's derivations are those that keep off
the path that leads to it.
"""
from dataclasses import dataclass
from functools import partial
from heapq import heapify, heappop, heappush
from typing import Callable, Dict, FrozenSet, Iterator, List, Optional, Sequence, Set, Tuple

from shsa_core.search.best import BestDerivations, Ratings, Usable, dependents
from shsa_core.search.derivation import LOST, Rated, SourceTable
from shsa_core.search.derivation import names_before, rate_function, rate_joint, rate_source

EVERYWHERE: FrozenSet[int] = frozenset()
ROOT = -1

Rate = Callable[[Sequence[Rated]], Rated]
"""Make a derivation of derivations of its inputs."""


@dataclass(eq=False)
class Candidate:
    """A derivation from a source, or what `rate` makes of those at `places` of its inputs."""

    rated: Rated
    rate: Optional[Rate] = None
    inputs: Sequence["Ranked"] = ()
    places: Tuple[int, ...] = ()

    def __lt__(self, other: "Candidate") -> bool:
        if self.rated.key != other.rated.key:
            return self.rated.key < other.rated.key
        return names_before(self.rated.derivation, other.rated.derivation)


class Ranked:
    """The known derivations of one property that keep off those in `path`, best first."""

    def __init__(self, number: int, path: FrozenSet[int], first: Rated) -> None:
        self.number = number
        self.path = path
        self.items = [first]
        self.candidates: Optional[List[Candidate]] = None  # None until a second item is asked for
        self.complete = False
        self._last: Optional[Candidate] = None
        self._changes: List[int] = []  # the inputs in which the last item's successors differ

    def advance(self) -> Optional[Tuple["Ranked", int]]:
        """Find the next item, if any; return the place in another list that is needed first."""
        assert self.candidates is not None
        while self._changes:
            assert self._last is not None and self._last.rate is not None
            inputs, places = self._last.inputs, self._last.places
            change = self._changes[-1]
            place = places[change] + 1
            if len(inputs[change].items) > place:
                places = places[:change] + (place,) + places[change + 1 :]
                rated = [ranked.items[place] for ranked, place in zip(inputs, places)]
                rate = self._last.rate
                successor = Candidate(rate(rated), rate, inputs, places)
                heappush(self.candidates, successor)
            elif not inputs[change].complete:
                return inputs[change], place
            self._changes.pop()
        if self.candidates:
            self.items.append(self.take().rated)
        else:
            self.complete = True
        return None

    def take(self) -> Candidate:
        """Take the best candidate as the last item; its successors are made on demand."""
        assert self.candidates
        self._last = heappop(self.candidates)
        # A successor differs in an input after which all are at their first place: so each comes up
        # once.
        places = self._last.places
        earliest = max((i for i, place in enumerate(places) if place), default=0)
        self._changes = list(range(earliest, len(places)))
        return self._last


class Ranking:
    """The joint derivations of several properties, best first."""

    def __init__(self, sources: SourceTable, usable: Optional[Usable] = None) -> None:
        self._network = sources.network
        self._sources = sources
        self._best = BestDerivations(sources, usable, prune=False)
        self._cycles: Dict[int, Set[int]] = {}
        self._ranked: Dict[Tuple[int, FrozenSet[int]], Ranked] = {}

    def joint(self, targets: Sequence[int]) -> Iterator[Rated]:
        """Yield joint derivations of all targets, best first; their inputs follow the targets."""
        self._settle(targets)
        candidate = self._candidate(rate_joint, targets, self._best.ratings)
        if candidate is None:
            return
        yield from self._from(Ranked(ROOT, EVERYWHERE, candidate.rated), candidate)

    def by_function(self, target: int) -> List[Iterator[Rated]]:
        """Return, for each function of the target, the derivations by it, best first."""
        self._settle([target])
        found = self._candidates(target, EVERYWHERE)
        return [self._from(Ranked(target, EVERYWHERE, each.rated), each) for each in found]

    def _settle(self, targets: Sequence[int]) -> None:
        for target in targets:
            self._best.settle(target)
        self._cycles = self._best.cycles()

    def _from(self, ranked: Ranked, candidate: Candidate) -> Iterator[Rated]:
        """Yield the items of a list that begins with its only candidate, best first."""
        ranked.candidates = [candidate]
        ranked.take()
        place = 0
        while place < len(ranked.items):
            yield ranked.items[place]
            place += 1
            self._find(ranked, place)

    def _find(self, ranked: Ranked, place: int) -> None:
        """Extend the list up to the item at `place`, if there is one."""
        stack = [(ranked, place)]
        while stack:
            ranked, place = stack[-1]
            if ranked.complete or len(ranked.items) > place:
                stack.pop()
                continue
            if ranked.candidates is None:
                self._begin(ranked)
            needed = ranked.advance()
            if needed is not None:
                stack.append(needed)

    def _begin(self, ranked: Ranked) -> None:
        """Find the candidates of a list whose first item is known, and take that one."""
        by_source = [Candidate(rate_source(each)) for each in self._sources.of(ranked.number)]
        ranked.candidates = by_source + self._candidates(ranked.number, ranked.path)
        heapify(ranked.candidates)
        ranked.take()

    def _candidates(self, number: int, path: FrozenSet[int]) -> List[Candidate]:
        """Return the best derivation of a property by each function that keeps off `path`."""
        best = self._best
        ratings = best.ratings
        cycle = self._cycles.get(number)
        path = EVERYWHERE if cycle is None else path | {number}
        if cycle is not None:
            ratings = Ratings(self._sources, best.ratings)
            for blocked in path:
                ratings[blocked] = LOST
            best.settle_cycle(dependents(best.ratings.users(cycle), path) - path, ratings)
        candidates = []
        for f in best.functions(number):
            inputs = self._network.inputs[f]
            rate = partial(rate_function, self._network.functions[f], self._network.costs[f])
            candidate = self._candidate(rate, inputs, ratings, cycle, path)
            if candidate is not None:
                candidates.append(candidate)
        return candidates

    def _candidate(
        self,
        rate: Rate,
        inputs: Sequence[int],
        ratings: Ratings,
        cycle: Optional[Set[int]] = None,
        path: FrozenSet[int] = EVERYWHERE,
    ) -> Optional[Candidate]:
        """Return the derivation that `rate` makes of the best inputs; None if one has none."""
        lists = []
        for number in inputs:
            first = ratings.rated(number)
            if first is None:
                return None
            off = path if self._cycles.get(number) is cycle else EVERYWHERE
            lists.append(self._ranked.setdefault((number, off), Ranked(number, off, first)))
        rated = rate([ranked.items[0] for ranked in lists])
        return Candidate(rated, rate, lists, (0,) * len(lists))
