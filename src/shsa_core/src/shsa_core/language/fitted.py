"""The functions that fitted models are made of."""
import math
from bisect import bisect_right
from typing import Optional, Sequence


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
