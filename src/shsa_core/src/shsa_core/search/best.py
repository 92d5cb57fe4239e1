"""The best derivation of every property that a target depends on.

Each is settled once, inputs first: depth first, and what properties that depend on one another
leave open by Knuth's algorithm (D. E. Knuth: A generalization of Dijkstra's algorithm, Information
Processing Letters 6, 1977).
"""
from heapq import heapify, heappop, heappush
from typing import Callable, Dict, Iterable, List, Mapping, Optional, Sequence, Set, Tuple

import networkx as nx

from shsa_core.search.derivation import FUNCTION, LOST, NOTHING, NOT_RATED, SOURCE, UNRATED
from shsa_core.search.derivation import Derivation, Rated, Rating, SourceTable

Usable = Callable[[int], bool]
FREE: Rating = (0, 0, 0, SOURCE, 1.0)


class Ratings(Dict[int, Rating]):
    """The best derivations of properties, by number; those not rated here are as in `base`."""

    def __init__(self, sources: SourceTable, base: Optional["Ratings"] = None) -> None:
        super().__init__()
        self._network = sources.network
        self.sources = sources
        self._base = base
        self._made: Dict[int, Derivation] = {}

    def __missing__(self, number: int) -> Rating:
        return UNRATED if self._base is None else self._base[number]

    def by_function(self, function: int) -> Rating:
        """Rate a function with the best inputs: UNRATED if one is, else LOST if one is."""
        network = self._network
        relations, leaves, lost = 1, 0, False
        price: float = network.costs[function]
        quality = network.functions[function].quality
        for number in network.inputs[function]:
            cost, uses, inputs, by, part = self[number]
            if by < SOURCE:
                if by == NOT_RATED:
                    return UNRATED
                lost = lost or by == NOTHING
            price += cost
            relations += uses
            leaves += inputs
            quality *= part
        if lost:
            return LOST
        return price, relations, leaves, FUNCTION + function, quality

    def rated(self, number: int) -> Optional[Rated]:
        """Return the best derivation of a property and its rating, None if there is none."""
        rating = self[number]
        if rating == LOST:
            return None
        return Rated(rating[:3], rating[4], self.derivation(number))

    def derivation(self, number: int) -> Derivation:
        """Return the best derivation of a property that has one."""
        network, made = self._network, self._made
        stack = [number]
        while stack:
            current = stack.pop()
            if current < 0:  # its inputs are made
                current = ~current
                by = self[current][3] - FUNCTION
                parts = tuple([made[input_] for input_ in network.inputs[by]])
                function = network.functions[by]
                made[current] = Derivation(function.output, None, function, parts)
            elif current not in made:
                if current not in self and self._base is not None:
                    made[current] = self._base.derivation(current)
                    continue
                by = self[current][3] - FUNCTION
                if by >= 0:
                    stack.append(~current)
                    stack.extend(network.inputs[by])
                else:
                    source = self.sources.best(current)
                    made[current] = Derivation(source.property, source, None)
        return made[number]

    def users(self, numbers: Iterable[int]) -> Dict[int, List[int]]:
        """Map each property to those of `numbers` whose best derivations use it at once."""
        users: Dict[int, List[int]] = {}
        for number in numbers:
            by = self[number][3]
            if by >= FUNCTION:
                for input_ in self._network.inputs[by - FUNCTION]:
                    users.setdefault(input_, []).append(number)
        return users


def dependents(users: Mapping[int, Iterable[int]], numbers: Iterable[int]) -> Set[int]:
    """Return some properties, and all that use them at once or through others."""
    found = set(numbers)
    stack = list(found)
    while stack:
        for user in users.get(stack.pop(), ()):
            if user not in found:
                found.add(user)
                stack.append(user)
    return found


class BestDerivations:
    """The best derivations of properties and of everything that they can be derived from.

    `ratings` has each property that was reached. Functions are left out whose number is not
    `usable`, and with `prune` those that cannot be better than a source of their output.
    """

    def __init__(
        self, sources: SourceTable, usable: Optional[Usable] = None, prune: bool = True
    ) -> None:
        self.ratings = Ratings(sources)
        self._network = sources.network
        self._sources = sources
        self._usable = usable
        self._prune = prune
        self._reached: Dict[int, Sequence[int]] = {}  # properties, and their functions
        self._knotted: List[int] = []  # those on cycles, and those that depend on them

    def functions(self, number: int) -> Sequence[int]:
        """Return the functions of a property that are worth following."""
        functions: Sequence[int] = self._network.functions_of[number]
        if self._usable is not None:
            functions = [f for f in functions if self._usable(f)]
        limit = self._sources.rating(number)[0]
        if self._prune:
            functions = [f for f in functions if self._network.costs[f] < limit]
        return functions

    def settle(self, target: int) -> bool:
        """Rate `target` and all that it depends on; return True if it has a derivation."""
        # This loop and that of `Ratings.by_function` are the cost of a search: hence local names.
        reached, functions_of, inputs = self._reached, self.functions, self._network.inputs
        by_source, by_function = self._sources.rating, self.ratings.by_function
        knotted: List[int] = []
        stack = [target]
        while stack:
            number = stack.pop()
            if number >= 0:
                if number not in reached:
                    reached[number] = functions_of(number)
                    stack.append(~number)
                    for function in reached[number]:
                        stack.extend(inputs[function])
                continue
            number = ~number  # its inputs were visited
            best = by_source(number)
            for function in reached[number]:
                rating = by_function(function)
                if rating < best:
                    best = rating
            if best[3] == NOT_RATED:
                knotted.append(number)
            else:
                self.ratings[number] = best
        self.settle_cycle(knotted, self.ratings)
        self._knotted += knotted
        return self.ratings[target] != LOST

    def cycles(self) -> Dict[int, Set[int]]:
        """Map each property that depends on itself to those that depend on one another with it."""
        graph, inputs = nx.DiGraph(), self._network.inputs
        for number in self._knotted:
            graph.add_edges_from((number, i) for f in self._reached[number] for i in inputs[f])
        parts = (part for part in nx.strongly_connected_components(graph) if len(part) > 1)
        return {number: part for part in parts for number in part}

    def settle_cycle(self, members: Iterable[int], ratings: Ratings) -> None:
        """Rate properties that depend on one another, the best first: it is final (Knuth, 1977)."""
        network, by_source = self._network, ratings.sources.rating
        candidates: List[
            Tuple[float, int, int, int, float, int]
        ] = []  # ratings and their properties
        open_ = set(members)
        lacking: Dict[int, int] = {}  # how many inputs a function waits for
        waiting: Dict[int, List[int]] = {}  # the functions that wait for a property
        for number in open_:
            ratings[number] = LOST  # until it is found
        for number in open_:
            if by_source(number) != LOST:
                candidates.append((*by_source(number), number))
            for function in self.functions(number):
                count = 0
                for input_ in network.inputs[function]:
                    if input_ in open_:
                        count += 1
                        waiting.setdefault(input_, []).append(function)
                lacking[function] = count
                if not count:
                    candidates.append((*ratings.by_function(function), number))
        heapify(candidates)
        while candidates:
            candidate = heappop(candidates)
            number = candidate[5]
            if number not in open_:
                continue
            open_.remove(number)
            ratings[number] = candidate[:5]
            for function in waiting.get(number, ()):
                lacking[function] -= 1
                output = network.outputs[function]
                if not lacking[function] and output in open_:
                    heappush(candidates, (*ratings.by_function(function), output))

    def missing(self, target: int) -> List[str]:
        """Return the lost properties in reach of `target` from which all others could be derived.

        They are not the fewest, since each way to the target counts: of each part, a property or
        those that depend on one another, what cannot be derived though all outside can be. What
        depends on the target cannot help it.
        """
        known, network = self.ratings, self._network
        graph = nx.DiGraph()
        open_ = [target]
        while open_:
            number = open_.pop()
            for function in self.functions(number):
                inputs = network.inputs[function]
                lost = [i for i in inputs if known[i] == LOST and target not in inputs]
                open_ += [i for i in lost if i not in graph]
                graph.add_edges_from((number, i) for i in lost)
        found = Ratings(self._sources, known)
        for number in graph:
            found[number] = LOST if number == target else FREE
        named: List[str] = []
        for part in nx.strongly_connected_components(graph):
            if target not in part:
                self.settle_cycle(part, found)
                named += [network.names[each] for each in part if found[each] == LOST]
                for each in part:
                    found[each] = FREE
        return sorted(named)
