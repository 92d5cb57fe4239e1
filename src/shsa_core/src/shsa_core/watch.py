"""A clock that stands while we, the link or the other end could not act.

A silence is blamed on somebody only for the time in which it could have been broken, and heard.
"""
from collections import deque
from math import inf
from typing import Deque, Optional, Tuple

LEAST_LATE_S = 0.002
"""Less is how exactly a computer wakes anybody."""
CATCH_UP_SHARE = 0.1
"""Others need not catch up with less of the time that is waited for."""
LONGEST_STEP_S = 0.1
"""More between two looks was a hold-up, where we did not say when we wanted to look again."""
INSTANT_S = 1e-6  # a float of a time of today has no finer steps
REMEMBERED = 1000
"""Stretches in which the clock stood; older ones count as time that passed."""


class Watch:
    """Tells how much time has passed in which others could act. Times in s."""

    def __init__(self) -> None:
        self.now = -inf
        self._starved = 0.0
        self._woke, self._late = -inf, 0.0  # when we were held up last, and for how long
        self._stood: Deque[Tuple[float, float]] = deque(maxlen=REMEMBERED)  # in order, disjoint

    def look(self, now: float, wanted: Optional[float] = None) -> None:
        """Look at the time, as we `wanted` to by then; None or inf: nobody said when."""
        if wanted is None or wanted == inf:
            wanted = self.now + LONGEST_STEP_S
        late = now - max(wanted, self.now) if self.now > -inf else 0.0
        self.now = max(self.now, now)
        if late > LEAST_LATE_S:
            self.stand(now - late, now)
            if now - late > self._woke + self._late:  # who is always late must see time pass, too
                self._woke, self._late = now, late

    def starve(self, now: float, waited: float) -> None:
        """Stand for as long as the other end has waited for a processor since the last call.

        `waited`: s in all, as the kernel counts them in /proc/PID/schedstat.
        """
        self.stand(now - max(0.0, waited - self._starved), now)
        self._starved = waited

    def stand(self, began: float, until: float) -> None:
        """Stand from `began` `until`."""
        if until - began <= INSTANT_S:
            return
        while self._stood and self._stood[-1][1] >= began:
            before = self._stood.pop()
            began, until = min(before[0], began), max(before[1], until)
        self._stood.append((began, until))

    def passed(self, since: float) -> float:
        """Return the time that has passed since a moment, as of the last look."""
        passed = max(0.0, self.now - since)
        for began, until in reversed(self._stood):
            if until <= since:
                break
            passed -= min(until, self.now) - max(began, since)
        return max(0.0, passed)

    def when(self, since: float, length: float) -> float:
        """Return when so much time will have passed since a moment, if nothing holds it up.

        Others were held up with us, and get as long again to go on: up to `length`, and until twice
        that has passed.
        """
        left = length - self.passed(since)
        due = self.now + (left if left > INSTANT_S else 0.0)
        if self._late < CATCH_UP_SHARE * length:
            return due
        return max(due, self._woke + min(self._late, length, length + left))

    def has_passed(self, since: float, length: float) -> bool:
        """Tell if so much time has passed since a moment."""
        return self.now >= self.when(since, length)
