"""Images: the values that a function can have, from those of its arguments.

What is infinite here though its arguments are not has overflowed: `range_check` tells that.
"""
import math
from dataclasses import replace
from typing import Callable, Sequence

from shsa_core.language.interval import Interval

RangeRule = Callable[[Sequence[Interval]], Interval]
"""The values of a call, from those of its arguments."""

Call = Callable[[float], float]
TURN = 2.0 * math.pi
LARGEST_TANGENT = 1e18  # no float is nearer to a pole


def anything(parts: Sequence[Interval]) -> Interval:
    """Any number: known, if the arguments are."""
    return Interval(known=all(part.known for part in parts))


def same(parts: Sequence[Interval]) -> Interval:
    """The first argument."""
    return parts[0]


def filtered(parts: Sequence[Interval]) -> Interval:
    """What lies between values of the first argument."""
    return replace(parts[0], nonzero=False)


def monotonous(call: Call, keeps_zero: bool = False) -> RangeRule:
    """Of a function that only rises, or only falls.

    `keeps_zero`: it is 0 where its argument is, and nowhere else.
    """

    def rule(parts: Sequence[Interval]) -> Interval:
        (part,) = parts
        ends = sorted((at(call, part.low), at(call, part.high)))
        return Interval(ends[0], ends[1], keeps_zero and part.nonzero, part.known)

    return rule


def at(call: Callable[..., float], *values: float) -> float:
    """A function at an end of a range, which may be infinite or make it overflow."""
    try:
        return call(*values)
    except OverflowError:
        return values[0] if math.isinf(values[0]) else math.inf
    except ValueError:  # log(0)
        return -math.inf


def exponential(parts: Sequence[Interval]) -> Interval:
    """Of exp: never 0, save where it is too small for a number."""
    (part,) = parts
    low, high = at(math.exp, part.low), at(math.exp, part.high)
    return Interval(low, high, low > 0.0 or math.isinf(part.low), part.known)


def absolute(parts: Sequence[Interval]) -> Interval:
    """Of abs."""
    (part,) = parts
    return Interval(_nearest(part), _farthest(part), part.nonzero, part.known)


def picked(pick: Callable[..., float]) -> RangeRule:
    """Of min and max."""

    def rule(parts: Sequence[Interval]) -> Interval:
        low, high = pick(part.low for part in parts), pick(part.high for part in parts)
        nonzero = not any(part.has_zero for part in parts)
        return Interval(low, high, nonzero, all(part.known for part in parts))

    return rule


def wave(call: Call, crest: float) -> RangeRule:
    """Of sin and cos: `crest` is where one has a crest; the troughs lie half a turn off."""

    def rule(parts: Sequence[Interval]) -> Interval:
        (part,) = parts
        ends = [call(end) for end in (part.low, part.high) if math.isfinite(end)] or [0.0]
        low = -1.0 if _passes(part, crest + math.pi, TURN) else min(ends)
        high = 1.0 if _passes(part, crest, TURN) else max(ends)
        return Interval(low, high, known=part.known)

    return rule


def tangent(parts: Sequence[Interval]) -> Interval:
    """Of tan, which has a pole every half turn."""
    (part,) = parts
    if _passes(part, math.pi / 2.0, math.pi):
        return Interval(-LARGEST_TANGENT, LARGEST_TANGENT, known=part.known)
    return Interval(math.tan(part.low), math.tan(part.high), part.nonzero, part.known)


def angle(parts: Sequence[Interval]) -> Interval:
    """Of atan2(y, x): a whole turn where (0, 0), or the way from one half turn to the other, is
    among them.
    """
    y, x = parts
    known = y.known and x.known
    if y.low <= 0.0 <= y.high and x.low <= 0.0:
        return Interval(-math.pi, math.pi, y.nonzero, known)
    ends = [math.atan2(b, a) for b in (y.low, y.high) for a in (x.low, x.high)]
    return Interval(min(ends), max(ends), y.nonzero, known)


def distance(parts: Sequence[Interval]) -> Interval:
    """Of hypot."""
    nonzero = not all(part.has_zero for part in parts)
    low = math.hypot(*(_nearest(part) for part in parts))
    high = math.hypot(*(_farthest(part) for part in parts))
    return Interval(low, high, nonzero, all(part.known for part in parts))


def raised(base: Interval, exponent: Interval) -> Interval:
    """Of a power that has a value for all of base and exponent."""
    known = base.known and exponent.known
    whole = exponent.low == exponent.high and exponent.low == round(exponent.low)
    if whole and exponent.low % 2.0 == 0.0:
        base = absolute([base])
    elif not whole and base.low < 0.0:
        return Interval(known=known)  # of a range that is not known: it has been told of, if it is
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
    """Whether the interval holds a point that comes again and again."""
    if math.isinf(part.low) or math.isinf(part.high):
        return True
    slack = 1e-9 * max(1.0, abs(part.low), abs(part.high))
    first = math.ceil((part.low - slack - point) / every)
    return point + first * every <= part.high + slack


def _nearest(part: Interval) -> float:
    """The smallest absolute value."""
    return 0.0 if part.spans_zero else min(abs(part.low), abs(part.high))


def _farthest(part: Interval) -> float:
    """The largest absolute value."""
    return max(abs(part.low), abs(part.high))
