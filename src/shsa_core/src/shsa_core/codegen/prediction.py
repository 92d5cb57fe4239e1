"""Predicts how far the result of a derivation is from the truth.

By first-order propagation (JCGM 100:2008, 5.1 and 5.2): each error of a service or of a relation
goes on with the derivatives of the relations behind it. What has one cause is added with its sign
before it is squared, biases as well. docs/explanation/errors.md has the assumptions.
"""
from copy import copy
from dataclasses import dataclass, replace
from math import isnan, nan, sqrt
from random import Random
from typing import Collection, Dict, Iterable, List, Mapping, Optional, Sequence, Tuple, Union

from shsa_core.codegen.generator import Fusion, generate_function, in_order, way
from shsa_core.codegen.program import Step, compile_steady
from shsa_core.errors import GenerationError
from shsa_core.model.error import P95, Error
from shsa_core.model.ontology import Ontology, TransferFunction
from shsa_core.model.service import Source
from shsa_core.search.derivation import Derivation

POINTS = 32
"""The points at which derivatives are taken and errors averaged; the same ones each time."""
ENOUGH = POINTS // 4
"""A law that has a value at fewer points is not known well enough."""
REMEMBERED = 4_000
"""The most derivations and parts of them that are kept; then all are dropped."""
SMALLEST_STEP = 1e-4
"""Of a difference quotient, as a share of the usual value."""

Cause = Union[Source, Tuple[str, str]]
"""The origin of an error: a source, or a relation and its output."""
Values = Sequence[float]
"""By point; NaN where there is none."""


@dataclass(frozen=True)
class _Part:
    """The error of one part of a derivation at each point, cause by cause.

    `told`: the error that is known as a whole, if nothing else is in it.
    """

    bias: Values
    spread: Mapping[Cause, Values]
    delay: float
    told: Optional[Error] = None

    @property
    def is_none(self) -> bool:
        """True if there is no error in it."""
        return not self.spread and not any(self.bias)

    def variances(self) -> List[float]:
        """Return the variance at each point."""
        return [sum(value * value for value in at) for at in zip(_ZERO, *self.spread.values())]

    def squares(self) -> List[float]:
        """Return the mean square of the error at each point."""
        return [var + bias * bias for var, bias in zip(self.variances(), self.bias)]


_ZERO = [0.0] * POINTS
_EXACT = _Part(_ZERO, {}, 0.0)


class Predictor:
    """Predicts the errors of derivations by an ontology and all services of a SOM.

    The error of a relation was measured with inputs as good as usual: an input adds only what it is
    worse than the best service of its property.
    """

    def __init__(self, ontology: Ontology, sources: Collection[Source]) -> None:
        self._ontology = ontology
        self._usual: Dict[str, Error] = {}
        self._best: Dict[str, float] = {}  # the highest quality of a property's services
        self._ranges: Dict[str, Tuple[float, float]] = {}
        self.baselines: Dict[str, float] = {}  # the RMS error of always saying the mean
        self._steps: Dict[int, Optional[Step]] = {}  # by function
        self._functions: Dict[int, Optional[TransferFunction]] = {}  # they live on, with their ids
        self._numbers: Dict[Tuple[object, ...], int] = {}  # of what is derived in the same way
        self._parts: Dict[int, Optional[_Part]] = {}  # by such a number
        self._values: Dict[int, Optional[Values]] = {}
        self._measured: Mapping[str, Error] = {}
        self.fusions: Sequence[Fusion] = ()
        known = [(each.property, each.provision.error) for each in sources]
        for name, error in [*((each.output, each.error) for each in ontology.functions), *known]:
            if error is not None and error.baseline is not None:
                self.baselines[name] = max(error.baseline, self.baselines.get(name, 0.0))
        for source in sources:
            name, error = source.property, source.provision.error
            self._best[name] = max(source.quality, self._best.get(name, 0.0))
            if error is not None and (name not in self._usual or error.rms < self._usual[name].rms):
                self._usual[name] = error
            if source.provision.range is not None:
                self._ranges.setdefault(name, source.provision.range)
        for name, property_ in ontology.properties.items():
            if property_.usual is not None:
                self._ranges[name] = property_.usual

    def knowing(self, measured: Mapping[str, Error], fusions: Sequence[Fusion] = ()) -> "Predictor":
        """Return it with errors that were `measured`, by their `way`, and proven fusions."""
        found = copy(self)
        found._measured, found.fusions = measured, fusions
        return found

    def measured(self, derivation: Derivation) -> Optional[Error]:
        """Return the error of a derivation that was measured; None: it was not."""
        found = self._measured.get(way(derivation)) if self._measured else None
        return found and replace(found, baseline=self.baselines.get(derivation.property))

    def of(self, derivations: Sequence[Derivation]) -> List[Optional[Error]]:
        """Return the error of each derivation as measured, else as expected; None: not known."""
        expected = zip(derivations, self.expected(derivations))
        return [self.measured(each) or error for each, error in expected]

    def expected(self, derivations: Sequence[Derivation]) -> List[Optional[Error]]:
        """Return the expected error of each derivation, in its property's unit; None: not known."""
        if len(self._numbers) > REMEMBERED:
            self._numbers.clear()
            self._parts.clear()
            self._values.clear()
        return [self._error(derivation) for derivation in derivations]

    def number(self, derivation: Derivation) -> int:
        """Return the same number for all derivations that do the same."""
        return self._numbered(derivation)[derivation]

    def _numbered(self, derivation: Derivation) -> Dict[Derivation, int]:
        """Return the numbers of a derivation and its parts, inputs first."""
        numbers: Dict[Derivation, int] = {}
        for node in in_order([derivation]):
            way: Tuple[object, ...] = id(node.function), *(numbers[each] for each in node.inputs)
            self._functions[id(node.function)] = node.function
            if node.source is not None:
                way = node.source.service.name, node.property
            numbers[node] = self._numbers.setdefault(way, len(self._numbers))
        return numbers

    def _error(self, derivation: Derivation) -> Optional[Error]:
        numbers = self._numbered(derivation)
        for node, number in numbers.items():
            if number not in self._parts:
                self._parts[number] = self._part(node, numbers)
        part = self._parts[numbers[derivation]]
        if part is None:
            return None
        baseline = self.baselines.get(derivation.property)
        if part.told is not None:
            told = part.told
            baseline = told.baseline or baseline
            return replace(told, p95=told.within, delay=part.delay, baseline=baseline)
        rms = sqrt(_mean(part.squares()))
        if isnan(rms):
            return None
        return Error(rms, _mean(part.bias), P95 * rms, part.delay, baseline, None, "predicted")

    def _part(self, node: Derivation, numbers: Mapping[Derivation, int]) -> Optional[_Part]:
        if node.source is not None:
            return _told(node.source, node.source.provision.error)
        function = node.function
        if function is None or function.law is None:
            return None
        own = _told((function.relation, function.output), function.error)
        if own is None:
            if function.quality < 1.0:
                return None  # it is not exact, and nobody knows how far off
            own = _EXACT
        parts = [self._parts[numbers[input_]] for input_ in node.inputs]
        if function.error is not None:
            parts = [self._above_usual(*each) for each in zip(node.inputs, parts)]
        added = [part for part in parts if part is not None]
        if len(added) < len(parts):
            return None
        delay = own.delay + max((part.delay for part in added), default=0.0)
        if all(part.is_none for part in added):
            return replace(own, delay=delay)
        slopes = self._slopes(node, added, numbers)
        return None if slopes is None else _sum(own, added, slopes, delay)

    def _above_usual(self, node: Derivation, part: Optional[_Part]) -> Optional[_Part]:
        """Return what an input's error has above the usual one; None: not known."""
        usual = self._usual.get(node.property)
        if part is None:  # without figures it is as good as the best source of the property, or not
            source = node.source
            best = self._best.get(node.property, 0.0)
            as_good = source is not None and usual is None and source.quality >= best
            return _EXACT if as_good else None
        if usual is None:
            return part
        if part.told is not None and part.told == usual:
            return _EXACT
        have = _mean(part.variances())
        share = sqrt(max(0.0, 1.0 - _variance(usual) / have)) if have > 0.0 else 0.0
        spread = part.spread.items() if share > 0.0 else ()
        return _Part(
            [bias - usual.bias for bias in part.bias],
            {cause: [share * v for v in values] for cause, values in spread},
            max(0.0, part.delay - usual.delay),
        )

    def _slopes(
        self, node: Derivation, added: Sequence[_Part], numbers: Mapping[Derivation, int]
    ) -> Optional[List[Values]]:
        """Return how a result changes with each input, by differences as wide as its error."""
        step = self._step(node.function)
        columns = self._columns(node, numbers)
        if step is None or columns is None:
            return None
        rows = list(zip(*columns))
        slopes: List[Values] = []
        for number, part in enumerate(added):
            if part.is_none:
                slopes.append(_ZERO)
                continue
            sizes = [abs(value) for value in columns[number] if not isnan(value)]
            least = SMALLEST_STEP * (max(sizes, default=0.0) or 1.0)
            widths = (max(least, sqrt(square)) for square in part.squares())
            slopes.append([_slope(step, x, number, width) for x, width in zip(rows, widths)])
        return slopes

    def _columns(
        self, node: Derivation, numbers: Mapping[Derivation, int]
    ) -> Optional[List[Values]]:
        """Return the true values of a function's inputs at each point; None: not known."""
        for part in in_order(node.inputs):
            if numbers[part] not in self._values:
                step, columns = self._step(part.function), self._known(part, numbers)
                values = self._points(part.property)
                if step is not None and columns is not None:
                    rows = zip(*columns) if columns else [()] * POINTS
                    values = [_value(step, x) for x in rows]
                self._values[numbers[part]] = values
        return self._known(node, numbers)

    def _known(self, node: Derivation, numbers: Mapping[Derivation, int]) -> Optional[List[Values]]:
        columns = [self._values[numbers[input_]] for input_ in node.inputs]
        known = [column for column in columns if column is not None]
        return known if len(known) == len(columns) else None

    def _points(self, name: str) -> Optional[Values]:
        """Return values that a property usually has, spread evenly; None: not known."""
        limits = self._ranges.get(name)
        if limits is None:
            return None
        order = list(range(POINTS))
        Random(name).shuffle(order)  # of each property another order, and always the same
        return [limits[0] + (limits[1] - limits[0]) * (k + 0.5) / POINTS for k in order]

    def _step(self, function: Optional[TransferFunction]) -> Optional[Step]:
        """Return a function of inputs that stand still; None if that says nothing of it."""
        if function is None:
            return None
        if id(function) not in self._steps:
            try:
                code = generate_function(function, self._ontology.constants).code
                step = compile_steady(code, len(function.inputs), 1)
            except GenerationError:
                step = None
            self._steps[id(function)] = step
        return self._steps[id(function)]


def predictor(ontology: Ontology, sources: Iterable[Source]) -> Optional[Predictor]:
    """Return a predictor for an ontology and the services of a SOM; None if no errors are known."""
    sources = tuple(sources)
    errors = any(source.provision.error is not None for source in sources)
    if not errors and all(function.error is None for function in ontology.functions):
        return None
    return Predictor(ontology, sources)


def _told(cause: Cause, error: Optional[Error]) -> Optional[_Part]:
    if error is None:
        return None
    deviation = sqrt(_variance(error))
    spread = {cause: [deviation] * POINTS} if deviation else {}
    return _Part([error.bias] * POINTS, spread, error.delay, error)


def _variance(error: Error) -> float:
    return max(0.0, error.rms**2 - error.bias**2)


def _sum(own: _Part, added: Sequence[_Part], slopes: Sequence[Values], delay: float) -> _Part:
    """Return the error of a function's result: its own, and its inputs' as it passes them on."""
    bias = own.bias
    spread: Dict[Cause, Values] = dict(own.spread)
    for part, slope in zip(added, slopes):
        bias = [sum_ + k * value for sum_, k, value in zip(bias, slope, part.bias)]
        for cause, values in part.spread.items():
            passed = [k * value for k, value in zip(slope, values)]
            if cause in spread:
                passed = [one + other for one, other in zip(passed, spread[cause])]
            spread[cause] = passed
    return _Part(bias, spread, delay)


def _slope(step: Step, x: Sequence[float], number: int, width: float) -> float:
    """Return the difference quotient at a point, to one side where the other has no value."""
    there = list(x)
    there[number] = low = x[number] - width
    before = _value(step, there)
    there[number] = high = x[number] + width
    after = _value(step, there)
    if isnan(before):
        low, before = x[number], _value(step, x)
    elif isnan(after):
        high, after = x[number], _value(step, x)
    return (after - before) / (high - low)


def _value(step: Step, x: Sequence[float]) -> float:
    result = step(x, 0.0)
    return nan if result is None else result[0]


def _mean(values: Values) -> float:
    """Return the mean over the points that have a value; NaN if they are too few."""
    known = [value for value in values if not isnan(value)]
    return sum(known) / len(known) if len(known) >= ENOUGH else nan
