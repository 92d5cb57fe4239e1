"""What a substitute does by itself: while its computer cannot reach the reconfigurator, and after.

It publishes while nobody else does, as far as is heard on its side: so each side of a cut has one
publisher. Whoever publishes as well when the sides meet again is heard, and it yields at once: it
is the one that is spare. In reach of the reconfigurator it does as its row says, and yields if that
says so: then it is the original that was cut off.
"""
import math
from typing import Optional

from shsa_core.model.kinds import OnPartition
from shsa_core.model.substitution import Substitution

LONGEST_STEP_S = 0.1
"""Time in which we were not scheduled ourselves is no silence of others."""


class CutOff:
    """Whether a substitute publishes otherwise than its row says. Times in s."""

    def __init__(self) -> None:
        self.topic = ""  # on which others are listened for; empty: on none
        self._says = self._yields = False
        self._deadline: Optional[float] = None
        self._cut = False
        self._heard = False  # somebody else was, so that silence tells something
        self._yielded = False
        self._silence = 0.0
        self._now = -math.inf

    def follow(self, row: Substitution, topic: str) -> None:
        """The row is another one; `topic`: that of its program."""
        listens = row.on_partition is OnPartition.HEAL and topic != ""
        self._yields = row.yields
        if topic != self.topic:
            self._heard = self._yielded = False
        if row.publishing is not self._says:
            self._yielded = False
        self.topic, self._says = topic if listens else "", row.publishing
        self._deadline = row.outputs[0].deadline if row.outputs else None

    def reach(self, cut: bool) -> None:
        """The reconfigurator is out of reach, or in reach again."""
        self._cut = cut

    def heard(self, topic: str) -> None:
        """Somebody else has published."""
        if topic == self.topic:
            self._heard, self._silence = True, 0.0
            self._yielded = self._yielded or self._cut or self._yields

    def pass_time(self, now: float) -> None:
        """Time passes."""
        step = now - self._now if self._now > -math.inf else 0.0
        self._silence += min(max(0.0, step), LONGEST_STEP_S)
        self._now = now
        if self._is_silent:
            self._yielded = False

    @property
    def publishes(self) -> bool:
        """Whether it publishes now."""
        if self._yielded:
            return False
        takes_over = self._cut and bool(self.topic) and self._is_silent
        return self._says or takes_over

    @property
    def next(self) -> float:
        """When to look again how long others are silent, if that matters now; else infinite."""
        waits = self.topic and self._heard and (self._yielded or (self._cut and not self._says))
        if not waits or self._deadline is None or self._is_silent:
            return math.inf
        return self._now + min(max(self._deadline - self._silence, 1e-6), LONGEST_STEP_S / 2.0)

    @property
    def _is_silent(self) -> bool:
        """Whether those are silent who were heard."""
        return self._heard and self._deadline is not None and self._silence >= self._deadline
