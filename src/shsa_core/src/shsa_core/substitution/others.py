"""What a substitute hears of the other publishers of its topic, by an honest watch.

Only a silent connection is bridged: one that has ended is the reconfigurator's to judge, which is
told at once, and tells a node that died from one that was stopped on purpose. Until its word comes,
the substitute fills in for a node that is gone.
"""
import math
from typing import Callable, List, Optional, Tuple

from shsa_core.model.kinds import OnPartition
from shsa_core.model.substitution import Substitution
from shsa_core.substitution.events import Command, LookAtOthers, OtherGone, OtherHeard, OthersStand
from shsa_core.substitution.settings import LOOK_AGAIN_S, QUICK_S, STEADY
from shsa_core.substitution.voice import Original, Others
from shsa_core.watch import Watch

Sources = Tuple[str, ...]


class OtherPublishers:
    """Who else publishes on `topic`; empty: nobody is listened for. Times in s.

    `last`: what was heard last, None: nothing. `bridge`: the silence after which the substitute
    fills in; 0: it does not.
    """

    def __init__(self) -> None:
        self.topic = ""
        self.last: Optional[OtherHeard] = None
        self.bridge = 0.0
        self.original = Original.LOST
        self._watch = Watch()
        self._since = -math.inf  # when it was heard
        self._silent = False  # for longer than the deadline since
        self._of = ""  # the topic of the program
        self._heals = self._yields = self._publishing = self._cut = self._rival = False
        self._deadline = math.inf
        self._steady = 0  # messages in a row that were not late
        self._sources: Sources = ()
        self._awaited: Optional[LookAtOthers] = None
        self._look = math.inf

    def follow(self, row: Substitution, topic: str, may_bridge: bool) -> None:
        """The row is another one; `topic`: that of the program, which may fill in or not."""
        bridge = row.bridge if may_bridge and not row.publishing and topic in row.topics else 0.0
        self._heals = row.on_partition is OnPartition.HEAL and topic != ""
        listened = topic if self._heals or bridge else ""
        if not bridge or not self.bridge or listened != self.topic:
            self.forget()
        if listened != self.topic:
            self.topic, self.last, self._since = listened, None, self._watch.now
        if topic != self._of or row.publishing is not self._publishing or not self._heals:
            self._rival = False
        if topic != self._of or not self._heals:
            self._silent = False
        deadline = row.outputs[0].deadline if row.outputs and self._heals else None
        self._deadline = math.inf if deadline is None else deadline
        self._of, self._publishing, self._yields = topic, row.publishing, row.yields
        self.bridge = bridge

    def forget(self) -> None:
        """Fill in for nobody until somebody was heard at a steady pace."""
        self.bridge, self._steady = 0.0, 0
        self._leave()

    def _leave(self) -> None:
        """Leave the original to the reconfigurator until it speaks."""
        self.original, self._awaited = Original.LOST, None

    # What is heard.

    def pass_time(self, now: float, wanted: float) -> None:
        """Time passes; we `wanted` to wake by then, inf: whenever."""
        self._watch.look(now, wanted)
        if self.last is not None and self._watch.has_passed(self._since, self._deadline):
            self._silent = True

    def reach(self, cut_off: bool) -> None:
        """The reconfigurator is out of reach, or in reach again."""
        self._cut = cut_off

    def hear(self, event: OtherHeard, sources: Callable[[], Sources]) -> None:
        """Somebody else has published; `sources`: who published what the program reads."""
        if not self.topic or event.topic != self.topic:
            return
        meets = self._cut or self._yields or (self._rival and not self._silent)
        self._rival = self._heals and meets
        if self._steady < STEADY:
            late = self._watch.passed(self._since) >= self.bridge
            self._steady = 0 if late else self._steady + 1
        self.last, self._since, self._silent = event, self._watch.now, False
        self.original, self._awaited, self._sources = Original.SPEAKS, None, sources()

    def gone(self, event: OtherGone, sources: Callable[[], Sources]) -> None:
        """The node of somebody else is gone: nobody has to wait for its silence."""
        last = self.last
        heard = last is not None and (last.topic, last.publisher) == (event.topic, event.publisher)
        if heard and self._waits and self.original is Original.SPEAKS:
            self._judge(Original.ENDED, event.time, sources)

    def answer(self, event: OthersStand, sources: Callable[[], Sources]) -> None:
        """Take the answer to a look; one that is not awaited is out of date."""
        if event.look != self._awaited:
            return
        before = self.original
        quick = before is Original.SPEAKS and self.bridge <= QUICK_S
        if event.stands:
            self._judge(Original.HANGS, event.time, sources)
        elif before is Original.HANGS or quick:
            self._judge(Original.ENDED, event.time, sources)
        else:
            self._leave()

    def _judge(self, original: Original, time: float, sources: Callable[[], Sources]) -> None:
        self.original, self._awaited = original, None
        self._look = time + max(self.bridge, LOOK_AGAIN_S)
        self.compare(sources)

    def compare(self, sources: Callable[[], Sources]) -> None:
        """Fill in no more if somebody else publishes what the program reads.

        It may be one that fills in as well: the two would live on each other's word.
        """
        if self.original.late and sources() != self._sources:
            self._leave()

    # What follows.

    @property
    def cut_off(self) -> bool:
        """Return if it decides by itself whether it publishes."""
        return self._cut and self._heals

    @property
    def listens(self) -> bool:
        """Return if it matters at once who speaks."""
        return self._heals

    @property
    def heard(self) -> Others:
        """Return what is heard of them."""
        if self.last is None:
            return Others.NOBODY
        if self._silent:
            return Others.SILENT
        return Others.RIVAL if self._rival else Others.HEARD

    @property
    def _waits(self) -> bool:
        known = self.last is not None and self._steady >= STEADY
        return self.bridge > 0.0 and known and self.original is not Original.LOST

    def due(self, now: float) -> List[Command]:
        """Return the look that is due: what came may be unread, or the connection has ended."""
        if self.last is None or not self._waits or now < self._next_look(now):
            return []
        self._awaited = LookAtOthers(now, self.last.topic, self.last.publisher)
        return [self._awaited]

    def next(self, now: float, fills_in: bool) -> float:
        """Return when to wake; `fills_in`: it might. Infinite: not before they are heard again."""
        heard = self.heard
        waits = heard is Others.RIVAL or (heard is Others.HEARD and self._alone)
        silent = self._watch.when(self._since, self._deadline) if waits else math.inf
        return min(silent, self._next_look(now) if fills_in else math.inf)

    @property
    def _alone(self) -> bool:
        return self.cut_off and not self._publishing

    def _next_look(self, now: float) -> float:
        """Return when to look whether the connection stands.

        Until their pace is known it wakes as often: of messages that are read together only the
        newest tells when it came.
        """
        late_at = self._watch.when(self._since, self.bridge)
        if self.bridge and self._steady < STEADY and late_at > now:
            return late_at
        if not self._waits or self._awaited is not None:
            return math.inf
        return self._look if self.original.late else late_at
