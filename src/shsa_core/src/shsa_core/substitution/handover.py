"""Hands a topic over to its returning original, consumer by consumer, without a gap.

Subscribers connect to a new publisher one after the other, up to 0.2 s apart. A substitute that was
muted at the original's first message would leave the last of them without any; one that went on
would talk over the original at the first. So once the original is up, a message that is due waits
for a look at whom the original serves by then.
"""
import math
from typing import FrozenSet, List, Optional

from shsa_core.model.substitution import CHANGEOVER_S
from shsa_core.substitution.events import Command, LookAtOriginal, OriginalServes
from shsa_core.substitution.settings import LOOK_S

NOBODY: FrozenSet[str] = frozenset()


class Handover:
    """The consumers that the node `original` has `served`; empty: it stands in for nobody. In s."""

    def __init__(self) -> None:
        self.stand_in("", "", None, -math.inf)

    def stand_in(self, topic: str, original: str, period: Optional[float], now: float) -> None:
        """Stand in for a node. The first look can wait: the first messages have precedence."""
        self._topic, self.original, self.served = topic, original, NOBODY
        self._until = math.inf
        self._pause = max(period or 0.0, LOOK_S)
        self._look = now + self._pause if original else math.inf  # when the next one is due
        self._awaited: Optional[LookAtOriginal] = None
        self._up = False  # the original answers
        self._held: Optional[float] = None  # the message that waits goes then, unless answered

    def mute(self, now: float) -> None:
        """Serve only those whom the original does not serve yet, from now on."""
        if self.original:
            self._until = now + CHANGEOVER_S
            if self._held is not None:
                self._held = math.inf
            if self._awaited is None:
                self._look = now

    def under_way(self, now: float) -> bool:
        """Return if a muted substitute publishes nevertheless, to those who are not served."""
        return now < self._until < math.inf

    def hold(self, now: float) -> bool:
        """Have a message that is due wait for a look while the original is up.

        Where that was not heard yet it waits for half a period at most: who starts up may take
        long to answer, and nobody else publishes.
        """
        muted = self._until < math.inf
        if not self.original or not (self._up or muted):
            return False
        if self._held is None:
            strict = muted or bool(self.served)
            self._held = math.inf if strict else now + self._pause / 2.0
        if self._awaited is None:
            self._look = now
        return True

    def release(self, now: float) -> bool:
        """Let the message go that waits, if somebody has looked or it has waited enough."""
        goes = self._held is not None and now >= self._held
        if goes:
            self._held = None
        return goes

    def answer(self, event: OriginalServes) -> None:
        """Take the answer to a look; one that is not awaited is out of date."""
        if event.look == self._awaited:
            self._awaited = None
            self._look = event.time + self._pause
            self.served, self._up = event.consumers or NOBODY, event.consumers is not None
            if self._held is not None:
                self._held = event.time

    def due(self, now: float) -> List[Command]:
        """Return the look that is due, if one is; once the time is over nobody looks any more."""
        if now >= self._until:
            self.stand_in("", "", None, now)
        if now < self._look:
            return []
        self._look = math.inf
        self._awaited = LookAtOriginal(now, self._topic, self.original)
        return [self._awaited]

    def next(self) -> float:
        """Return when something is due next; infinite: never."""
        held = math.inf if self._held is None else self._held
        return min(self._look, self._until, held)
