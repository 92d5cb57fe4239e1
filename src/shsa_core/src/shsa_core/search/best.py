"""The best derivation of every property that a target depends on.

Each is settled once, inputs first: depth first where properties do not depend on one another, and
by Knuth's algorithm where they do (D. E. Knuth: A generalization of Dijkstra's algorithm,
Information Processing Letters 6, 1977).
"""
from array import array
from heapq import heapify, heappop, heappush
from mmap import mmap
from typing import Callable, Dict, Iterable, List, Optional, Sequence, Tuple

from shsa_core.model.network import Network
from shsa_core.search.derivation import LOST, MOST, NOT_RATED, SourceTable
from shsa_core.search.missing import lacking
from shsa_core.search.ratings import Ratings

Usable = Callable[[int], bool]
DONE = 2**62  # later than any visit
RETURN = -1  # on the stack: all inputs of the last property on the path were visited


def zeros(count: int) -> "memoryview":
    """Whole numbers, all 0, in memory that the system provides where it is touched."""
    return memoryview(mmap(-1, 8 * (count + 1))).cast("q")


class BestDerivations:
    """The best derivations of properties and of everything that they can be derived from.

    `ratings` has each property that was reached; `cycles` maps a property to those that depend on
    one another with it. With `prune`, functions that cannot be better than a source of their output
    are left out, as are those whose number is not `usable`. `tick` is called at every step and may
    raise to stop.
    """

    def __init__(
        self,
        network: Network,
        sources: SourceTable,
        usable: Optional[Usable] = None,
        prune: bool = True,
        tick: Optional[Callable[[], None]] = None,
    ) -> None:
        self.ratings = Ratings(network, sources)
        self.cycles: Dict[int, Sequence[int]] = {}
        self._network = network
        self._sources = sources
        self._usable = usable
        self._prune = prune
        self._tick = tick
        self._order = zeros(len(network.names))  # of the visits, from 1
        self._visited = 0

    def functions(self, number: int) -> Sequence[int]:
        """The functions of a property that are worth following."""
        functions: Sequence[int] = self._network.functions_of(number)
        if self._usable is not None:
            functions = [f for f in functions if self._usable(f)]
        limit = self._sources.rating(number)[0]
        if self._prune and limit <= MOST:
            functions = [f for f in functions if self._network.costs[f] < limit]
        return functions

    def settle(self, target: int) -> bool:
        """Rates `target` and all that it depends on. Whether it has a derivation."""
        # This loop and those in ratings.py are the cost of a search: hence the local names.
        ratings, order, tick, functions_of = self.ratings, self._order, self._tick, self.functions
        first, start, inputs = self._network.first, self._network.start, self._network.inputs
        by_source, by_function = self._sources.rating, ratings.by_function
        path: List[
            Tuple[int, Sequence[int], int]
        ] = []  # property, functions, how many were pending before
        pending: List[int] = []  # the properties on cycles that are not complete yet
        stack = [target]
        while stack:
            number = stack.pop()
            if number != RETURN:
                if order[number]:
                    continue
                if tick is not None:
                    tick()
                if first[number] == first[number + 1]:
                    ratings[number] = by_source(number)
                    order[number] = DONE
                    continue
                self._visited += 1
                order[number] = self._visited
                functions = functions_of(number)
                path.append((number, functions, len(pending)))
                stack.append(RETURN)
                for function in functions:
                    stack.extend(inputs[start[function] : start[function + 1]])
                continue
            number, functions, before = path.pop()
            best = by_source(number)
            for function in functions:
                rating = by_function(function)
                if rating < best:
                    best = rating
                    if rating[3] == NOT_RATED:
                        break
            else:
                ratings[number] = best
                order[number] = DONE
                continue
            # Inputs that are not rated lie on a cycle with this property; the earliest closes it
            # (Tarjan, 1972).
            pending.append(number)
            earliest = min([order[i] for f in functions for i in self._network.inputs_of(f)])
            if earliest < order[number]:
                order[number] = earliest
                continue
            members = pending[before:]
            del pending[before:]
            self.cycles.update(dict.fromkeys(members, members))
            self.settle_cycle(members, ratings)
            for member in members:
                order[member] = DONE
        return ratings[target] != LOST

    def settle_cycle(self, members: Iterable[int], ratings: Ratings) -> None:
        """Rates properties that depend on one another; whatever else they depend on is rated.

        A derivation is worse than each of its parts, so the best of all candidates is final (Knuth,
        1977).
        """
        network, by_source = self._network, ratings.sources.rating
        candidates: List[Tuple[int, int, int, int, float, int]] = []  # ratings and their properties
        open_ = zeros(len(network.names))
        lacking = zeros(len(network.functions))  # how many inputs a function waits for
        # The functions that wait for a property, as a linked list: from `last` on, each with the
        # place of the next.
        last = zeros(len(network.names))
        waiting, next_ = array("q", [0]), array("q", [0])
        for number in members:
            open_[number] = 1
            ratings[number] = LOST  # until it is found
        for number in members:
            if by_source(number) != LOST:
                candidates.append((*by_source(number), number))
            for function in self.functions(number):
                for input_ in network.inputs_of(function):
                    if open_[input_]:
                        lacking[function] += 1
                        next_.append(last[input_])
                        last[input_] = len(waiting)
                        waiting.append(function)
                if not lacking[function]:
                    candidates.append((*ratings.by_function(function), number))
        heapify(candidates)
        while candidates:
            if self._tick is not None:
                self._tick()
            candidate = heappop(candidates)
            number = candidate[5]
            if not open_[number]:
                continue
            open_[number] = 0
            ratings[number] = candidate[:5]
            place = last[number]
            while place:
                function, place = waiting[place], next_[place]
                lacking[function] -= 1
                if not lacking[function]:
                    output = network.outputs[function]
                    if open_[output]:
                        heappush(candidates, (*ratings.by_function(function), output))

    def missing(self, target: int, ratings: Optional[Ratings] = None) -> List[str]:
        """The properties without which every derivation of `target` ended, in order of their names.

        With all of them it could be derived; see `lacking`. Usually fewer would do: each way that
        has ended is told of. What depends on the target itself cannot help it.
        """
        rated = self.ratings if ratings is None else ratings
        inputs_of = self._network.inputs_of

        def lost_inputs(number: int) -> List[List[int]]:
            of = map(inputs_of, self.functions(number))
            return [
                [i for i in inputs if rated[i] == LOST] for inputs in of if target not in inputs
            ]

        return sorted(self._network.names[number] for number in lacking(target, lost_inputs))
