"""Interval arithmetic: the values that a part of an expression can have."""
import math
from dataclasses import dataclass
from typing import Callable


@dataclass(frozen=True)
class Interval:
    """Every value from `low` to `high`.

    If `nonzero`, 0 is not among them. `known`: only declared ranges went into it.
    """

    low: float = -math.inf
    high: float = math.inf
    nonzero: bool = False
    known: bool = True

    @property
    def has_zero(self) -> bool:
        """Whether 0 is one of the values."""
        return self.spans_zero and not self.nonzero

    @property
    def spans_zero(self) -> bool:
        """Whether 0 lies between the ends, or is one of them."""
        return self.low <= 0.0 <= self.high

    @property
    def finite(self) -> bool:
        """Whether both ends are."""
        return math.isfinite(self.low) and math.isfinite(self.high)

    def __str__(self) -> str:
        return f"from {self.low:g} to {self.high:g}"


ANYTHING = Interval(known=False)


def hull(one: Interval, other: Interval) -> Interval:
    """Every value of either."""
    return Interval(
        min(one.low, other.low),
        max(one.high, other.high),
        not one.has_zero and not other.has_zero,
        one.known and other.known,
    )


def negative(one: Interval) -> Interval:
    """Every value with the other sign."""
    return Interval(-one.high, -one.low, one.nonzero, one.known)


def total(left: Interval, right: Interval) -> Interval:
    """Every sum."""
    low, high = left.low + right.low, left.high + right.high
    return Interval(
        -math.inf if math.isnan(low) else low,
        math.inf if math.isnan(high) else high,
        known=left.known and right.known,
    )


def product(left: float, right: float) -> float:
    """The product, where 0 times infinity is 0."""
    return 0.0 if 0.0 in (left, right) else left * right


def from_corners(
    operation: Callable[[float, float], float], left: Interval, right: Interval
) -> Interval:
    """The values of an operation that is monotonous in each operand."""
    ends = [operation(a, b) for a in (left.low, left.high) for b in (right.low, right.high)]
    nonzero = not left.has_zero and not right.has_zero
    nonzero = nonzero and (left.spans_zero or right.spans_zero)  # the ends tell of the others
    if any(math.isnan(end) for end in ends):
        return Interval(nonzero=nonzero, known=left.known and right.known)
    return Interval(min(ends), max(ends), nonzero, left.known and right.known)
