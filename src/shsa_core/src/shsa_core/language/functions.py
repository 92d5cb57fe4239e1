"""The functions that expressions may use: a fixed list, and nothing else.

To add one, add a row to one of the tables, and a row to those of units and ranges in shsa_learning.
"""
import math
from bisect import bisect_right
from dataclasses import dataclass
from typing import Any, Callable, Mapping, NamedTuple, Optional, Sequence

from shsa_core.language import memory

CONSTANTS: Mapping[str, float] = {"pi": math.pi}
ELAPSED = "dt"
DELAY, FILTER = "delay", "lowpass"


class Fixed(NamedTuple):
    """Arguments whose values are checked before the function is called.

    They must be numbers or constants, or with `must=False` may be anything, and only numbers are
    checked. `wrong` returns what is wrong with the values, or None.
    """

    places: slice
    wrong: Callable[[Sequence[float]], Optional[str]]
    must: bool = True


@dataclass(frozen=True)
class Function:
    """A function of the language.

    `takes` names its arguments, which `call` gets as floats, and `tells` its result, a float. After
    "..." come more of them, a multiple of `each`; `fewest`, if they may be fewer than are named.
    Of a stateful one, `call` takes the longest gap in s and makes the Memory of one use; `rests`:
    its result becomes its first argument once all arguments have stood still for long.
    """

    takes: str
    tells: str
    call: Callable[..., Any]
    each: int = 1
    fewest: Optional[int] = None
    fixed: Optional[Fixed] = None
    rests: bool = False

    @property
    def least(self) -> int:
        """The fewest arguments."""
        return self.fewest or len(self.takes.replace(", ...", "").split(","))

    @property
    def most(self) -> Optional[int]:
        """The most arguments; None: any number."""
        return None if self.takes.endswith("...") else self.least


def sign(value: float) -> float:
    """Return -1, 0 or 1."""
    return 1.0 if value > 0.0 else -1.0 if value < 0.0 else 0.0


def floor(value: float) -> float:
    """Return the largest whole number that is not greater, as a float."""
    return float(math.floor(value))


def ceil(value: float) -> float:
    """Return the smallest whole number that is not less, as a float."""
    return float(math.ceil(value))


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
    """Return exp(-gamma*((x1 - c1)² + ...)) of pairs x1, c1, x2, c2, ...; 1 where gamma is 0."""
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


def _above_zero(times_s: Sequence[float]) -> Optional[str]:
    good = all(0.0 < time_s < math.inf for time_s in times_s)
    return None if good else "the time must be above 0 s"


_INCREASING = Fixed(slice(1, None, 2), rising)
_ORDERED = Fixed(slice(1, 3), ordered, must=False)
_DELAY = Fixed(slice(1, 2), _above_zero)


FUNCTIONS: Mapping[str, Function] = {
    "abs": Function("x", "the size of x", abs),
    "sign": Function("x", "-1, 0 or 1", sign),
    "min": Function("x, y, ...", "the smallest", min),
    "max": Function("x, y, ...", "the largest", max),
    "floor": Function("x", "the largest whole number that is not greater", floor),
    "ceil": Function("x", "the smallest whole number that is not less", ceil),
    "sqrt": Function("x", "the square root", math.sqrt),
    "exp": Function("x", "e to the x", math.exp),
    "log": Function("x", "the natural logarithm", math.log),
    "log10": Function("x", "the logarithm to the base 10", math.log10),
    "sin": Function("x", "the sine of an angle in rad", math.sin),
    "cos": Function("x", "the cosine of an angle in rad", math.cos),
    "tan": Function("x", "the tangent of an angle in rad", math.tan),
    "asin": Function("x", "the angle in rad whose sine is x", math.asin),
    "acos": Function("x", "the angle in rad whose cosine is x", math.acos),
    "atan": Function("x", "the angle in rad whose tangent is x", math.atan),
    "tanh": Function("x", "the hyperbolic tangent, between -1 and 1", math.tanh),
    "atan2": Function("y, x", "the angle in rad of the point (x, y)", math.atan2),
    "hypot": Function("x, y", "the square root of x² + y²", math.hypot),
    "clip": Function("x, low, high", "x, at least low and at most high", clip, fixed=_ORDERED),
    "dot": Function(
        "w1, x1, w2, x2, ...", "the sum of the products w1·x1 + w2·x2 + ...", dot, 2, 2
    ),
    "rbf": Function(
        "gamma, x1, c1, x2, c2, ...",
        "a radial basis function: exp(-gamma·((x1 - c1)² + (x2 - c2)² + ...))",
        rbf,
        2,
        3,
    ),
    "table": Function(
        "x, x0, y0, x1, y1, ...",
        "straight lines through points; beyond the ends the last y is held",
        table,
        2,
        fixed=_INCREASING,
    ),
}
STATEFUL: Mapping[str, Function] = {
    "derivative": Function(
        "x", "the change of x since its sample before, per second", memory.derivative
    ),
    "integral": Function(
        "x", "the area under x since the start, in seconds times x", memory.integral
    ),
    "previous": Function("x", "x at the evaluation before", memory.previous, rests=True),
    "lowpass": Function(
        "x, tau",
        "x behind a filter of first order with the time constant tau, in s",
        memory.lowpass,
        rests=True,
    ),
    "delay": Function("x, T", "x as it was T seconds ago", memory.delay, fixed=_DELAY, rests=True),
}
CALLS: Mapping[str, Function] = {**FUNCTIONS, **STATEFUL}
RESERVED = frozenset([*CONSTANTS, ELAPSED, *CALLS, "require"])
