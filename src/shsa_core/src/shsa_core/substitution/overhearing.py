"""What others publish on a substitute's topic: when they were heard last, by an honest watch.

It stands while we were not scheduled ourselves: that is no silence of others.
"""
import math
from typing import Optional

from shsa_core.substitution.events import OtherHeard

LONGEST_STEP_S = 0.1
"""More than that counts for as much, where nobody said when we wanted to wake."""
LATE_SHARE, LEAST_LATE_S = 0.1, 0.002
"""Later than that share of the silence that matters, and than that, we were held up: whoever was
held up with us is granted as long again."""


class Overhearing:
    """How long the others on a topic have been silent; `topic` is empty where none is heard.

    `silence` in s, up to now; `last`: what was heard last, None: nothing so far. `matters`: the
    silence in s that somebody waits for.
    """

    def __init__(self) -> None:
        self.topic = ""
        self.silence = 0.0
        self.last: Optional[OtherHeard] = None
        self.matters = math.inf
        self._now = -math.inf

    def listen(self, topic: str, matters: float) -> None:
        """Hear the others on a topic from now on; on another one nobody was heard yet."""
        if topic != self.topic:
            self.last, self.silence = None, 0.0
        self.topic, self.matters = topic, matters

    def heard(self, event: OtherHeard) -> bool:
        """Somebody else has published; whether it is on our topic."""
        if not self.topic or event.topic != self.topic:
            return False
        self.last, self.silence = event, 0.0
        return True

    def pass_time(self, now: float, wanted: Optional[float]) -> None:
        """Time passes; we `wanted` to wake by then, None: whenever."""
        step = max(0.0, now - self._now) if self._now > -math.inf else 0.0
        self._now = max(now, self._now)
        late = 0.0 if wanted is None else now - wanted
        if late > max(LATE_SHARE * self.matters, LEAST_LATE_S):
            step = min(step - late, LONGEST_STEP_S) - late
        self.silence = max(0.0, self.silence + min(step, LONGEST_STEP_S))

    def left(self, until: float) -> float:
        """When to look again whether the silence has come to `until` s; time in s."""
        return self._now + min(max(until - self.silence, 1e-6), LONGEST_STEP_S / 2.0)
