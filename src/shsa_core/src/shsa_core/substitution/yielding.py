"""Yields a topic to its returning original, consumer by consumer, without a gap.

Each consumer hears one publisher.

Subscribers connect to a new publisher one after the other, up to 0.2 s apart. A substitute that was
muted at the original's first message would leave the last of them without any; one that went on
would talk over the original at the first. So once the original is up, a message that is due waits
for a look at whom the original serves by then.
"""
import math
from typing import FrozenSet, List, Optional

from shsa_core.substitution.events import Command, LookAtOriginal, OriginalServes
from shsa_core.substitution.settings import Settings

NOBODY: FrozenSet[str] = frozenset()


class Yielding:
    """Which consumers the original serves.

    Looked up once a period while the substitute stands in for it.
    """

    def __init__(self, settings: Settings) -> None:
        self._settings = settings
        self.original = ""
        self.served = NOBODY
        self.until = math.inf  # infinite: as long as it publishes
        self._topic = ""
        self._pause = settings.look_s
        self._look = math.inf  # when the next one is due
        self._awaited: Optional[LookAtOriginal] = None
        self._up = False  # the original answers
        self._goes_at = math.inf  # when the message goes that waits for a look, unless that comes
        self._waits = False  # a message waits for a look

    def stand_in(self, topic: str, original: str, period: Optional[float], now: float) -> None:
        """Stand in for the node `original`, empty: for nobody.

        As far as is known, it serves nobody.

        The first look can wait: the first messages have precedence.
        """
        self._topic, self.original, self.served = topic, original, NOBODY
        self.until = math.inf
        self._pause = max(period or 0.0, self._settings.look_s)
        self._look = now + self._pause if original else math.inf
        self._awaited = None
        self._up = self._waits = False
        self._goes_at = math.inf

    def mute(self, now: float) -> None:
        """The substitute is muted: it still serves those whom the original does not serve yet."""
        if self.original:
            self.until = now + self._settings.yield_s
            self._goes_at = math.inf
            if self._awaited is None:
                self._look = now

    def yields(self, now: float) -> bool:
        """Whether a muted substitute publishes nevertheless, to those who are not served."""
        return now < self.until < math.inf

    def hold(self, now: float) -> bool:
        """Whether a message that is due now waits for a look, and not for the next period's.

        It does while the original is up. Where that was not heard yet it waits for half a period
        at most: who starts up may take long to answer, and nobody else publishes.
        """
        muted = self.until < math.inf
        if not self.original or not (self._up or muted):
            return False
        if not self._waits:
            self._waits = True
            strict = muted or bool(self.served)
            self._goes_at = math.inf if strict else now + self._pause / 2.0
        if self._awaited is None:
            self._look = now
        return True

    def release(self, now: float) -> bool:
        """Whether the message that waits goes now: somebody has looked, or it has waited enough."""
        goes = self._waits and now >= self._goes_at
        if goes:
            self._waits, self._goes_at = False, math.inf
        return goes

    def heard(self, event: OriginalServes) -> None:
        """Take an answer; one that is not awaited is out of date."""
        if event.look == self._awaited:
            self._awaited = None
            self._look = event.time + self._pause
            self.served = event.consumers
            self._up = event.up
            if self._waits:
                self._goes_at = event.time

    def due(self, now: float) -> List[Command]:
        """The look that is due, if one is; nobody looks any more once the time to yield is over."""
        if now >= self.until:
            self.stand_in(self._topic, "", None, now)
        if now < self._look:
            return []
        self._look = math.inf
        self._awaited = LookAtOriginal(now, self._topic, self.original)
        return [self._awaited]

    def next(self) -> float:
        """When something is due next; infinite: never."""
        return min(self._look, self.until, self._goes_at)
