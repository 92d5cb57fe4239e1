"""How good the best derivation of each property is, in one block of memory."""
from mmap import mmap
from struct import Struct
from typing import Dict, Iterable, List, Mapping, Optional, Set

from shsa_core.model.network import Network
from shsa_core.search.derivation import FUNCTION, LOST, MOST, NOTHING, NOT_RATED, SOURCE, UNRATED
from shsa_core.search.derivation import Derivation, Rated, Rating, SourceTable

RECORD = Struct("qqqqd")
SIZE, PACK, UNPACK = RECORD.size, RECORD.pack_into, RECORD.unpack_from


class Ratings:
    """The best derivations of properties, by number.

    Of those not rated here, in `base` if there is one.

    The memory is all zeros, that is not rated, and the system provides it where it is first
    written: where a large ontology is not reached it costs nothing.
    """

    def __init__(
        self, network: Network, sources: SourceTable, base: Optional["Ratings"] = None
    ) -> None:
        self._network = network
        self.sources = sources
        self._base = base
        self.memory = mmap(-1, SIZE * (len(network.names) + 1))
        self._made: Dict[int, Derivation] = {}

    def __getitem__(self, number: int) -> Rating:
        cost, relations, inputs, by, quality = UNPACK(self.memory, SIZE * number)
        if by == NOT_RATED and self._base is not None:
            return self._base[number]
        return cost, relations, inputs, by, quality

    def __setitem__(self, number: int, rating: Rating) -> None:
        PACK(self.memory, SIZE * number, *rating)

    def by_function(self, function: int) -> Rating:
        """How good a function is with the best inputs.

        UNRATED if one is not rated, else LOST if one is lost.
        """
        network, memory = self._network, self.memory
        start, relations, leaves, lost = network.start, 1, 0, False
        price, quality = network.costs[function], network.qualities[function]
        for number in network.inputs[start[function] : start[function + 1]]:
            cost, uses, inputs, by, part = UNPACK(memory, SIZE * number)
            if by < SOURCE:
                cost, uses, inputs, by, part = self[number]
                if by == NOT_RATED:
                    return UNRATED
                lost = lost or by == NOTHING
            price += cost
            relations += uses
            leaves += inputs
            quality *= part
        if lost:
            return LOST
        if price > MOST or relations > MOST or leaves > MOST:
            price, relations, leaves = min(price, MOST), min(relations, MOST), min(leaves, MOST)
        return price, relations, leaves, FUNCTION + function, quality

    def rated(self, number: int) -> Optional[Rated]:
        """The best derivation of a property and how good it is, None if there is none."""
        rating = self[number]
        if rating == LOST:
            return None
        return Rated(rating[:3], rating[4], self.derivation(number))

    def derivation(self, number: int) -> Derivation:
        """The best derivation of a property that has one."""
        network, memory, made = self._network, self.memory, self._made
        start, inputs = network.start, network.inputs
        stack = [number]
        while stack:
            current = stack.pop()
            if current < 0:  # its inputs are made
                current = ~current
                by = UNPACK(memory, SIZE * current)[3] - FUNCTION
                parts = tuple([made[input_] for input_ in inputs[start[by] : start[by + 1]]])
                function = network.functions[by]
                made[current] = Derivation(function.output, None, function, parts)
            elif current not in made:
                by = UNPACK(memory, SIZE * current)[3] - FUNCTION
                if by >= 0:
                    stack.append(~current)
                    stack.extend(inputs[start[by] : start[by + 1]])
                elif by == SOURCE - FUNCTION:
                    source = self.sources.best(current)
                    made[current] = Derivation(source.property, source, None)
                else:
                    assert self._base is not None
                    made[current] = self._base.derivation(current)
        return made[number]

    def users(self, numbers: Iterable[int]) -> Dict[int, List[int]]:
        """By property, which of some properties use it at once in their best derivations."""
        users: Dict[int, List[int]] = {}
        for number in numbers:
            by = self[number][3]
            if by >= FUNCTION:
                for input_ in self._network.inputs_of(by - FUNCTION):
                    users.setdefault(input_, []).append(number)
        return users


def dependents(users: Mapping[int, Iterable[int]], numbers: Iterable[int]) -> Set[int]:
    """Some properties, and all that use them at once or through others."""
    found = set(numbers)
    stack = list(found)
    while stack:
        for user in users.get(stack.pop(), ()):
            if user not in found:
                found.add(user)
                stack.append(user)
    return found
