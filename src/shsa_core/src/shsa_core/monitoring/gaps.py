"""How far two values of one property are apart, and how far they may be by their known errors."""
from collections import deque
from math import hypot
from typing import Deque, Optional

from shsa_core.model.error import Error

LOOKS = 10
RMS_FACTOR, P95_FACTOR = 4.0, 2.0
"""A value may be so many rms, and so many times its p95, from the truth: errors last for seconds.

What lasts for as long as a look back does not average out; p95 is of single moments.
"""


class Gap:
    """The differences of the last LOOKS looks in a row at which both values were there."""

    def __init__(self) -> None:
        self._differences: Deque[float] = deque(maxlen=LOOKS)

    def add(self, one: Optional[float], other: Optional[float]) -> None:
        """Take a look; a value that is missing makes it begin anew."""
        if one is None or other is None:
            self._differences.clear()
        else:
            self._differences.append(abs(one - other))

    @property
    def mean(self) -> Optional[float]:
        """The mean of the magnitudes; None before there were LOOKS of them."""
        if len(self._differences) < LOOKS:
            return None
        return sum(self._differences) / LOOKS


def spread(error: Optional[Error]) -> Optional[float]:
    """How far a value with this error may be from the truth, in its unit; None: not known."""
    if error is None:
        return None
    return max(RMS_FACTOR * error.rms, P95_FACTOR * (error.p95 or 0.0))


def apart_at_most(one: Optional[float], other: Optional[float]) -> Optional[float]:
    """How far two values may be apart whose errors know nothing of each other."""
    return None if one is None or other is None else hypot(one, other)
