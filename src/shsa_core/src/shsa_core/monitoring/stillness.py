"""Learns how long a value may stay the same: from the runs of equal values in its healthy stream.

Only noise tells: a sensor whose reading differs from message to message does not read the same bits
for long. What moves without noise, or in coarse steps, stands still whenever the robot does, and is
never judged; neither is an exact 0, as long as that may be rest.
"""
from math import inf, isfinite
from typing import Optional

from shsa_core.model.samples import Hold
from shsa_core.monitoring import settings


class Stillness:
    """The habits of one value. Outlives connections: a longest run only ever allows more."""

    def __init__(self) -> None:
        self._count = self._repeats = self._turns = self._crossings = 0
        self._longest, self._longest_zero = 1, 0
        self._low, self._high = inf, -inf

    def learn(self, value: float, run: int, step: float, step_before: float) -> None:
        """`value` came `run` times, after a step of `step_before`, and was left by `step`."""
        if value == 0.0:
            self._longest_zero = max(self._longest_zero, run)
            return
        self._count += run
        self._repeats += run - 1
        self._turns += step * step_before < 0.0
        self._crossings += value * (value + step) < 0.0
        self._longest = max(self._longest, run)
        self._low, self._high = min(self._low, value), max(self._high, value)
        if self._count > settings.FORGET_MESSAGES:
            self._count //= 2
            self._repeats //= 2
            self._turns //= 2

    def allowed(self, value: float) -> Optional[Hold]:
        """Return how long `value` may stay the same; None: for ever, or nobody knows yet."""
        changes = self._count - self._repeats
        if (
            self._count < settings.LEARN_MESSAGES
            or self._repeats > settings.MOST_REPEATS * self._count
        ):
            return None
        if self._turns < settings.LEAST_TURNS * changes:
            return None
        if value == 0.0 and (self._crossings < settings.LEARN_MESSAGES or self._longest_zero > 1):
            return None
        # Whoever reads more than he can tell reads his limit, as long as that lasts.
        inside = self._low < value < self._high
        factor = 1 if inside else settings.STILL_FACTOR
        return Hold(
            settings.STILL_FACTOR * factor * self._longest,
            settings.STILL_LEAST_S * factor,
            self._longest,
        )


class Run:
    """Counts how often the newest value of one publisher came in a row. Times in s."""

    def __init__(self, stillness: Stillness) -> None:
        self._stillness = stillness
        self._value: Optional[float] = None
        self._step = 0.0
        self._learns = False
        self.length = 0
        self.began = 0.0

    def add(self, value: float, time: float, healthy: bool) -> None:
        """Another value; `healthy`: what its publisher sends may be learned from."""
        before = self._value
        if value == before:
            self.length += 1
            self._learns = self._learns and healthy
            return
        step = 0.0
        if before is not None and isfinite(value - before):
            step = value - before
            if self._learns and healthy:
                self._stillness.learn(before, self.length, step, self._step)
        self._value, self._step, self._learns = value, step, healthy
        self.length, self.began = 1, time

    def spoil(self) -> None:
        """Its value is bad: nothing is learned from it."""
        self._learns = False

    @property
    def allowed(self) -> Optional[Hold]:
        """The longest that it may go on, as learned; None: for ever."""
        return None if self._value is None else self._stillness.allowed(self._value)
