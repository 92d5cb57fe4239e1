"""Keeps the voice of a substitute: asks the table of voices, and begins what a new one needs."""
from typing import Optional

from shsa_core.model.substitution import Substitution
from shsa_core.substitution.handover import Handover
from shsa_core.substitution.job import Job
from shsa_core.substitution.others import OtherPublishers, Sources
from shsa_core.substitution.voice import Order, Original, Voice, decide


class Speech:
    """The `voice` of a substitute, the others on its topic, and the way back of its original."""

    def __init__(self, sources: Sources) -> None:
        self.voice = Voice.MUTED
        self.handover = Handover()
        self.others = OtherPublishers(sources)
        self._topic = ""

    def update(
        self, now: float, row: Substitution, job: Optional[Job], by_row: bool = False
    ) -> bool:
        """Take up the voice that is right now; return if it begins to fill in.

        `by_row`: the row has changed, which names the original. What a substitute begins or ends
        by itself it does for nobody who could be asked whom it serves.
        """
        topic = "" if job is None else job.topic
        before, after = self.voice, self._decide(now, row, topic)
        self.voice = after
        begins = after.publishes and not before.publishes
        ends = before.publishes and not after.publishes
        if by_row or begins or ends:
            stays = topic == self._topic and topic in row.topics
            original = row.original if by_row else ""
            if begins or not (stays and original == self.handover.original):
                named = after.publishes or (ends and stays)
                period = None if job is None else job.period
                self.handover.stand_in(topic, original if named else "", period, now)
            if ends:
                self.handover.mute(now)
            self.voice = self._decide(now, row, topic)  # it may hand over now
        if begins and job is not None:
            job.schedule.begin(now)
        self._topic = topic
        return after is Voice.FILLS_IN and before is not Voice.FILLS_IN

    def hands_over(self, now: float) -> bool:
        """Return if it is muted, and serves whom its original does not serve yet."""
        return self.handover.under_way(now)

    def _decide(self, now: float, row: Substitution, topic: str) -> Voice:
        others = self.others
        original = Original.BACK if self.hands_over(now) else others.original
        return decide(self._order(row, topic), others.heard, others.cut_off, original)

    def _order(self, row: Substitution, topic: str) -> Order:
        """Return what a row says of the topic of the program."""
        if topic not in row.topics:
            return Order.NOTHING
        if row.gated:
            return Order.ALWAYS
        if row.publishing:
            return Order.PUBLISH
        return Order.BRIDGE if self.others.bridge else Order.MUTE
