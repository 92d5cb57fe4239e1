"""Yields a topic to its returning original, consumer by consumer, without a gap.

Each consumer hears one publisher.

Subscribers connect to a new publisher one after the other, up to 0.2 s apart. A substitute that was
muted at the original's first message would leave the last of them without any; one that went on
would talk over the original at the first.
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

    def mute(self, now: float) -> None:
        """The substitute is muted: it still serves those whom the original does not serve yet."""
        if self.original:
            self.until = now + self._settings.yield_s
            if self._awaited is None:
                self._look = now

    def yields(self, now: float) -> bool:
        """Whether a muted substitute publishes nevertheless, to those who are not served."""
        return now < self.until < math.inf

    def heard(self, event: OriginalServes) -> None:
        """Take an answer; one that is not awaited is out of date."""
        if event.look == self._awaited:
            self._awaited = None
            self._look = event.time + self._pause
            self.served = event.consumers

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
        return min(self._look, self.until)
