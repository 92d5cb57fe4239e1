"""The functions that fitted models are made of, and the ranges of their values."""
import math
from bisect import bisect_right
from functools import reduce
from typing import List, Optional, Sequence

from shsa_core.language.interval import Interval, exponential, negative, product, raised, total

_TWICE = Interval(2.0, 2.0)


def clip(value: float, low: float, high: float) -> float:
    """Return `value`, at least `low` and at most `high`; `high`, where `low` is above it."""
    return min(max(value, low), high)


def dot(*pairs: float) -> float:
    """Return the sum of the products of w1, x1, w2, x2, and so on."""
    rest = iter(pairs)
    result = next(rest) * next(rest)
    for weight, value in zip(rest, rest):
        result += weight * value
    return result


def rbf(gamma: float, *pairs: float) -> float:
    """Return exp(-gamma*d²), where d is the distance of x1, x2, ... from c1, c2, ...

    `pairs` are x1, c1, x2, c2, and so on. Whatever the distance, it is 1 where gamma is 0.
    """
    square = 0.0
    rest = iter(pairs)
    for value, center in zip(rest, rest):
        square += (value - center) * (value - center)
    return math.exp(-gamma * square) if gamma else 1.0


def table(value: float, *points: float) -> float:
    """Interpolate between the points x0, y0, x1, y1, ...; beyond the ends the last y is held."""
    xs, ys = points[::2], points[1::2]
    right = bisect_right(xs, value)
    if value != value:
        return value
    if right == 0 or right == len(xs):
        return ys[min(right, len(ys) - 1)]
    start, stop = xs[right - 1 : right + 1]
    share = (value - start) / (stop - start)
    return ys[right - 1] * (1.0 - share) + ys[right] * share


def rising(xs: Sequence[float]) -> Optional[str]:
    """Return what is wrong with the x of a table, or None."""
    for one, other in zip(xs, xs[1:]):
        if not 0.0 < other - one < math.inf:
            return f"x0, x1, ... must rise: {one:g} and then {other:g} do not"
    return None


def ordered(ends: Sequence[float]) -> Optional[str]:
    """Return what is wrong with two ends, or None."""
    low, high = ends
    return None if low <= high else f"{low:g} is above {high:g}"


def clipped(parts: Sequence[Interval]) -> Interval:
    """Return the range of clip."""
    low, high = clip(*(part.low for part in parts)), clip(*(part.high for part in parts))
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
    if rising(xs) or any(each.low != each.high for each in points[::2]):
        return Interval(known=False)
    ends: List[float] = []
    for ys, pick in (
        ([each.low for each in points[1::2]], min),
        ([each.high for each in points[1::2]], max),
    ):
        curve = [each for pair in zip(xs, ys) for each in pair]
        passed = [y for at, y in zip(xs, ys) if x.low < at < x.high]
        ends.append(pick(table(x.low, *curve), table(x.high, *curve), *passed))
    return Interval(ends[0], ends[1], known=known)
