"""The functions that expressions may use: a fixed list, and nothing else.

Whoever adds one adds a row here, with what it does to units and to ranges, and a row in
docs/ontology.md.
"""
import math
from dataclasses import dataclass
from fractions import Fraction
from typing import Callable, Dict, Mapping, NamedTuple, Optional, Sequence, Union

from shsa_core.language import fitted, images
from shsa_core.language.images import RangeRule
from shsa_core.language.interval import Interval
from shsa_core.language.memory import MAX_DELAY_S, Memory
from shsa_core.language.memory import delay, derivative, integral, lowpass, previous
from shsa_core.language.units import NO_UNIT, SECOND, Quantity, raised, times

CONSTANTS: Mapping[str, float] = {"pi": math.pi}
ELAPSED = "dt"
FILTER, DELAY = "lowpass", "delay"
"""What lets one input of a law come later than another: the names of these functions."""

Common = Callable[[Sequence[Quantity], str], Quantity]
"""The quantity that all of some parts must have; the text says what is wrong if two have not the
same.
"""

UnitRule = Callable[[str, Sequence[Quantity], Common], Quantity]
"""The quantity of a call, from the function's name and the quantities of its arguments."""


class Domain(NamedTuple):
    """Where a function has a value: by its `argument`, counted from 0."""

    low: float
    high: float
    zero: bool = True
    argument: int = 0

    def has(self, interval: Interval) -> bool:
        """Whether it has a value everywhere in the interval."""
        inside = self.low <= interval.low and interval.high <= self.high
        return inside and (self.zero or not interval.has_zero)


class Fixed(NamedTuple):
    """Arguments that must be numbers or constants, so that they are known before it is called.

    `wrong`: what is wrong with their values, if anything. Without `must` they may be anything, and
    only numbers are looked at.
    """

    places: slice
    wrong: Callable[[Sequence[float]], Optional[str]]
    must: bool = True


@dataclass(frozen=True)
class Function:
    """A function without memory: `call` takes `least` to `most` floats and returns one.

    `most` is None where any number will do that is `least` and some times `each`.

    `domain`: where it has a value, if not everywhere. `takes`, `tells`: its arguments, and what it
    yields, in the documentation.
    """

    call: Callable[..., float]
    units: UnitRule
    range: RangeRule
    least: int = 1
    most: Optional[int] = 1
    domain: Optional[Domain] = None
    each: int = 1
    fixed: Optional[Fixed] = None
    takes: str = "x"
    tells: str = ""


@dataclass(frozen=True)
class Stateful:
    """A function with memory: `make(max_gap)` is called once for each place where it is used.

    `rests`: it yields its first argument once all have stood still for long. `takes`, `tells`: as
    of a Function.
    """

    make: Callable[[float], Memory]
    units: UnitRule
    range: RangeRule
    arguments: int = 1
    domain: Optional[Domain] = None
    fixed: Optional[Fixed] = None
    rests: bool = False
    takes: str = "x"
    tells: str = ""


def sign(value: float) -> float:
    """-1, 0 or 1."""
    return 1.0 if value > 0.0 else -1.0 if value < 0.0 else 0.0


def floor(value: float) -> float:
    """The largest whole number that is not greater, as a float."""
    return float(math.floor(value))


def ceil(value: float) -> float:
    """The smallest whole number that is not less, as a float."""
    return float(math.ceil(value))


def power(base: float, exponent: float) -> float:
    """`base` to the `exponent`, in real numbers alone: a negative base needs a whole exponent."""
    return math.pow(base, exponent)


def _same_unit(name: str, parts: Sequence[Quantity], common: Common) -> Quantity:
    return parts[0]


def _common_unit(name: str, parts: Sequence[Quantity], common: Common) -> Quantity:
    return common(parts, name + " of {} and {}")


def _no_unit(name: str, parts: Sequence[Quantity], common: Common) -> Quantity:
    common([parts[0], NO_UNIT], name + " of {}, it needs {}")
    return NO_UNIT


def _ratio(name: str, parts: Sequence[Quantity], common: Common) -> Quantity:
    common(parts, name + " of {} and {}")
    return NO_UNIT


def _timed_unit(what: str) -> UnitRule:
    def rule(name: str, parts: Sequence[Quantity], common: Common) -> Quantity:
        common([parts[1], SECOND], f"the {what} of {name} is in {{}}, not in {{}}")
        return parts[0]

    return rule


def _sum_unit(name: str, parts: Sequence[Quantity], common: Common) -> Quantity:
    products = [times(*pair) for pair in zip(parts[::2], parts[1::2])]
    return common(products, name + " adds {} and {}")


def _bell_unit(name: str, parts: Sequence[Quantity], common: Common) -> Quantity:
    gamma, *pairs = parts
    for pair in zip(pairs[::2], pairs[1::2]):
        distance = common(pair, name + " of {} from {}")
        exponent = times(gamma, raised(distance, Fraction(2)))
        common([exponent, NO_UNIT], "the exponent of " + name + " is in {}, it needs {}")
    return NO_UNIT


def _table_unit(name: str, parts: Sequence[Quantity], common: Common) -> Quantity:
    common([parts[0], *parts[1::2]], name + " of {} by {}")
    return common(parts[2::2], name + " gives {} and {}")


def _within_delay(times_s: Sequence[float]) -> Optional[str]:
    good = all(0.0 < time_s <= MAX_DELAY_S for time_s in times_s)
    return None if good else f"the time must be above 0 and at most {MAX_DELAY_S:g} s"


_POSITIVE = Domain(0.0, math.inf, zero=False)

FUNCTIONS: Mapping[str, Function] = {
    "abs": Function(abs, _same_unit, images.absolute, tells="the size of x"),
    "sign": Function(
        sign,
        lambda name, parts, common: NO_UNIT,
        images.monotonous(sign, keeps_zero=True),
        tells="-1, 0 or 1",
    ),
    "min": Function(
        min, _common_unit, images.picked(min), 2, None, takes="x, y, ...", tells="the smallest"
    ),
    "max": Function(
        max, _common_unit, images.picked(max), 2, None, takes="x, y, ...", tells="the largest"
    ),
    "floor": Function(
        floor,
        _same_unit,
        images.monotonous(floor),
        tells="the largest whole number that is not greater",
    ),
    "ceil": Function(
        ceil,
        _same_unit,
        images.monotonous(ceil),
        tells="the smallest whole number that is not less",
    ),
    "sqrt": Function(
        math.sqrt,
        lambda name, parts, common: raised(parts[0], Fraction(1, 2)),
        images.monotonous(math.sqrt, keeps_zero=True),
        domain=Domain(0.0, math.inf),
        tells="the square root",
    ),
    "exp": Function(math.exp, _no_unit, images.exponential, tells="e to the x"),
    "log": Function(
        math.log,
        _no_unit,
        images.monotonous(math.log),
        domain=_POSITIVE,
        tells="the natural logarithm",
    ),
    "log10": Function(
        math.log10,
        _no_unit,
        images.monotonous(math.log10),
        domain=_POSITIVE,
        tells="the logarithm to the base 10",
    ),
    "sin": Function(
        math.sin,
        _no_unit,
        images.wave(math.sin, math.pi / 2.0),
        tells="the sine of an angle in rad",
    ),
    "cos": Function(
        math.cos, _no_unit, images.wave(math.cos, 0.0), tells="the cosine of an angle in rad"
    ),
    "tan": Function(math.tan, _no_unit, images.tangent, tells="the tangent of an angle in rad"),
    "asin": Function(
        math.asin,
        _no_unit,
        images.monotonous(math.asin, True),
        domain=Domain(-1.0, 1.0),
        tells="the angle in rad whose sine is x",
    ),
    "acos": Function(
        math.acos,
        _no_unit,
        images.monotonous(math.acos),
        domain=Domain(-1.0, 1.0),
        tells="the angle in rad whose cosine is x",
    ),
    "atan": Function(
        math.atan,
        _no_unit,
        images.monotonous(math.atan, True),
        tells="the angle in rad whose tangent is x",
    ),
    "tanh": Function(
        math.tanh,
        _no_unit,
        images.monotonous(math.tanh, True),
        tells="the hyperbolic tangent, between -1 and 1",
    ),
    "atan2": Function(
        math.atan2,
        _ratio,
        images.angle,
        2,
        2,
        takes="y, x",
        tells="the angle in rad of the point (x, y)",
    ),
    "hypot": Function(
        math.hypot,
        _common_unit,
        images.distance,
        2,
        2,
        takes="x, y",
        tells="the square root of x² + y²",
    ),
    "clip": Function(
        fitted.clip,
        _common_unit,
        fitted.clipped,
        3,
        3,
        fixed=Fixed(slice(1, 3), fitted.ordered, must=False),
        takes="x, low, high",
        tells="x, at least low and at most high",
    ),
    "dot": Function(
        fitted.dot,
        _sum_unit,
        fitted.summed,
        2,
        None,
        each=2,
        takes="w1, x1, w2, x2, ...",
        tells="the sum of the products w1·x1 + w2·x2 + ...",
    ),
    "rbf": Function(
        fitted.rbf,
        _bell_unit,
        fitted.bell,
        3,
        None,
        each=2,
        takes="gamma, x1, c1, x2, c2, ...",
        tells="a radial basis function: exp(-gamma·((x1 - c1)² + (x2 - c2)² + ...))",
    ),
    "table": Function(
        fitted.table,
        _table_unit,
        fitted.looked_up,
        5,
        None,
        each=2,
        fixed=Fixed(slice(1, None, 2), fitted.rising),
        takes="x, x0, y0, x1, y1, ...",
        tells="straight lines through points; beyond the ends the last y is held",
    ),
}

STATEFUL: Mapping[str, Stateful] = {
    "derivative": Stateful(
        derivative,
        lambda name, parts, common: times(parts[0], SECOND, -1),
        images.anything,
        tells="the change of x since the evaluation before, per second",
    ),
    "integral": Stateful(
        integral,
        lambda name, parts, common: times(parts[0], SECOND),
        images.anything,
        tells="the area under x since the start, in seconds times x",
    ),
    "previous": Stateful(
        previous, _same_unit, images.same, rests=True, tells="x at the evaluation before"
    ),
    "lowpass": Stateful(
        lowpass,
        _timed_unit("time constant"),
        images.filtered,
        arguments=2,
        domain=Domain(0.0, math.inf, zero=False, argument=1),
        rests=True,
        takes="x, tau",
        tells="x behind a filter of first order with the time constant tau, in s",
    ),
    "delay": Stateful(
        delay,
        _timed_unit("time"),
        images.same,
        arguments=2,
        fixed=Fixed(slice(1, 2), _within_delay),
        rests=True,
        takes="x, T",
        tells="x as it was T seconds ago",
    ),
}

CALLS: Mapping[str, Union[Function, Stateful]] = {**FUNCTIONS, **STATEFUL}
RESERVED = frozenset([*CONSTANTS, ELAPSED, *CALLS, "require"])


def namespace() -> Dict[str, Callable[..., float]]:
    """The functions without memory by name, for compiled code."""
    return {name: function.call for name, function in FUNCTIONS.items()}
