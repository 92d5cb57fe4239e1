"""The range of each function's value, and where it has one; a test sees that none is left out."""
import math
from functools import reduce
from typing import List, Mapping, NamedTuple, Optional, Sequence

from shsa_core.language import functions
from shsa_learning.ranges import interval
from shsa_learning.ranges.interval import Interval, RangeRule, exponential, negative, product
from shsa_learning.ranges.interval import raised, total

_TWICE = Interval(2.0, 2.0)


class Domain(NamedTuple):
    """The values of one `argument`, counted from 0, for which a function has a value."""

    low: float
    high: float = math.inf
    zero: bool = True
    argument: int = 0

    def has(self, part: Interval) -> bool:
        """Return True if the function has a value everywhere in the interval."""
        inside = self.low <= part.low and part.high <= self.high
        return inside and (self.zero or not part.has_zero)


class Rule(NamedTuple):
    """The range of a function's value by those of its arguments; `domain`: None is anywhere."""

    range: RangeRule
    domain: Optional[Domain] = None


def clipped(parts: Sequence[Interval]) -> Interval:
    """Return the range of clip."""
    low, high = functions.clip(*(part.low for part in parts)), functions.clip(
        *(part.high for part in parts)
    )
    nonzero = not any(part.has_zero for part in parts)
    return Interval(low, high, nonzero, all(part.known for part in parts))


def summed(parts: Sequence[Interval]) -> Interval:
    """Return the range of dot."""
    return reduce(total, map(product, parts[::2], parts[1::2]))


def bell(parts: Sequence[Interval]) -> Interval:
    """Return the range of rbf."""
    gamma, *pairs = parts
    differences = map(total, pairs[::2], map(negative, pairs[1::2]))
    square = reduce(total, (raised(each, _TWICE) for each in differences))
    return exponential([negative(product(gamma, square))])


def looked_up(parts: Sequence[Interval]) -> Interval:
    """Return the range of table."""
    x, points = parts[0], parts[1:]
    xs = [each.low for each in points[::2]]
    known = all(part.known for part in parts)
    if functions.rising(xs) or any(each.low != each.high for each in points[::2]):
        return Interval(known=False)
    ends: List[float] = []
    for ys, pick in (
        ([each.low for each in points[1::2]], min),
        ([each.high for each in points[1::2]], max),
    ):
        curve = [each for pair in zip(xs, ys) for each in pair]
        passed = [y for at, y in zip(xs, ys) if x.low < at < x.high]
        ends.append(pick(functions.table(x.low, *curve), functions.table(x.high, *curve), *passed))
    return Interval(ends[0], ends[1], known=known)


RULES: Mapping[str, Rule] = {
    "abs": Rule(interval.absolute),
    "sign": Rule(interval.monotonous(functions.sign, True)),
    "min": Rule(interval.picked(min)),
    "max": Rule(interval.picked(max)),
    "floor": Rule(interval.monotonous(functions.floor)),
    "ceil": Rule(interval.monotonous(functions.ceil)),
    "sqrt": Rule(interval.monotonous(math.sqrt, True), Domain(0.0)),
    "exp": Rule(interval.exponential),
    "log": Rule(interval.monotonous(math.log), Domain(0.0, zero=False)),
    "log10": Rule(interval.monotonous(math.log10), Domain(0.0, zero=False)),
    "sin": Rule(interval.wave(math.sin, math.pi / 2.0)),
    "cos": Rule(interval.wave(math.cos, 0.0)),
    "tan": Rule(interval.tangent),
    "asin": Rule(interval.monotonous(math.asin, True), Domain(-1.0, 1.0)),
    "acos": Rule(interval.monotonous(math.acos), Domain(-1.0, 1.0)),
    "atan": Rule(interval.monotonous(math.atan, True)),
    "tanh": Rule(interval.monotonous(math.tanh, True)),
    "atan2": Rule(interval.angle),
    "hypot": Rule(interval.distance),
    "clip": Rule(clipped),
    "dot": Rule(summed),
    "rbf": Rule(bell),
    "table": Rule(looked_up),
    "derivative": Rule(interval.anything),
    "integral": Rule(interval.anything),
    "previous": Rule(interval.same),
    "lowpass": Rule(interval.filtered, Domain(0.0, zero=False, argument=1)),
    "delay": Rule(interval.same),
}
"""By function."""
