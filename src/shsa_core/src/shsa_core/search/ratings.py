"""Rates derivations: the best one of each property, by number."""
from typing import Dict, Iterable, List, Mapping, Optional, Set

from shsa_core.search.derivation import FUNCTION, LOST, NOTHING, NOT_RATED, SOURCE, UNRATED
from shsa_core.search.derivation import Derivation, Rated, Rating, SourceTable


class Ratings:
    """The best derivations of properties, by number; those not rated here are as in `base`."""

    def __init__(self, sources: SourceTable, base: Optional["Ratings"] = None) -> None:
        self._network = sources.network
        self.sources = sources
        self._base = base
        self._ratings: Dict[int, Rating] = {}
        self._made: Dict[int, Derivation] = {}

    def __getitem__(self, number: int) -> Rating:
        rating = self._ratings.get(number)
        if rating is None:
            return UNRATED if self._base is None else self._base[number]
        return rating

    def __setitem__(self, number: int, rating: Rating) -> None:
        self._ratings[number] = rating

    def by_function(self, function: int) -> Rating:
        """Rate a function with the best inputs: UNRATED if one is, else LOST if one is."""
        network, known = self._network, self._ratings.get
        relations, leaves, lost = 1, 0, False
        price: float = network.costs[function]
        quality = network.qualities[function]
        for number in network.inputs[function]:
            cost, uses, inputs, by, part = known(number) or self[number]
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
                by = self._ratings[current][3] - FUNCTION
                parts = tuple([made[input_] for input_ in network.inputs[by]])
                function = network.functions[by]
                made[current] = Derivation(function.output, None, function, parts)
            elif current not in made:
                if current not in self._ratings and self._base is not None:
                    made[current] = self._base.derivation(current)
                    continue
                by = self._ratings[current][3] - FUNCTION
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
