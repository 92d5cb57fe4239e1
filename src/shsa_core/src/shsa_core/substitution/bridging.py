"""Fills in for an original that is late, before anybody is blamed: a muted substitute's bridge.

It publishes once the original was silent for as long as its row allows, and is muted again by the
next message of anybody else. So a gap costs a few periods and not the deadline; the deadline, what
is held against the original and its kill are others' business.

Only a silent connection is bridged: one that has ended is the reconfigurator's to judge, which is
told at once, and tells a node that died from one that was stopped on purpose. Until its word comes
the substitute fills in for a node that is gone, at once, and where a bridge begins before that word
can come; for LOOK_AGAIN_S at most.
"""
import math
from typing import Optional, Tuple

from shsa_core.model.substitution import Substitution
from shsa_core.substitution.events import LookAtOthers, OthersStand
from shsa_core.substitution.overhearing import Overhearing

STEADY = 5
"""So many messages in a row, none later than what is bridged, make a steady pace."""
QUICK_S = 0.0125
"""A shorter silence is over before the reconfigurator can be heard: 2.5 periods of 200 Hz."""
LOOK_AGAIN_S = 0.05
"""While it fills in, it looks no more often whether the connection stands."""


class Bridging:
    """Whether a muted substitute fills in now (`on`). Times in s.

    `sources`: who published what it computes from while the original was heard. If that is another
    one by now, it may be one that fills in as well, and the two would live on each other's word.
    """

    def __init__(self, others: Overhearing) -> None:
        self.on = False
        self._others = others
        self._after = 0.0  # s of silence; 0: it does not fill in
        self._steady = 0
        self._sources: Tuple[str, ...] = ()
        self._awaited: Optional[LookAtOthers] = None
        self._looks = True  # since the last message it has not looked in vain
        self._stood = True
        self._look = math.inf

    def follow(self, row: Substitution, topic: str, may: bool) -> None:
        """The row is another one; `topic`: that of its program, `may`: that can fill in."""
        after = row.bridge if may and not row.publishing and topic in row.topics else 0.0
        if not after or not self._after or topic != self._others.topic:
            self.stop()
            self._steady = 0
        self._after = after

    @property
    def listens(self) -> bool:
        """Whether the others must be heard."""
        return self._after > 0.0

    def stop(self) -> None:
        """Be muted until the others were heard and are silent again."""
        self.on, self._looks, self._awaited = False, False, None

    def forget(self) -> None:
        """Fill in no more, until a row says so anew."""
        self._after, self._steady = 0.0, 0
        self.stop()

    def heard(self, silence: float, sources: Tuple[str, ...]) -> None:
        """Somebody else has published, after a `silence`."""
        self.stop()
        self._looks, self._sources = True, sources
        if self._steady < STEADY:
            self._steady = self._steady + 1 if silence < self._after else 0

    def feed(self, sources: Tuple[str, ...]) -> None:
        """What it computes from was published by `sources`."""
        if sources != self._sources:
            self.stop()

    def stand(self, event: OthersStand, sources: Tuple[str, ...]) -> None:
        """Take an answer; one that is not awaited is out of date."""
        if event.look != self._awaited:
            return
        self._awaited = None
        goes_on = self._stood if self.on else self._after <= QUICK_S
        if not event.stands and not goes_on:
            self.stop()
            return
        self._fill_in(event.time, event.stands, sources)

    def gone(self, time: float, sources: Tuple[str, ...]) -> None:
        """The node of who was heard last is gone."""
        if self._waits and not self.on:
            self._awaited = None
            self._fill_in(time, False, sources)

    def _fill_in(self, time: float, stands: bool, sources: Tuple[str, ...]) -> None:
        if not self.on:
            self.on = True
            self.feed(sources)
        self._stood = stands
        self._look = time + max(self._after, LOOK_AGAIN_S)

    def due(self, now: float) -> Optional[LookAtOthers]:
        """The look that is due: what has come may not be read yet, or the connection has ended."""
        last = self._others.last
        if last is None or self._awaited is not None or not self._waits or now < self.next(now):
            return None
        self._awaited = LookAtOthers(now, last.topic, last.publisher)
        return self._awaited

    def next(self, now: float) -> float:
        """When to look again; infinite: not before another message of theirs.

        Until their pace is known they are looked at as often: of messages that are read together
        only the newest tells when it came.
        """
        silent_at = self._others.silent_at(self._after)
        if self._after > 0.0 and self._steady < STEADY and silent_at > now:
            return silent_at
        if not self._waits or self._awaited is not None:
            return math.inf
        if self.on:
            return self._look
        return silent_at

    @property
    def _waits(self) -> bool:
        return self._after > 0.0 and self._looks and self._steady >= STEADY
