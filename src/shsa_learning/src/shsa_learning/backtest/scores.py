"""Scores: how far values are from what was measured."""
import math
from typing import NamedTuple, Optional, Sequence

import numpy as np
from scipy import signal

from shsa_core.model.error import Error
from shsa_learning.backtest.rehearsal import Played, joined
from shsa_learning.figures import error_of, rms
from shsa_learning.recordings.recording import Series, held

MINUTE_S = 60.0
LOOK_EVERY_S = 10.0
MOST_DELAY_S = 2.0
LEAST_SHIFTS, MOST_SHIFTS = 10, 1000
LEAST_POINTS = 20
"""With fewer there is no delay, and no minute of its own."""
LEAST_CORRELATION = 0.3
"""With less, nothing says that one follows the other."""


class WorstMinute(NamedTuple):
    """The 60 s with the largest error: `rms`, and their begin in s after the recording's."""

    rms: float
    begin: float
    recording: int


class Delay(NamedTuple):
    """By how much values are late, in s, and how exactly that is known."""

    seconds: float
    resolution: float


class Score(NamedTuple):
    """Figures of what a derivation yielded.

    `error`: against what was measured; its `baseline` is the rms of the mean of that. `share`: of
    the measured time, with output. `resolution`: of its delay in s; None: no delay was found.
    `range`: of what was measured, largest minus smallest.
    """

    error: Error
    share: float
    worst: WorstMinute
    resolution: Optional[float]
    range: float

    @property
    def charged(self) -> float:
        """The rms of who says the mean where there is no output: what is seldom is no best."""
        baseline = self.error.baseline or 0.0
        return math.sqrt(self.share * self.error.rms**2 + (1.0 - self.share) * baseline**2)

    @property
    def nrmse(self) -> Optional[float]:
        """The rms over the range; None where nothing changed."""
        return self.error.rms / self.range if self.range else None


@np.errstate(over="ignore", invalid="ignore")  # a law can yield any finite number
def score(parts: Sequence[Played]) -> Optional[Score]:
    """Score what was played, one part a recording; None where there was no output."""
    values, measured = joined(parts)
    there = np.isfinite(values)
    if not there.any():
        return None
    wrong = values[there] - measured[there]
    delay = delay_of(parts)
    late = delay.seconds if delay is not None else 0.0
    error = error_of(wrong, float(np.std(measured)), late)
    resolution = delay.resolution if delay is not None else None
    share = float(np.mean(there))
    return Score(error, share, _worst(parts), resolution, float(np.ptp(measured)))


def covered(parts: Sequence[Played], bound: float) -> float:
    """Return the share of points whose error is at most `bound`."""
    values, measured = joined(parts)
    there = np.isfinite(values)
    return float(np.mean(np.abs(values[there] - measured[there]) <= bound))


def _worst(parts: Sequence[Played]) -> WorstMinute:
    """Return the worst minute with at least half of the usual points; else all of it."""
    found = []
    whole = []
    for number, part in enumerate(parts):
        there = np.isfinite(part.values) & np.isfinite(part.measured)
        if not there.any():
            continue
        time, wrong = part.time[there], (part.values - part.measured)[there]
        whole.append(WorstMinute(rms(wrong), 0.0, number))
        begins = np.arange(part.time[0], part.time[-1] - MINUTE_S + 1e-6, LOOK_EVERY_S)
        first = np.searchsorted(time, begins)
        last = np.searchsorted(time, begins + MINUTE_S)
        usual = MINUTE_S * len(part.time) / max(part.time[-1] - part.time[0], MINUTE_S)
        for begin, a, b in zip(begins, first, last):
            if b - a >= max(LEAST_POINTS, 0.5 * usual):
                found.append(WorstMinute(rms(wrong[a:b]), float(begin - part.time[0]), number))
    return max(found or whole)


def delay_of(parts: Sequence[Played]) -> Optional[Delay]:
    """Return the shift at which values correlate best with what was measured, in whole steps.

    Positive: they are late. None where they do not follow it, whatever the shift.
    """
    steps = np.concatenate([np.diff(part.time) for part in parts])
    if not len(steps):
        return None
    step = float(np.median(steps))
    most = int(np.clip(MOST_DELAY_S / step, LEAST_SHIFTS, MOST_SHIFTS))
    sums = np.zeros((6, 2 * most + 1))
    values, measured = joined(parts)
    offsets = np.nanmean(values), np.mean(measured)
    for part in parts:
        sums += _sums(part, step, most, offsets)
    n, x, y, xx, yy, xy = sums
    enough = n >= max(LEAST_POINTS, 0.5 * n.max())
    with np.errstate(divide="ignore", invalid="ignore"):
        spread = (n * xx - x**2) * (n * yy - y**2)
        correlation = np.where(enough & (spread > 0.0), (n * xy - x * y) / np.sqrt(spread), -1.0)
    best = int(np.argmax(correlation))
    if not correlation[best] >= LEAST_CORRELATION:
        return None
    if abs(best - most) == most:  # on the edge: it may be later still
        return None
    return Delay((best - most) * step, step)


def _sums(part: Played, step: float, most: int, offsets: Sequence[float]) -> np.ndarray:
    """Sums over the pairs of a value and what was measured `-most` to `most` steps before.

    n, x, y, xx, yy, xy: (6, 2 * most + 1).
    """
    time = np.arange(part.time[0], part.time[-1] + 0.5 * step, step)
    columns = []
    for column, offset in ((part.values, offsets[0]), (part.measured, offsets[1])):
        there = np.isfinite(column)
        if not there.any() or len(time) <= 1:
            return np.zeros((6, 2 * most + 1))
        series = Series("", "", "", part.time[there], column[there] - offset)
        columns.append(held(series, time, 1.5 * step))
    known = [np.isfinite(column).astype(float) for column in columns]
    x, y = (np.nan_to_num(column) for column in columns)
    pairs = [
        (known[0], known[1]),
        (x, known[1]),
        (known[0], y),
        (x * x, known[1]),
        (known[0], y * y),
        (x, y),
    ]
    return np.stack([_correlated(a, b, most) for a, b in pairs])


def _correlated(a: np.ndarray, b: np.ndarray, most: int) -> np.ndarray:
    """Return the sum of a[k + s] * b[k] for the shifts s from -most to most."""
    full = signal.correlate(a, b, mode="full", method="fft")
    zero = len(b) - 1
    padded = np.concatenate([np.zeros(most), full, np.zeros(most)])
    sums: np.ndarray = padded[zero : zero + 2 * most + 1]
    return sums
