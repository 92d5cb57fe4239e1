"""Learns from the tail of its gaps how long a healthy stream may be silent.

Peaks over a threshold: whatever the stream, what its gaps are beyond a high quantile `u` is about
generalised Pareto distributed (Pickands, Annals of Statistics 3, 1975; Coles, An Introduction to
Statistical Modeling of Extreme Values, 2001, chapter 4). With k of them in some hours, the silence
that is exceeded so many times an hour, its return level, is

    u + scale / shape * ((k / (hours * times))^shape - 1)    or  u + scale * log(...) at shape 0

Scale and shape are those of probability-weighted moments (Hosking and Wallis, Technometrics 29,
1987). A shape below 0 would say that there is a longest gap; nobody knows that, so it counts as 0.
"""
from bisect import insort
from collections import deque
from math import ceil, exp, inf, log
from typing import Deque, List, NamedTuple, Optional, Sequence

from shsa_core.monitoring import settings
from shsa_core.watch import INSTANT_S

HOUR_S = 3600.0


class LearnedDeadline:
    """The silence in s that a stream of a `period` in s is allowed, for `false_alarms` an hour.

    `fixed`: what is allowed before enough is known; `most`: what ever is; `bridge`: the periods
    after which a substitute fills in, sooner than which nobody is blamed. What was learned `before`
    of a stream of the same period goes on to count. Costs the same for every message, but for the
    few that are among the longest.
    """

    def __init__(
        self,
        period: float,
        false_alarms: float,
        fixed: float,
        most: float,
        before: Optional["LearnedDeadline"] = None,
        bridge: float = 0.0,
    ) -> None:
        self.period, self.false_alarms, self._fixed, self._most = period, false_alarms, fixed, most
        least = max(max(settings.LEAST_PERIODS, bridge) * period, period + settings.BUSY_S)
        self._least = min(fixed, least)
        self.needed = max(
            settings.LEARN_GAPS, ceil(settings.LEARN_SHARE * HOUR_S / (false_alarms * period))
        )
        self._every = max(1, round(settings.TAIL_LOOK_S / period))
        same = before is not None and before.period == period
        self._blocks: Deque[_Block] = before._blocks if before and same else deque([_Block()])
        self.allowed = fixed
        self._look()

    @property
    def gaps(self) -> int:
        """The number of gaps that it stands on."""
        return sum(block.count for block in self._blocks)

    @property
    def is_learned(self) -> bool:
        """True once enough is known."""
        return self.gaps >= self.needed

    def is_long(self, gap: float) -> bool:
        """Tell if a gap would be one of those that are kept."""
        return gap > self._blocks[-1].threshold

    def add(self, gap: float) -> bool:
        """A gap of the healthy stream, in s; whether another silence is allowed now."""
        self._blocks[-1].add(gap)
        self._to_look -= 1
        return (self._to_look <= 0 or gap * settings.SPARE > self.allowed) and self._look()

    def told(self) -> str:
        """Return in words on what it stands."""
        if not self.is_learned:
            return f"the fixed deadline until {self.needed} gaps are known, {self.gaps} are so far"
        return f"learned from {self.gaps} gaps, {self.false_alarms:g} false alarms an hour"

    def _look(self) -> bool:
        before, missing = self.allowed, self.needed - self.gaps
        self._to_look = min(self._every, missing) if missing > 0 else self._every
        newest = self._blocks[-1]
        if newest.seconds >= settings.BLOCK_S and newest.count >= self.needed / (
            settings.BLOCKS - 1
        ):
            self._blocks.append(_Block())
            if len(self._blocks) > settings.BLOCKS:
                self._blocks.popleft()
        self.allowed = self._fixed
        if missing <= 0:
            wanted = max(self._return_level(), settings.SPARE * self._longest())
            self.allowed = min(max(wanted, self._least), self._most)
        return self.allowed != before

    def _longest(self) -> float:
        return max((block.longest[-1] for block in self._blocks if block.longest), default=0.0)

    def _return_level(self) -> float:
        """The silence that is exceeded so many times an hour as is asked for."""
        beyond = max(block.threshold for block in self._blocks)
        tail = sorted(gap for block in self._blocks for gap in block.longest if gap >= beyond)
        tail = tail[-(self.gaps // settings.TAIL) :]
        hours = max(INSTANT_S, sum(block.seconds for block in self._blocks)) / HOUR_S
        return fitted(tail).level(len(tail) / (hours * self.false_alarms))


class _Block:
    """The gaps of one stretch of the stream; `longest` in order."""

    def __init__(self) -> None:
        self.longest: List[float] = []
        self.count, self.seconds = 0, 0.0
        self.threshold = -inf  # all that is above is kept

    def add(self, gap: float) -> None:
        self.count += 1
        self.seconds += gap
        if gap <= self.threshold:
            return
        insort(self.longest, gap)
        if len(self.longest) > settings.TAIL_KEPT:
            del self.longest[0]
            self.threshold = self.longest[0]


class Tail(NamedTuple):
    """The gaps beyond `least`, generalised Pareto distributed; `least` and `scale` in s."""

    least: float
    scale: float
    shape: float

    def level(self, ratio: float) -> float:
        """Return the length that one gap in `ratio` of the tail exceeds."""
        if ratio <= 1.0:
            return self.least
        if self.shape <= 0.0:
            return self.least + self.scale * log(ratio)
        return self.least + self.scale / self.shape * (ratio**self.shape - 1.0)

    def share(self, gap: float) -> float:
        """Return the share of the tail that is longer than a gap."""
        if gap <= self.least:
            return 1.0
        beyond = (gap - self.least) / max(self.scale, INSTANT_S)
        if self.shape <= 0.0:
            return exp(-beyond)
        return (1.0 + self.shape * beyond) ** (-1.0 / self.shape)


def fitted(gaps: Sequence[float]) -> Tail:
    """Return the tail of these gaps, which are at least two, and in order."""
    count, least = len(gaps), gaps[0]
    mean = sum(gaps) / count - least
    weighted = sum((count - 1 - i) * (gap - least) for i, gap in enumerate(gaps))
    weighted /= count * (count - 1)
    spread = mean - 2.0 * weighted
    if mean <= INSTANT_S or spread <= 0.0:
        return Tail(gaps[-1], 0.0, 0.0)
    shape = min(2.0 - mean / spread, settings.MOST_SHAPE)
    if shape <= 0.0:
        return Tail(least, mean, 0.0)
    return Tail(least, 2.0 * mean * weighted / spread, shape)
