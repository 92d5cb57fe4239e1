"""Which gaps teach how long a stream may be silent: those of the stream, and of nothing else.

A gap that had one of the causes of `silence` is no habit of the publisher. Whoever missed no
message needs no excuse, so that only long gaps are looked at; they are once time has passed, as
only then it is known whether the monitor itself was late.
"""
from collections import deque
from typing import Deque, Iterable, List, NamedTuple, Tuple

from shsa_core.monitoring.events import Key, Tick
from shsa_core.monitoring.publishers import Publisher
from shsa_core.monitoring.silence import MISSED_PERIODS, TOGETHER_NODES, Excuses, is_silent_for

KEEP = 200
"""Long gaps that are remembered, to know of those that were at the same time."""
LATE_SHARE = 0.1
"""Of a gap: a monitor that was late by as much saw more of a gap than there was."""


class _Gap(NamedTuple):
    """No message from `began` to `ended`, in s."""

    node: str
    began: float
    ended: float


class Lessons:
    """Teaches the learned deadlines of publishers."""

    def __init__(self, excuses: Excuses) -> None:
        self._excuses = excuses
        self._recent: Deque[_Gap] = deque(maxlen=KEEP)
        self._waiting: List[Tuple[str, Publisher, _Gap]] = []

    def heard(self, topic: str, publisher: Publisher, began: float, time: float) -> List[Key]:
        """A healthy publisher sent a message, the one before at `began`: whose allowed silence has
        changed by that.
        """
        learned, service, length = publisher.learned, publisher.service, time - began
        missed = service is not None and length >= MISSED_PERIODS * (service.period or length)
        if missed:
            gap = _Gap(publisher.name, began, time)
            self._recent.append(gap)
            if learned is not None and learned.is_long(length):
                self._waiting.append((topic, publisher, gap))
                return []
        changed = learned is not None and learned.add(length)
        return [(topic, publisher.name)] if changed else []

    def learn(self, now: Tick, everybody: Iterable[Tuple[object, Publisher]]) -> List[Key]:
        """Time has passed: whose allowed silence has changed by the long gaps before."""
        if not self._waiting:
            return []
        waiting, self._waiting = self._waiting, []
        publishers = [each for _, each in everybody]
        changed: List[Key] = []
        for topic, publisher, gap in waiting:
            learned = publisher.learned
            if learned is None or self._has_another_cause(gap, now, publishers):
                continue
            if learned.add(gap.ended - gap.began):
                changed.append((topic, publisher.name))
        return changed

    def _has_another_cause(self, gap: _Gap, now: Tick, publishers: List[Publisher]) -> bool:
        length = gap.ended - gap.began
        if now.late >= LATE_SHARE * length or self._excuses.disturbed(gap.node, gap.began):
            return True
        together = {gap.node}
        for other in self._recent:
            if min(gap.ended, other.ended) - max(gap.began, other.began) >= length / 2.0:
                together.add(other.node)
        if len(together) < TOGETHER_NODES:
            together.update(p.name for p in publishers if is_silent_for(p, length / 2.0, now.time))
        return len(together) >= TOGETHER_NODES
