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
        return self.low <= 0.0 <= self.high and not self.nonzero

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


def product(left: float, right: float) -> float:
    """The product, where 0 times infinity is 0."""
    return 0.0 if 0.0 in (left, right) else left * right


def from_corners(
    operation: Callable[[float, float], float], left: Interval, right: Interval
) -> Interval:
    """The values of an operation that is monotonous in each operand."""
    ends = [operation(a, b) for a in (left.low, left.high) for b in (right.low, right.high)]
    nonzero = not left.has_zero and not right.has_zero
    if any(math.isnan(end) for end in ends):
        return Interval(nonzero=nonzero, known=left.known and right.known)
    return Interval(min(ends), max(ends), nonzero, left.known and right.known)
