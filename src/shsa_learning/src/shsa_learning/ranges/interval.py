"""Interval arithmetic: the values that a part of an expression can have.

An infinite end, though the arguments are finite, is an overflow, which `analysis` reports.
"""
import math
from dataclasses import dataclass, replace
from typing import Callable, Sequence

TURN = 2.0 * math.pi
LARGEST_TANGENT = 1e18  # no float is nearer to a pole


@dataclass(frozen=True)
class Interval:
    """All values from `low` to `high`, without 0 if `nonzero`.

    `known`: it was computed from declared ranges alone.
    """

    low: float = -math.inf
    high: float = math.inf
    nonzero: bool = False
    known: bool = True

    @property
    def has_zero(self) -> bool:
        """True if 0 is one of the values."""
        return self.spans_zero and not self.nonzero

    @property
    def spans_zero(self) -> bool:
        """True if 0 lies between the ends, or is one of them."""
        return self.low <= 0.0 <= self.high

    @property
    def finite(self) -> bool:
        """True if both ends are finite."""
        return math.isfinite(self.low) and math.isfinite(self.high)

    def __str__(self) -> str:
        return f"from {self.low:g} to {self.high:g}"


ANYTHING = Interval(known=False)

RangeRule = Callable[[Sequence[Interval]], Interval]
"""Map the ranges of a call's arguments to the range of its value."""


def hull(one: Interval, other: Interval) -> Interval:
    """Return the values of both."""
    return Interval(
        min(one.low, other.low),
        max(one.high, other.high),
        not one.has_zero and not other.has_zero,
        one.known and other.known,
    )


def negative(one: Interval) -> Interval:
    """Return the range of -x."""
    return Interval(-one.high, -one.low, one.nonzero, one.known)


def total(left: Interval, right: Interval) -> Interval:
    """Return the range of x + y."""
    low, high = left.low + right.low, left.high + right.high
    return Interval(
        -math.inf if math.isnan(low) else low,
        math.inf if math.isnan(high) else high,
        known=left.known and right.known,
    )


def product(left: Interval, right: Interval) -> Interval:
    """Return the range of x * y."""
    return from_corners(lambda a, b: 0.0 if 0.0 in (a, b) else a * b, left, right)


def from_corners(
    operation: Callable[[float, float], float], left: Interval, right: Interval
) -> Interval:
    """Return the range of an operation that is monotonous in each operand."""
    ends = [operation(a, b) for a in (left.low, left.high) for b in (right.low, right.high)]
    nonzero = not left.has_zero and not right.has_zero
    nonzero = nonzero and (left.spans_zero or right.spans_zero)  # the ends tell of the others
    if any(math.isnan(end) for end in ends):
        return Interval(nonzero=nonzero, known=left.known and right.known)
    return Interval(min(ends), max(ends), nonzero, left.known and right.known)


def anything(parts: Sequence[Interval]) -> Interval:
    """Return all numbers: known, if the arguments are."""
    return Interval(known=all(part.known for part in parts))


def same(parts: Sequence[Interval]) -> Interval:
    """Return the range of the first argument."""
    return parts[0]


def filtered(parts: Sequence[Interval]) -> Interval:
    """Return the range of what lies between values of the first argument."""
    return replace(parts[0], nonzero=False)


def monotonous(call: Callable[[float], float], keeps_zero: bool = False) -> RangeRule:
    """Return the rule of a function that only rises, or only falls.

    `keeps_zero`: it is 0 where its argument is, and nowhere else.
    """

    def rule(parts: Sequence[Interval]) -> Interval:
        (part,) = parts
        ends = sorted((_at(call, part.low), _at(call, part.high)))
        return Interval(ends[0], ends[1], keeps_zero and part.nonzero, part.known)

    return rule


def _at(call: Callable[[float], float], end: float) -> float:
    """Return the value at an end of a range, which may be infinite or make it overflow."""
    try:
        return call(end)
    except OverflowError:
        return end if math.isinf(end) else math.inf
    except ValueError:  # log(0)
        return -math.inf


def exponential(parts: Sequence[Interval]) -> Interval:
    """Return the range of exp: never 0, save where it is too small for a number."""
    (part,) = parts
    low, high = _at(math.exp, part.low), _at(math.exp, part.high)
    return Interval(low, high, low > 0.0 or math.isinf(part.low), part.known)


def absolute(parts: Sequence[Interval]) -> Interval:
    """Return the range of abs."""
    (part,) = parts
    return Interval(_nearest(part), _farthest(part), part.nonzero, part.known)


def picked(pick: Callable[..., float]) -> RangeRule:
    """Return the rule of min or max."""

    def rule(parts: Sequence[Interval]) -> Interval:
        low, high = pick(part.low for part in parts), pick(part.high for part in parts)
        nonzero = not any(part.has_zero for part in parts)
        return Interval(low, high, nonzero, all(part.known for part in parts))

    return rule


def wave(call: Callable[[float], float], crest: float) -> RangeRule:
    """Return the rule of sin or cos, which has a crest at `crest` and a trough half a turn off."""

    def rule(parts: Sequence[Interval]) -> Interval:
        (part,) = parts
        ends = [call(end) for end in (part.low, part.high) if math.isfinite(end)] or [0.0]
        low = -1.0 if _passes(part, crest + math.pi, TURN) else min(ends)
        high = 1.0 if _passes(part, crest, TURN) else max(ends)
        return Interval(low, high, known=part.known)

    return rule


def tangent(parts: Sequence[Interval]) -> Interval:
    """Return the range of tan, which has a pole every half turn."""
    (part,) = parts
    if _passes(part, math.pi / 2.0, math.pi):
        return Interval(-LARGEST_TANGENT, LARGEST_TANGENT, known=part.known)
    return Interval(math.tan(part.low), math.tan(part.high), part.nonzero, part.known)


def angle(parts: Sequence[Interval]) -> Interval:
    """Return the range of atan2(y, x): all angles if the negative half of the x axis is touched."""
    y, x = parts
    known = y.known and x.known
    if y.low <= 0.0 <= y.high and x.low <= 0.0:
        return Interval(-math.pi, math.pi, y.nonzero, known)
    ends = [math.atan2(b, a) for b in (y.low, y.high) for a in (x.low, x.high)]
    return Interval(min(ends), max(ends), y.nonzero, known)


def distance(parts: Sequence[Interval]) -> Interval:
    """Return the range of hypot."""
    nonzero = not all(part.has_zero for part in parts)
    low = math.hypot(*(_nearest(part) for part in parts))
    high = math.hypot(*(_farthest(part) for part in parts))
    return Interval(low, high, nonzero, all(part.known for part in parts))


def raised(base: Interval, exponent: Interval) -> Interval:
    """Return the range of a power that has a value for all of base and exponent."""
    known = base.known and exponent.known
    whole = exponent.low == exponent.high and exponent.low == round(exponent.low)
    if whole and exponent.low % 2.0 == 0.0:
        base = absolute([base])
    elif not whole and base.low < 0.0:
        return Interval(known=known)  # a known range was reported before
    ends = [
        _power(b, e, base) for b in (base.low, base.high) for e in (exponent.low, exponent.high)
    ]
    if any(math.isnan(end) for end in ends):
        return Interval(known=known)
    if base.low < 0.0 < base.high and exponent.high < 0.0:
        return Interval(nonzero=True, known=known)
    return Interval(min(ends), max(ends), base.nonzero, known)


def _power(base: float, exponent: float, of: Interval) -> float:
    try:
        return math.pow(base, exponent)
    except OverflowError:
        return -math.inf if base < 0.0 else math.inf
    except ValueError:  # 0 to a negative exponent: an open end
        return -math.inf if of.high == 0.0 and exponent % 2.0 == 1.0 else math.inf


def _passes(part: Interval, point: float, every: float) -> bool:
    """Return True if the interval holds `point`, or a point some multiple of `every` away."""
    if not part.finite:
        return True
    slack = 1e-9 * max(1.0, abs(part.low), abs(part.high))
    first = math.ceil((part.low - slack - point) / every)
    return point + first * every <= part.high + slack


def _nearest(part: Interval) -> float:
    return 0.0 if part.spans_zero else min(abs(part.low), abs(part.high))


def _farthest(part: Interval) -> float:
    return max(abs(part.low), abs(part.high))
