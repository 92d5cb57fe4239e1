"""The ontology: properties and the relations between them (Section III of the paper)."""
from bisect import bisect_left
from dataclasses import dataclass, field
from functools import lru_cache
from math import log
from typing import Iterable, Mapping, Optional, Sequence, Tuple

import networkx as nx

from shsa_core.language.expression import Condition, Law
from shsa_core.model.error import Error

UNIT = 2**40
DECIMALS = 10**4


@dataclass(frozen=True)
class Property:
    """A quantity of the robot. `unit` is its unit as text, `""` if it is not known.

    `usual`: the lowest and highest value that it usually has, None: not known; `where`: file and
    line.
    """

    name: str
    unit: str = ""
    symbol: str = ""
    where: str = field(default="", compare=False, repr=False)
    usual: Optional[Tuple[float, float]] = None


@dataclass(frozen=True)
class Constant:
    """A property that never changes; `value` in `unit`."""

    name: str
    value: float
    unit: str = ""
    where: str = field(default="", compare=False, repr=False)


@dataclass(frozen=True)
class TransferFunction:
    """One direction of a relation: computes the property `output` from the properties `inputs`.

    `inputs` are the properties that the law or the constraint names, in order of first use;
    constants are not among them. `law` is None where the file has a function that cannot be
    executed: it takes part in the search and is refused at generation. `quality` is in (0, 1].
    Where `constraint` is false there is no output. `text` is the function as it was written,
    `error` that of its output with inputs as good as usual (None: not known), `where` the file and
    line.
    """

    relation: str
    output: str
    inputs: Tuple[str, ...]
    law: Optional[Law]
    quality: float = 1.0
    constraint: Optional[Condition] = None
    text: str = ""
    where: str = field(default="", compare=False, repr=False)
    error: Optional[Error] = None


@lru_cache(maxsize=None)
def cost(quality: float) -> int:
    """Return the cost of a quality in (0, 1]: -ln(quality) in whole numbers of 1/UNIT, exact sums.

    Qualities of up to four decimals are split into prime factors first, so that 0.9 * 0.9 costs
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
            total += round(log(factor) * UNIT)
            number //= factor
        factor += 1
    return total + (round(log(number) * UNIT) if number > 1 else 0)


class Network:
    """Functions and properties by numbers, counted from 0.

    Function f yields the property `outputs[f]` from the properties `inputs[f]` with a quality that
    costs `costs[f]`. The functions of property p are `functions_of[p]`, in the order of their
    relations' names.
    """

    def __init__(self, properties: Iterable[str], functions: Sequence[TransferFunction]) -> None:
        named = [name for each in functions for name in (each.output, *each.inputs)]
        self.names = list(dict.fromkeys((*properties, *named)))
        numbers = self._numbers = {name: number for number, name in enumerate(self.names)}
        self.functions = sorted(functions, key=lambda each: (numbers[each.output], each.relation))
        self.costs = [cost(each.quality) for each in self.functions]
        self.outputs = [numbers[each.output] for each in self.functions]
        self.inputs = [tuple(numbers[name] for name in each.inputs) for each in self.functions]
        firsts = [bisect_left(self.outputs, number) for number in range(len(self.names) + 1)]
        self.functions_of = [range(*ends) for ends in zip(firsts, firsts[1:])]

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


@dataclass(frozen=True)
class Ontology:
    """Properties, constants and relations; immutable once made.

    `graph` is the bipartite graph of properties and functions. The node of a property is its name
    (`kind="property"`), that of a function the pair of its relation and its output
    (`kind="relation"`, `function`). Edges lead from inputs to functions to outputs. `network` is
    the form of it that the search uses.
    """

    properties: Mapping[str, Property]
    constants: Mapping[str, Constant]
    functions: Sequence[TransferFunction]
    graph: nx.DiGraph = field(init=False, repr=False, compare=False)
    network: Network = field(init=False, repr=False, compare=False)

    def __post_init__(self) -> None:
        graph = nx.DiGraph()
        graph.add_nodes_from(self.properties, kind="property")
        for function in self.functions:
            node = (function.relation, function.output)
            graph.add_nodes_from((function.output, *function.inputs), kind="property")
            graph.add_node(node, kind="relation", function=function, quality=function.quality)
            graph.add_edges_from((name, node) for name in function.inputs)
            graph.add_edge(node, function.output)
        object.__setattr__(self, "graph", graph)
        object.__setattr__(self, "network", Network(self.properties, self.functions))


EMPTY = Ontology({}, {}, ())
"""Nothing is known, and so nothing is compared."""
