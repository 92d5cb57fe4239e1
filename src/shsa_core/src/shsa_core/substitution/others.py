"""Listens to the other publishers of a substitute's topic, by an honest watch.

Only a silent connection is bridged: one that has ended is the reconfigurator's to judge, which is
told at once, and tells a node that died from one that was stopped on purpose. Until its word comes,
or where there is none, as without a monitor, the substitute fills in for a node that is gone.
"""
import math
from typing import Callable, List, Optional, Tuple

from shsa_core.backlog import BURST_PERIODS
from shsa_core.model.kinds import OnPartition
from shsa_core.model.names import Names
from shsa_core.model.substitution import CHANGEOVER_S, Substitution
from shsa_core.substitution.events import Command, LookAtOthers, OtherGone, OtherHeard, OthersStand
from shsa_core.substitution.settings import ALONE_LOOKS, FADES, LATE, LOOK_AGAIN_S, STEADY
from shsa_core.substitution.voice import Heard, Original
from shsa_core.watch import Watch

NAMES = Names("")


class OtherPublishers:
    """The other publishers of `topic`; empty: nobody is listened for. Times in s.

    `sources()` tells who publishes what the program reads.
    """

    def __init__(self, sources: Callable[[], Tuple[str, ...]]) -> None:
        self.topic = self.provider = self._replaced = ""
        self.heard, self.last = Heard.NOBODY, OtherHeard(-math.inf, "")
        self.original = Original.LOST
        self.heals = False  # beyond a cut the substitute may decide by itself
        self.bridge = 0.0  # the silence after which it fills in at the latest; 0: it does not
        self._sources = sources
        self._watch = Watch()
        self._since = -math.inf  # when they were heard, or it began to listen
        self._anybody = -math.inf  # the same, with strangers
        self._counted = -math.inf  # when the first of those came that came at once
        self.cut = False  # the reconfigurator is out of reach
        self._judged = -math.inf  # by then it knows of those whom we heard while it was
        self._publishing = self._yields = False
        self._deadline = math.inf
        self._paced = "", ""  # whose pace it is: the topic, and the provider
        self._steady = 0  # times in a row that messages came, and were not late
        self._longest = self._gap = 0.0  # silences: of late, and before those that came last
        self._came, self._at_once = 1, 0.0  # messages at once, and what is less between them
        self._was_late = False  # it looked, and nothing had come
        self._read = sources()  # when they were heard
        self._awaited: Optional[LookAtOthers] = None
        self._look = math.inf
        self._alone = 0  # looks for which it goes on without a healer

    def follow(self, row: Substitution, topic: str, may_bridge: bool) -> None:
        """Follow another row; `topic`: that of the program, which may fill in or not."""
        bridge = row.bridge if may_bridge and not row.publishing and topic in row.topics else 0.0
        begins = may_bridge or row.publishing  # a last message has started what integrates
        self.heals = row.on_partition is OnPartition.HEAL and topic != "" and begins
        listens = self.heals or row.yields
        listened = topic if listens or bridge else ""
        if not bridge or not self.bridge or (listened, row.provider) != (self.topic, self.provider):
            self._leave()
        if bridge and (listened, row.provider) != self._paced:  # one that returns keeps its pace
            self.forget()
            self._paced = listened, row.provider
        if listened != self.topic:
            self.topic, self.heard = listened, Heard.NOBODY
            self._since = self._anybody = self._watch.now
        if self.heard is Heard.RIVAL and not (listens and row.publishing is self._publishing):
            self.heard = Heard.ANOTHER
        self.provider, self._replaced = row.provider, row.original
        self._deadline = (row.outputs[0].deadline if row.outputs and listens else None) or math.inf
        self._publishing, self._yields, self.bridge = row.publishing, row.yields, bridge
        self._at_once = BURST_PERIODS * (row.outputs[0].period or 0.0) if row.outputs else 0.0

    def forget(self) -> None:
        """Fill in for nobody until a row says so, and somebody was heard at a steady pace."""
        self.bridge, self._steady, self._longest, self._gap = 0.0, 0, 0.0, 0.0
        self._paced = "", ""
        self._leave()

    def _leave(self) -> None:
        """Leave the original to the reconfigurator until it speaks."""
        self.original, self._awaited = Original.LOST, None

    # What is heard.

    def part(self, cut: bool) -> None:
        """Note that the reconfigurator is out of reach, or in reach again."""
        if self.cut and not cut:
            self._judged = self._watch.now + CHANGEOVER_S
        self.cut = cut

    def pass_time(self, now: float, wanted: float) -> None:
        """Let time pass; we `wanted` to wake by then, inf: whenever."""
        self._watch.look(now, wanted)
        if self.heard is not Heard.NOBODY and self._watch.has_passed(self._anybody, self._deadline):
            self.heard = Heard.SILENCE

    def hear(self, event: OtherHeard) -> None:
        """Somebody else has published; a stranger is nobody to fill in for, or to yield to."""
        if not self.topic or event.topic != self.topic:
            return
        known = self.provider in ("", event.publisher)
        still = self.heard is Heard.RIVAL
        apart = self._publishing and (self.cut or still and self._stays(event.publisher))
        rival = (self.heals and apart) or (self._yields and known)
        if rival or not still and (known or self.heals):  # a cut may have parted us from anybody
            self.heard, self._anybody = Heard.RIVAL if rival else Heard.ANOTHER, self._watch.now
        if not rival and not known:
            return
        self._note_pace(self._watch.passed(self._since))
        self.last, self._since, self._read = event, self._watch.now, self._sources()
        self.original, self._awaited, self._alone = Original.SPEAKS, None, 0

    def _stays(self, publisher: str) -> bool:
        """Return if a rival stays one in reach; a stranger does until it must have been judged."""
        named = publisher in (self.provider, self._replaced)
        return named or self._watch.now < self._judged or NAMES.of_healing(publisher, False)

    def _note_pace(self, passed: float) -> None:
        """Note the silence before a message; of some that came at once, each had its share."""
        apart = self._watch.passed(self._counted)
        if passed <= self._at_once and apart < self.bridge / 2.0:
            self._came += 1
            if self._was_late:  # it makes up for that, as who sends in batches always does
                self._steady = 0
            return
        self._counted, self._was_late = self._watch.now, self.original.late
        if self._steady < STEADY and passed >= self.bridge:
            self._steady, self._longest, self._gap = 0, 0.0, 0.0
            return
        self._steady = min(self._steady + 1, STEADY)
        before = min(self._gap / self._came, self.bridge / LATE)
        self._longest = max(self._longest * FADES**self._came, before)
        self._gap, self._came = apart, 1

    def gone(self, event: OtherGone) -> None:
        """The node of somebody else is gone: nobody has to wait for its silence."""
        last = self.last.topic, self.last.publisher
        speaks = self._waits and self.original is Original.SPEAKS
        if speaks and (event.topic, event.publisher) == last:
            self._judge(Original.ENDED, event.time)

    def answer(self, event: OthersStand) -> None:
        """Take the answer to a look; one that is not awaited is out of date."""
        if event.look != self._awaited:
            return
        quick = self.original is Original.SPEAKS and self._quick
        self._alone = ALONE_LOOKS if event.alone else self._alone - 1
        if event.stands:
            self._judge(Original.HANGS, event.time)
        elif self.original is Original.HANGS or quick or self._alone > 0:
            self._judge(Original.ENDED, event.time)
        else:
            self._leave()

    def _judge(self, original: Original, time: float) -> None:
        self.original, self._awaited = original, None
        self._look = time + max(self.bridge, LOOK_AGAIN_S)
        self.compare()

    def compare(self) -> None:
        """Fill in no more if somebody else publishes what the program reads.

        It may be one that fills in as well: the two would live on each other's word.
        """
        if self.original.late and self._sources() != self._read:
            self._leave()

    # What follows.

    @property
    def cut_off(self) -> bool:
        """Return if it decides by itself whether it publishes."""
        return self.cut and self.heals

    @property
    def _waits(self) -> bool:
        return self._steady >= STEADY and self.original is not Original.LOST

    def due(self, now: float) -> List[Command]:
        """Return the look that is due: what came may be unread, or the connection has ended."""
        if not self._waits or now < self._next_look(now):
            return []
        self._awaited = LookAtOthers(now, self.last.topic, self.last.publisher)
        return [self._awaited]

    def next(self, now: float, fills_in: bool) -> float:
        """Return when to wake; `fills_in`: it might. Infinite: not before they are heard again."""
        alone = self.heard is Heard.ANOTHER and self.cut_off and not self._publishing
        waits = alone or self.heard is Heard.RIVAL
        silent = self._watch.when(self._anybody, self._deadline) if waits else math.inf
        return min(silent, self._next_look(now) if fills_in else math.inf)

    @property
    def _quick(self) -> bool:
        """Return if it fills in before the reconfigurator can be heard."""
        return self.bridge < LOOK_AGAIN_S / 2.0

    @property
    def _patience(self) -> float:
        """Return the silence after which it fills in; what is quick would wake it too often."""
        fixed = self._steady < STEADY or self._quick
        return self.bridge if fixed else min(self.bridge, LATE * self._longest)

    def _next_look(self, now: float) -> float:
        """Return when to look whether the connection stands.

        Until their pace is known it wakes as often: of messages that are read together only the
        newest tells when it came.
        """
        late_at = self._watch.when(self._since, self._patience)
        if self.bridge and self._steady < STEADY and late_at > now:
            return late_at
        if not self._waits or self._awaited is not None:
            return math.inf
        return self._look if self.original.late else late_at
