"""The spread of values, and the rhythm of moments, in bounded memory."""
import math
from array import array
from collections import deque
from dataclasses import dataclass
from typing import Deque, Optional, Tuple

from shsa_core.monitoring.settings import RATE_MESSAGES, RATE_SECONDS

KEPT = 512
"""Values of which percentiles are taken: evenly spread over all that came."""
MOST_KEPT = 20_000
"""Moments that are kept to take a rate, however many come in a second."""


class Sample:
    """Values evenly spread over all that came: every n-th, n doubles when there are KEPT."""

    def __init__(self) -> None:
        self._kept, self._every, self._count = array("d"), 1, 0

    def add(self, value: float) -> None:
        """One more value."""
        if self._count % self._every == 0:
            if len(self._kept) == KEPT:
                self._kept = self._kept[::2]
                self._every *= 2
            if self._count % self._every == 0:
                self._kept.append(value)
        self._count += 1

    def quantiles(self, *shares: float) -> Tuple[float, ...]:
        """Return the values below which these shares of all are; of none, NaN."""
        ordered = sorted(self._kept)
        last = len(ordered) - 1
        return tuple(ordered[round(share * last)] if ordered else math.nan for share in shares)


@dataclass(frozen=True)
class Spread:
    """The values of a field; no limit where none was finite.

    `nan`, `infinite`: shares of all; `constant`: there was one value; `one_way`: it only rose, or
    only fell, as a counter does; `trembles`: it went nowhere, as noise around one value does.
    """

    count: int
    lowest: Optional[float]
    highest: Optional[float]
    p5: Optional[float]
    p95: Optional[float]
    nan: float
    infinite: float
    constant: bool
    one_way: bool
    trembles: bool


class SpreadTally:
    """Takes the values of a field."""

    def __init__(self) -> None:
        self._sample = Sample()
        self._lowest, self._highest = math.inf, -math.inf
        self._count = self._nan = self._infinite = 0
        self._rises = self._falls = self._finite = 0
        self._mean = self._squares = self._steps = 0.0
        self._last: Optional[float] = None

    def add(self, value: float) -> None:
        """One more value; it may be NaN or infinite."""
        self._count += 1
        if math.isnan(value):
            self._nan += 1
        elif math.isinf(value):
            self._infinite += 1
        else:
            self._sample.add(value)
            self._lowest, self._highest = min(self._lowest, value), max(self._highest, value)
            if self._last is not None:
                self._rises += value > self._last
                self._falls += value < self._last
                step = value - self._last
                self._steps += step * step  # a power would raise where this is infinite
            self._last = value
            self._finite += 1  # Welford's algorithm
            deviation = value - self._mean
            self._mean += deviation / self._finite
            self._squares += deviation * (value - self._mean)

    def result(self) -> Spread:
        """Return the spread so far."""
        finite = self._last is not None
        p5, p95 = self._sample.quantiles(0.05, 0.95)
        return Spread(
            count=self._count,
            lowest=self._lowest if finite else None,
            highest=self._highest if finite else None,
            p5=p5 if finite else None,
            p95=p95 if finite else None,
            nan=self._nan / self._count if self._count else 0.0,
            infinite=self._infinite / self._count if self._count else 0.0,
            constant=self._lowest == self._highest and self._nan + self._infinite == 0,
            one_way=self._rises + self._falls > 1 and not (self._rises and self._falls),
            # von Neumann's ratio: 2 for white noise, and near 0 for what moves.
            trembles=self._steps > self._squares > 0.0,
        )


@dataclass(frozen=True)
class Rhythm:
    """The rhythm of messages; times in s, None where there are too few to tell.

    `period`: the median interval; `jitter`: 95 % of the intervals are no further from it;
    `longest`: the longest pause, also before the end; `slowest`, `fastest`: rates over as
    many messages as the monitor takes, of the one that `period` gives.
    """

    count: int
    period: Optional[float]
    jitter: Optional[float]
    longest: Optional[float]
    slowest: Optional[float]
    fastest: Optional[float]


class RhythmTally:
    """Takes the moments at which messages came, in s."""

    def __init__(self) -> None:
        self._intervals = Sample()
        self._last: Deque[float] = deque(maxlen=MOST_KEPT)
        self._count = 0
        self._longest = 0.0
        self._slowest, self._fastest = math.inf, 0.0  # messages/s
        self._first: Optional[float] = None

    def add(self, time: float) -> None:
        """Count a message; one from before the last one counts as at the same moment."""
        self._count += 1
        if self._first is None:
            self._first = time
            self._last.append(time)
            return
        time = max(time, self._last[-1])
        interval = time - self._last[-1]
        self._intervals.add(interval)
        self._longest = max(self._longest, interval)
        self._last.append(time)
        while len(self._last) > RATE_MESSAGES + 1 and time - self._last[1] >= RATE_SECONDS:
            self._last.popleft()
        window = time - self._last[0]
        if len(self._last) > RATE_MESSAGES and window >= RATE_SECONDS:
            rate = (len(self._last) - 1) / window
            self._slowest, self._fastest = min(self._slowest, rate), max(self._fastest, rate)

    def result(self, end: float) -> Rhythm:
        """Return the rhythm until `end`."""
        if self._count < 2 or self._first is None:
            return Rhythm(self._count, None, None, None, None, None)
        period = self._intervals.quantiles(0.5)[0]
        longest = max(self._longest, end - self._last[-1])
        if period <= 0.0:
            return Rhythm(self._count, None, None, longest, None, None)
        low, high = self._intervals.quantiles(0.025, 0.975)
        rates = self._slowest, self._fastest
        if not self._fastest:  # too few came
            passed = self._last[-1] - self._first
            rates = ((self._count - 1) / passed if passed else 0.0,) * 2
        return Rhythm(
            count=self._count,
            period=period,
            jitter=max(high - period, period - low),
            longest=longest,
            slowest=rates[0] * period if rates[0] else None,
            fastest=rates[1] * period if rates[1] else None,
        )
