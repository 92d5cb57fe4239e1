"""How far what a derivation yields is expected to be from the truth.

By first-order propagation (JCGM 100:2008, 5.1 and 5.2): each error of a service or of a relation
goes on with the derivatives of the relations behind it. What has one cause is added with its sign
before it is squared, biases as well. docs/ontology.md tells what is taken for granted.
"""
from dataclasses import dataclass, replace
from math import isnan, nan, sqrt
from random import Random
from typing import Dict, Iterable, List, Mapping, Optional, Sequence, Tuple, Union

from shsa_core.codegen.generator import generate, in_order
from shsa_core.codegen.program import Step, compile_steady
from shsa_core.errors import GenerationError
from shsa_core.model.error import Error
from shsa_core.model.ontology import Ontology
from shsa_core.model.relation import TransferFunction
from shsa_core.model.service import Provision, Service, Source
from shsa_core.model.som import Som
from shsa_core.search.derivation import Derivation

POINTS = 32
"""At so many points the derivatives are taken and the errors averaged; the same ones each time."""
ENOUGH = POINTS // 4
"""A law that has a value at fewer of them is not known well enough."""
P95 = 1.959964
"""Of a normal distribution: what its size is within in 95 %, in standard deviations."""
REMEMBERED = 10_000
"""So many derivations and parts of them are known again; then it begins anew."""
SMALLEST_STEP = 1e-4
"""Of a difference quotient, as a share of what is usual."""

Cause = Union[Source, Tuple[str, str]]
"""What an error comes from: a source, or a relation and its output."""
Values = Sequence[float]
"""By point; NaN where there is none."""


@dataclass(frozen=True)
class _Part:
    """The error of one part of a derivation at each point, its cause by cause.

    `told`: the error that is known as a whole, if nothing else is in it.
    """

    bias: Values
    spread: Mapping[Cause, Values]
    delay: float
    told: Optional[Error] = None

    @property
    def is_none(self) -> bool:
        """Whether there is no error in it."""
        return not self.spread and not any(self.bias)

    def variances(self) -> List[float]:
        """By point."""
        sums = [0.0] * POINTS
        for values in self.spread.values():
            sums = [sum_ + value * value for sum_, value in zip(sums, values)]
        return sums

    def squares(self) -> List[float]:
        """The mean square of the error at each point."""
        return [var + bias * bias for var, bias in zip(self.variances(), self.bias)]


class Predictor:
    """Predicts the errors of derivations by an ontology and all services of a SOM.

    The error of a relation was measured with inputs as good as usual: an input adds only what it is
    worse than the best service of its property.
    """

    def __init__(self, ontology: Ontology, sources: Iterable[Source]) -> None:
        self._ontology = ontology
        self._usual: Dict[str, Error] = {}
        self._best: Dict[str, float] = {}  # the highest quality of a property's services
        self._ranges: Dict[str, Tuple[float, float]] = {}
        self._baselines: Dict[str, float] = {}
        self._steps: Dict[int, Optional[Step]] = {}  # by function
        self._numbers: Dict[Tuple[object, ...], int] = {}  # of what is derived in the same way
        self._errors: Dict[int, Optional[Error]] = {}  # by such a number
        for function in ontology.functions:
            self._take_baseline(function.output, function.error)
        for source in sources:
            name, error = source.property, source.provision.error
            self._take_baseline(name, error)
            self._best[name] = max(source.quality, self._best.get(name, 0.0))
            if error is not None and (name not in self._usual or error.rms < self._usual[name].rms):
                self._usual[name] = error
            if source.provision.range is not None:
                self._ranges.setdefault(name, source.provision.range)
        for name, property_ in ontology.properties.items():
            if property_.usual is not None:
                self._ranges[name] = property_.usual

    def baseline(self, name: str) -> Optional[float]:
        """The RMS error of who always says the mean of a property; None: not known."""
        return self._baselines.get(name)

    def of(self, derivations: Sequence[Derivation]) -> List[Optional[Error]]:
        """The expected error of each of some derivations, in its property's unit; None: not known.

        What they share is worked out once.
        """
        if len(self._numbers) > REMEMBERED:
            self._numbers.clear()
            self._errors.clear()
        work = _Work(self)
        found = []
        for derivation in derivations:
            number = self.number(derivation)
            if number not in self._errors:
                self._errors[number] = work.error(derivation)
            found.append(self._errors[number])
        return found

    def number(self, derivation: Derivation) -> int:
        """The same number for all derivations that do the same."""
        numbers: Dict[Derivation, int] = {}
        for node in in_order([derivation]):
            way: Tuple[object, ...] = id(node.function), *(numbers[each] for each in node.inputs)
            if node.source is not None:
                way = node.source.service.name, node.property
            numbers[node] = self._numbers.setdefault(way, len(self._numbers))
        return numbers[derivation]

    def points(self, name: str) -> Optional[Values]:
        """Values that a property usually has, spread evenly; None if it is not known which."""
        limits = self._ranges.get(name)
        if limits is None:
            return None
        order = list(range(POINTS))
        Random(name).shuffle(order)  # of each property another order, and always the same
        return [limits[0] + (limits[1] - limits[0]) * (k + 0.5) / POINTS for k in order]

    def usual(self, name: str) -> Optional[Error]:
        """The error of the best service of a property; None: not known."""
        return self._usual.get(name)

    def is_usual(self, source: Source) -> bool:
        """Whether a source whose error is not known is as good as any of its property."""
        name = source.property
        return name not in self._usual and source.quality >= self._best.get(name, 0.0)

    def step(self, function: TransferFunction) -> Optional[Step]:
        """What a function yields of inputs that stand still; None if that says nothing of it."""
        if id(function) not in self._steps:
            self._steps[id(function)] = _compiled(function, self._ontology)
        return self._steps[id(function)]

    def _take_baseline(self, name: str, error: Optional[Error]) -> None:
        if error is not None and error.baseline is not None:
            self._baselines[name] = max(error.baseline, self._baselines.get(name, 0.0))


def predictor(ontology: Ontology, sources: Iterable[Source]) -> Optional[Predictor]:
    """Who predicts errors by an ontology and the services of a SOM; None if no errors are known."""
    sources = tuple(sources)
    errors = any(source.provision.error is not None for source in sources)
    if not errors and all(function.error is None for function in ontology.functions):
        return None
    return Predictor(ontology, sources)


def predict(derivation: Derivation, ontology: Ontology, som: Som) -> Optional[Error]:
    """The expected error of a derivation, in its property's unit; None: not known."""
    found = predictor(ontology, som.sources)
    return None if found is None else found.of([derivation])[0]


class _Work:
    """Errors and values of the parts of some derivations, each worked out once."""

    def __init__(self, predictor_: Predictor) -> None:
        self._predictor = predictor_
        self._parts: Dict[Derivation, Optional[_Part]] = {}
        self._values: Dict[Derivation, Optional[Values]] = {}

    def error(self, derivation: Derivation) -> Optional[Error]:
        """The expected error of a derivation."""
        for node in in_order([derivation]):
            if node not in self._parts:
                self._parts[node] = self._part(node)
        part = self._parts[derivation]
        if part is None:
            return None
        baseline = self._predictor.baseline(derivation.property)
        if part.told is not None:
            told = part.told
            p95 = P95 * told.rms if told.p95 is None else told.p95
            return replace(told, p95=p95, delay=part.delay, baseline=told.baseline or baseline)
        rms = sqrt(_mean(part.squares()))
        if isnan(rms):
            return None
        return Error(rms, _mean(part.bias), P95 * rms, part.delay, baseline, None, "predicted")

    def _part(self, node: Derivation) -> Optional[_Part]:
        if node.source is not None:
            return _told(node.source, node.source.provision.error)
        function = node.function
        if function is None or function.law is None:
            return None
        own = _told((function.relation, function.output), function.error)
        if own is None:
            if function.quality < 1.0:
                return None  # it is not exact, and nobody knows how far off
            own = _Part([0.0] * POINTS, {}, 0.0)
        excess = [self._excess(input_, function.error is not None) for input_ in node.inputs]
        added = [part for part in excess if part is not None]
        if len(added) < len(excess):
            return None
        delay = own.delay + max((part.delay for part in added), default=0.0)
        if all(part.is_none for part in added):
            return replace(own, delay=delay)
        slopes = self._slopes(node, added)
        return None if slopes is None else _sum(own, added, slopes, delay)

    def _excess(self, node: Derivation, measured: bool) -> Optional[_Part]:
        """What the error of an input adds: all of it, or what it has above the usual one.

        The latter where the relation was `measured`. None: not known.
        """
        part = self._parts[node]
        usual = self._predictor.usual(node.property)
        if part is None:
            unknown = not measured or node.source is None
            if unknown or not self._predictor.is_usual(node.source):  # type: ignore[arg-type]
                return None
            return _Part([0.0] * POINTS, {}, 0.0)
        if not measured or usual is None:
            return part
        if part.told is not None and part.told == usual:
            return _Part([0.0] * POINTS, {}, 0.0)
        have = _mean(part.variances())
        share = sqrt(max(0.0, 1.0 - _variance(usual) / have)) if have > 0.0 else 0.0
        return _Part(
            [bias - usual.bias for bias in part.bias],
            {cause: _times(values, share) for cause, values in part.spread.items() if share > 0.0},
            max(0.0, part.delay - usual.delay),
        )

    def _slopes(self, node: Derivation, added: Sequence[_Part]) -> Optional[List[Values]]:
        """How fast what a function yields changes with each input, at each point.

        By differences as wide as the input's error: where a law bends, that is what the error sees.
        """
        assert node.function is not None
        step = self._predictor.step(node.function)
        inputs = [self._values_of(input_) for input_ in node.inputs]
        if step is None:
            return None
        columns = [values for values in inputs if values is not None]
        if len(columns) < len(inputs):
            return None
        rows = list(zip(*columns))
        slopes: List[Values] = []
        for number, part in enumerate(added):
            if part.is_none:
                slopes.append([0.0] * POINTS)
                continue
            sizes = [abs(value) for value in columns[number] if not isnan(value)]
            least = SMALLEST_STEP * (max(sizes, default=0.0) or 1.0)
            widths = (max(least, sqrt(square)) for square in part.squares())
            slopes.append([_slope(step, x, number, width) for x, width in zip(rows, widths)])
        return slopes

    def _values_of(self, derivation: Derivation) -> Optional[Values]:
        """The true values of a part at each point: usual ones, or computed of its inputs'."""
        for node in in_order([derivation]):
            if node not in self._values:
                self._values[node] = self._computed(node) or self._predictor.points(node.property)
        return self._values[derivation]

    def _computed(self, node: Derivation) -> Optional[Values]:
        step = None if node.function is None else self._predictor.step(node.function)
        columns = [self._values[input_] for input_ in node.inputs]
        known = [column for column in columns if column is not None]
        if step is None or len(known) < len(columns):
            return None
        return [_value(step, x) for x in (zip(*known) if known else [()] * POINTS)]


def _told(cause: Cause, error: Optional[Error]) -> Optional[_Part]:
    if error is None:
        return None
    deviation = sqrt(_variance(error))
    spread = {cause: [deviation] * POINTS} if deviation else {}
    return _Part([error.bias] * POINTS, spread, error.delay, error)


def _variance(error: Error) -> float:
    return max(0.0, error.rms**2 - error.bias**2)


def _sum(own: _Part, added: Sequence[_Part], slopes: Sequence[Values], delay: float) -> _Part:
    """The error of a function's result: its own, and its inputs' as it passes them on."""
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
    """The difference quotient about a point, to one side where the other has no value."""
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


def _times(values: Values, factor: float) -> Values:
    return [value * factor for value in values]


def _mean(values: Values) -> float:
    """Over the points that have a value; NaN if they are too few."""
    known = [value for value in values if not isnan(value)]
    return sum(known) / len(known) if len(known) >= ENOUGH else nan


def _compiled(function: TransferFunction, ontology: Ontology) -> Optional[Step]:
    """A function alone, as a substitute would compute it once its inputs stand still."""
    inputs = tuple(Derivation(name, _source(name), None) for name in function.inputs)
    derivation = Derivation(function.output, None, function, inputs)
    try:
        program = generate([(derivation, "/output/data")], ontology.constants)
    except GenerationError:
        return None
    return compile_steady(program.code, len(inputs), 1)


def _source(name: str) -> Source:
    return Service(name, "/" + name, "", "", None, (Provision(name, "data"),)).sources[0]
