"""How long others have been silent, by an honest watch.

It stands while we were not scheduled ourselves: that is no silence of others.
"""
import math
from typing import Optional

LONGEST_STEP_S = 0.1
"""More than that counts for as much, where nobody said when we wanted to wake."""
LATE_SHARE, LEAST_LATE_S = 0.1, 0.002
"""Later than that share of the silence that matters, and than that, we were held up: whoever was
held up with us is granted as long again."""


class Silence:
    """`silence` of others in s, up to now. `matters`: the silence in s that somebody waits for."""

    def __init__(self, matters: float = math.inf) -> None:
        self.silence = 0.0
        self.matters = matters
        self._now = -math.inf

    def pass_time(self, now: float, wanted: Optional[float]) -> None:
        """Time passes; we `wanted` to wake by then, None: whenever."""
        step = max(0.0, now - self._now) if self._now > -math.inf else 0.0
        self._now = max(now, self._now)
        if wanted is None or wanted == math.inf:
            step = min(step, LONGEST_STEP_S)
        elif now - wanted > max(LATE_SHARE * self.matters, LEAST_LATE_S):
            step -= 2.0 * (now - wanted)
        self.silence = max(0.0, self.silence + step)

    def left(self, until: float) -> float:
        """When to look again whether the silence has come to `until` s; time in s."""
        return self._now + max(until - self.silence, 1e-6)
