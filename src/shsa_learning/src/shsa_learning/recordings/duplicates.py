"""Series that are the same in other words: one is the other, but for a gain and an offset.

No two sensors agree to the last digit, so one of them is computed from the other.
"""
from typing import List, NamedTuple, Optional, Sequence

import numpy as np

from shsa_learning.recordings.recording import Series

LEAST_SAMPLES = 20
LEAST_DISTINCT = 10
MOST_SAMPLES = 2000
SHIFTS = (0, -1, 1, -2, 2)
"""Samples by which one may be later than the other."""
TOLERANCE = 1e-6  # of the spread and the mean: more than what a float32 loses
ODD_SHARE = 0.02
"""Of the samples may differ: where one was lost, the one before it is held."""


class Duplicate(NamedTuple):
    """`second` is `gain` times `first` plus `offset`."""

    first: Series
    second: Series
    gain: float
    offset: float

    def __str__(self) -> str:
        if abs(self.gain - 1.0) < 1e-4 and abs(self.offset) < 1e-4 * np.ptp(self.first.values):
            return f"{self.second} has the values of {self.first}"
        return f"{self.second} is {self.gain:.6g} * ({self.first}) + {self.offset:.6g}"


def duplicates(series: Sequence[Series]) -> List[Duplicate]:
    """All pairs of series that are the same but for a gain and an offset; constants are none."""
    found = []
    for place, first in enumerate(series):
        for second in series[place + 1 :]:
            same = duplicate(first, second)
            if same is not None:
                found.append(same)
    return found


def duplicate(first: Series, second: Series) -> Optional[Duplicate]:
    """How `second` is `first` in other words; None if it is not."""
    if len(second) > len(first):  # the slower one can have all its values from the faster one
        swapped = duplicate(second, first)
        if swapped is None or not swapped.gain:
            return None
        return Duplicate(first, second, 1.0 / swapped.gain, -swapped.offset / swapped.gain)
    rows = np.arange(0, len(second), max(1, len(second) // MOST_SAMPLES))
    place = np.searchsorted(first.time, second.time[rows] + 1e-6, side="right") - 1
    for shift in SHIFTS:
        there = (place + shift >= 0) & (place + shift < len(first)) & (place >= 0)
        x = first.values[(place + shift)[there]]
        y = second.values[rows][there]
        known = np.isfinite(x) & np.isfinite(y)
        line = _line(x[known], y[known])
        if line is not None:
            return Duplicate(first, second, *line)
    return None


def _line(x: np.ndarray, y: np.ndarray) -> Optional[Sequence[float]]:
    """Gain and offset, if the points lie on a line."""
    if len(x) < LEAST_SAMPLES or min(len(np.unique(x)), len(np.unique(y))) < LEAST_DISTINCT:
        return None
    gain, offset = np.polyfit(x - x.mean(), y, 1)
    for _ in range(2):  # once more without the odd ones
        error = np.abs(gain * (x - x.mean()) + offset - y)
        good = error <= np.quantile(error, 1.0 - ODD_SHARE)
        if np.ptp(x[good]) == 0.0:
            return None
        gain, offset = np.polyfit(x[good] - x.mean(), y[good], 1)
    error = np.abs(gain * (x - x.mean()) + offset - y)
    bound = TOLERANCE * (float(np.std(y)) + abs(float(np.mean(y))))
    if np.quantile(error, 1.0 - ODD_SHARE) > bound:
        return None
    return float(gain), float(offset - gain * x.mean())
