"""The ontology's graph by numbers: a compact form for the search."""
from functools import lru_cache
from math import log
from typing import Dict, List, Tuple

import networkx as nx

from shsa_core.model.relation import TransferFunction


UNIT = 2**40
DECIMALS = 10**4


@lru_cache(maxsize=None)
def cost(quality: float) -> int:
    """Return the cost of a quality in (0, 1]: -ln(quality) in whole numbers of 1/UNIT.

    Equal products tie in whatever order they are multiplied: sums of whole numbers are exact, and
    qualities of up to four decimals are split into prime factors first, so that 0.9 * 0.9 costs
    exactly what 0.81 costs. Any quality below 1 costs at least 1.
    """
    numerator = round(quality * DECIMALS)
    if numerator > 0 and numerator / DECIMALS == quality:
        return _log(DECIMALS) - _log(numerator)
    return max(1, round(-log(quality) * UNIT))


def _log(number: int) -> int:
    """Return ln(number) * UNIT, rounded by prime factors: _log(a * b) == _log(a) + _log(b)."""
    total = 0
    factor = 2
    while factor * factor <= number:
        while number % factor == 0:
            total += _log_prime(factor)
            number //= factor
        factor += 1
    return total + (_log_prime(number) if number > 1 else 0)


@lru_cache(maxsize=None)
def _log_prime(prime: int) -> int:
    return round(log(prime) * UNIT)


class Network:
    """Functions and properties by numbers, counted from 0.

    Function f yields the property `outputs[f]` from the properties `inputs[f]` with the quality
    `qualities[f]`, which costs `costs[f]`. The functions of property p are `functions_of[p]`, in
    the order of their relations' names.
    """

    def __init__(self, graph: nx.DiGraph) -> None:
        kinds = graph.nodes(data="kind")
        self.names: List[str] = [node for node, kind in kinds if kind == "property"]
        self.functions: List[TransferFunction] = []
        self.costs: List[int] = []
        self.qualities: List[float] = []
        self.outputs: List[int] = []
        self.inputs: List[Tuple[int, ...]] = []
        self.functions_of: List[range] = []
        self._numbers: Dict[str, int] = {name: number for number, name in enumerate(self.names)}
        for number, name in enumerate(self.names):
            first = len(self.functions)
            for node in sorted(graph.predecessors(name)):
                function = graph.nodes[node]["function"]
                self.functions.append(function)
                self.costs.append(cost(function.quality))
                self.qualities.append(function.quality)
                self.outputs.append(number)
                self.inputs.append(tuple(self._numbers[each] for each in graph.predecessors(node)))
            self.functions_of.append(range(first, len(self.functions)))

    def executable(self, function: int) -> bool:
        """Return True if a function has a law."""
        return self.functions[function].law is not None

    def number(self, name: str) -> int:
        """Return the number of a property; a new number for a name that the graph does not have."""
        number = self._numbers.setdefault(name, len(self.names))
        if number == len(self.names):
            self.names.append(name)
            self.functions_of.append(range(0))
        return number
