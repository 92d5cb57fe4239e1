"""Learns from the tail of its gaps how long a healthy stream may be silent.

The gaps beyond a high threshold `u` are about exponentially distributed, with the mean of what they
are longer. With k of them in some hours, the silence that is exceeded so many times an hour is

    u + mean * log(k / (hours * times))

(peaks over a threshold: Coles, An Introduction to Statistical Modeling of Extreme Values, 2001,
chapter 4). A tail that is heavier is covered by SPARE times the longest healthy gap.
"""
from bisect import insort
from collections import deque
from math import ceil, inf, log
from typing import Deque, List, Optional

from shsa_core.derivations.settings import REFRESH_S
from shsa_core.monitoring import settings
from shsa_core.watch import INSTANT_S


class LearnedDeadline:
    """The silence in s that a stream of a `period` in s is allowed, for `false_alarms` an hour.

    `fixed`: what is allowed before enough is known, and ever: a stream that was steady so far may
    be late once; `most`: the most that is. What was learned `before` of a stream of the same period
    goes on to count. Costs the same for every message, but for the few that are among the longest.
    """

    def __init__(
        self,
        period: float,
        false_alarms: float,
        fixed: float,
        most: float,
        before: Optional["LearnedDeadline"] = None,
    ) -> None:
        self.period, self.false_alarms, self._fixed, self._most = period, false_alarms, fixed, most
        self._rate = false_alarms / 3600.0  # 1/s
        share = ceil(settings.LEARN_SHARE / (self._rate * period))
        self.needed = max(settings.LEARN_GAPS, share)
        self._every = max(1, round(REFRESH_S / period))
        self._blocks: Deque[_Block] = deque([_Block()], settings.BLOCKS)
        if before is not None and before.period == period:
            self._blocks = before._blocks
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
        """Add a gap of the healthy stream, in s; tell if another silence is allowed now."""
        self._blocks[-1].add(gap)
        count = self.gaps
        due = count % self._every == 0 or count == self.needed
        return (due or gap * settings.SPARE > self.allowed) and self._look()

    def told(self) -> str:
        """Return in words on what it stands."""
        if not self.is_learned:
            return f"the fixed deadline until {self.needed} gaps are known, {self.gaps} are so far"
        return f"learned from {self.gaps} gaps, {self.false_alarms:g} false alarms an hour"

    def _look(self) -> bool:
        before, newest = self.allowed, self._blocks[-1]
        enough = self.needed / (settings.BLOCKS - 1)
        if newest.seconds >= settings.BLOCK_S and newest.count >= enough:
            self._blocks.append(_Block())
        wanted = self._wanted() if self.is_learned else 0.0
        self.allowed = min(max(wanted, self._fixed), self._most)
        return self.allowed != before

    def _wanted(self) -> float:
        beyond = max(block.threshold for block in self._blocks)
        tail = sorted(gap for block in self._blocks for gap in block.longest if gap >= beyond)
        tail = tail[-(self.gaps // settings.TAIL) :]
        seconds = max(INSTANT_S, sum(block.seconds for block in self._blocks))
        times = max(1.0, len(tail) / (seconds * self._rate))
        excess = sum(tail) / len(tail) - tail[0]
        return max(tail[0] + excess * log(times), settings.SPARE * tail[-1])


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
