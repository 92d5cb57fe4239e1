"""The functions that expressions may use: a fixed list, and nothing else.

Whoever adds one adds a row here, with what it does to units and to ranges, and a row in
docs/ontology.md.
"""
import math
from dataclasses import dataclass, replace
from fractions import Fraction
from typing import Callable, Dict, Mapping, NamedTuple, Optional, Sequence, Union

from shsa_core.language.interval import ANYTHING, Interval
from shsa_core.language.memory import Memory, derivative, integral, lowpass, previous
from shsa_core.language.units import NO_UNIT, SECOND, Quantity, raised, times

CONSTANTS: Mapping[str, float] = {"pi": math.pi}
ELAPSED = "dt"

Common = Callable[[Sequence[Quantity], str], Quantity]
"""The quantity that all of some parts must have; the text says what is wrong if two have not the
same.
"""

UnitRule = Callable[[str, Sequence[Quantity], Common], Quantity]
"""The quantity of a call, from the function's name and the quantities of its arguments."""

RangeRule = Callable[[Sequence[Interval]], Interval]
"""The values of a call, from those of its arguments."""


class Domain(NamedTuple):
    """Where a function of one argument has a value."""

    low: float
    high: float
    zero: bool = True

    def has(self, interval: Interval) -> bool:
        """Whether it has a value everywhere in the interval."""
        inside = self.low <= interval.low and interval.high <= self.high
        return inside and (self.zero or not interval.has_zero)


@dataclass(frozen=True)
class Function:
    """A function without memory: `call` takes `least` to `most` floats and returns one.

    `most` is None where any number will do.

    `domain`: where it has a value, if not everywhere.
    """

    call: Callable[..., float]
    units: UnitRule
    range: RangeRule
    least: int = 1
    most: Optional[int] = 1
    domain: Optional[Domain] = None


@dataclass(frozen=True)
class Stateful:
    """A function with memory: `make(max_gap)` is called once for each place where it is used."""

    make: Callable[[float], Memory]
    units: UnitRule
    range: RangeRule
    arguments: int = 1
    domain: Optional[Domain] = None


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


def _filtered_unit(name: str, parts: Sequence[Quantity], common: Common) -> Quantity:
    common([parts[1], SECOND], "the time constant of " + name + " is in {}, not in {}")
    return parts[0]


def _anything(parts: Sequence[Interval]) -> Interval:
    return ANYTHING


def _same_range(parts: Sequence[Interval]) -> Interval:
    return parts[0]


def _within_one(parts: Sequence[Interval]) -> Interval:
    return Interval(-1.0, 1.0, known=parts[0].known)


def _increasing(call: Callable[[float], float]) -> RangeRule:
    return lambda parts: replace(parts[0], low=call(parts[0].low), high=call(parts[0].high))


def _range_of_abs(parts: Sequence[Interval]) -> Interval:
    (part,) = parts
    ends = (abs(part.low), abs(part.high))
    low = 0.0 if part.low <= 0.0 <= part.high else min(ends)
    return Interval(low, max(ends), part.nonzero, part.known)


def _picked(pick: Callable[..., float]) -> RangeRule:
    def rule(parts: Sequence[Interval]) -> Interval:
        low, high = pick(part.low for part in parts), pick(part.high for part in parts)
        nonzero = not any(part.has_zero for part in parts)
        return Interval(low, high, nonzero, all(part.known for part in parts))

    return rule


def _range_of_hypot(parts: Sequence[Interval]) -> Interval:
    nonzero = not all(part.has_zero for part in parts)
    return Interval(0.0, math.inf, nonzero, all(part.known for part in parts))


_POSITIVE = Domain(0.0, math.inf, zero=False)

FUNCTIONS: Mapping[str, Function] = {
    "abs": Function(abs, _same_unit, _range_of_abs),
    "sign": Function(
        sign,
        lambda name, parts, common: NO_UNIT,
        lambda parts: Interval(-1.0, 1.0, not parts[0].has_zero, parts[0].known),
    ),
    "min": Function(min, _common_unit, _picked(min), 2, None),
    "max": Function(max, _common_unit, _picked(max), 2, None),
    "floor": Function(floor, _same_unit, _anything),
    "ceil": Function(ceil, _same_unit, _anything),
    "sqrt": Function(
        math.sqrt,
        lambda name, parts, common: raised(parts[0], Fraction(1, 2)),
        _increasing(math.sqrt),
        domain=Domain(0.0, math.inf),
    ),
    "exp": Function(math.exp, _no_unit, lambda parts: Interval(0.0, math.inf, nonzero=True)),
    "log": Function(math.log, _no_unit, _anything, domain=_POSITIVE),
    "log10": Function(math.log10, _no_unit, _anything, domain=_POSITIVE),
    "sin": Function(math.sin, _no_unit, _within_one),
    "cos": Function(math.cos, _no_unit, _within_one),
    "tan": Function(math.tan, _no_unit, _anything),
    "asin": Function(math.asin, _no_unit, _anything, domain=Domain(-1.0, 1.0)),
    "acos": Function(math.acos, _no_unit, _anything, domain=Domain(-1.0, 1.0)),
    "atan": Function(math.atan, _no_unit, _increasing(math.atan)),
    "atan2": Function(math.atan2, _ratio, _anything, 2, 2),
    "hypot": Function(math.hypot, _common_unit, _range_of_hypot, 2, 2),
}

STATEFUL: Mapping[str, Stateful] = {
    "derivative": Stateful(
        derivative, lambda name, parts, common: times(parts[0], SECOND, -1), _anything
    ),
    "integral": Stateful(integral, lambda name, parts, common: times(parts[0], SECOND), _anything),
    "previous": Stateful(previous, _same_unit, _same_range),
    "lowpass": Stateful(
        lowpass, _filtered_unit, lambda parts: replace(parts[0], nonzero=False), arguments=2
    ),
}

CALLS: Mapping[str, Union[Function, Stateful]] = {**FUNCTIONS, **STATEFUL}
RESERVED = frozenset([*CONSTANTS, ELAPSED, *CALLS, "require"])


def namespace() -> Dict[str, Callable[..., float]]:
    """The functions without memory by name, for compiled code."""
    return {name: function.call for name, function in FUNCTIONS.items()}
