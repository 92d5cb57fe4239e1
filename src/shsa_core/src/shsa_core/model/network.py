"""The ontology's properties and functions by number: a compact form for the search."""
import copy
from array import array
from typing import Dict, Iterable, List, Sequence, Tuple

from shsa_core.model.quality import UNIT, cost
from shsa_core.model.relation import TransferFunction


RELATION = 64 * UNIT  # dearer than a quality of e**-64


class Network:
    """Functions and properties as numbers, counted from 0; made once for an ontology.

    `functions` are grouped by output, within it in the order of their relations' names: those of
    property p are `first[p]` to `first[p + 1]`. The inputs of function f are the numbers
    `inputs[start[f]:start[f + 1]]`, its output `outputs[f]`, its quality `qualities[f]`, which
    costs `costs[f]`.
    """

    def __init__(self, names: Iterable[str], functions: Sequence[TransferFunction]) -> None:
        self.names: List[str] = []
        self.functions: List[TransferFunction] = []
        self.costs: List[int] = []
        self.qualities = array("d")
        self.first = array("l", [0])
        self.outputs = array("l")
        self.start = array("l", [0])
        self.inputs = array("l")
        self._numbers: Dict[str, int] = {}
        for name in names:
            self._add(name)
        of_output: Dict[str, List[TransferFunction]] = {}
        for function in functions:
            of_output.setdefault(function.output, []).append(function)
            for name in (function.output, *function.inputs):
                self._add(name)
        for number, name in enumerate(self.names):
            for function in sorted(of_output.get(name, ()), key=lambda f: f.relation):
                self.functions.append(function)
                self.outputs.append(number)
                self.costs.append(cost(function.quality))
                self.qualities.append(function.quality)
                self.inputs.extend([self._numbers[input_] for input_ in function.inputs])
                self.start.append(len(self.inputs))
            self.first.append(len(self.functions))

    def smallest_first(self) -> "Network":
        """The same, with each relation so dear that the fewest relations are the best.

        Of as many the best is still the one of the highest quality.
        """
        other = copy.copy(self)
        other.costs = [cost + RELATION for cost in self.costs]
        return other

    def number(self, name: str) -> int:
        """The number of a property. A name that no function has gets a new number."""
        number = self._numbers.get(name)
        if number is None:
            number = self._add(name)
            self.first.append(len(self.functions))
        return number

    def _add(self, name: str) -> int:
        number = self._numbers.setdefault(name, len(self.names))
        if number == len(self.names):
            self.names.append(name)
        return number

    def functions_for(self, name: str) -> Tuple[TransferFunction, ...]:
        """The functions that yield the property `name`, by the name of their relation."""
        number = self._numbers.get(name)
        return () if number is None else tuple(self.functions[f] for f in self.functions_of(number))

    def functions_of(self, number: int) -> range:
        """The numbers of the functions that yield a property."""
        return range(self.first[number], self.first[number + 1])

    def inputs_of(self, function: int) -> "array[int]":
        """The numbers of a function's inputs."""
        return self.inputs[self.start[function] : self.start[function + 1]]
