"""Remembers what else was going on while a publisher was late, and which gaps teach a deadline."""
from collections import deque
from dataclasses import replace
from math import inf
from typing import Callable, Deque, Dict, Iterable, List, NamedTuple, Optional, Set, Tuple

from shsa_core.monitoring import settings
from shsa_core.monitoring.alibis import Blame, Case, decide
from shsa_core.monitoring.events import Key
from shsa_core.monitoring.publishers import Publisher
from shsa_core.watch import Watch


class _Gap(NamedTuple):
    """No message of a node from `began` to `ended`, in s."""

    node: str
    began: float
    ended: float


class Surroundings:
    """Remembers connections and gaps, and makes the case of who is late. Times in s."""

    def __init__(self, everybody: Callable[[], Iterable[Publisher]]) -> None:
        self._everybody = everybody
        self.watch = Watch()
        self._connected: Deque[Tuple[str, float]] = deque(maxlen=settings.REMEMBERED)
        self._came_up = -inf
        self._waited: Dict[str, Tuple[float, float]] = {}  # when, and how much in all, by node
        self._short: Dict[str, float] = {}  # when it waited for most of the time
        self._gaps: Deque[_Gap] = deque(maxlen=settings.REMEMBERED)
        self._waiting: List[Tuple[str, Publisher, _Gap]] = []
        self._silent: Optional[List[_Gap]] = None  # those that have not ended, as of this look
        self._slow, self._looked = 0, -inf

    def look(self, time: float, late: float) -> None:
        """Look at the time; the monitor was `late` to do so."""
        self.watch.look(time, time - late)
        self._silent = None

    def connected(self, node: str, time: float, substitute: bool) -> None:
        """Note a connection to a node; a `substitute` comes up, and may listen to all."""
        if substitute:
            self._came_up = time
        else:
            self._connected.append((node, time))

    def clock(self, time: float, waited: Iterable[Tuple[str, float]]) -> None:
        """Note for how long in all nodes, by the empty name any, have waited for a processor."""
        for node, seconds in waited:
            since, before = self._waited.get(node, (time, seconds))
            if seconds - before > settings.SHORT_SHARE * max(time - since, 0.0):
                self._short[node] = time
            self._waited[node] = time, seconds

    def short(self, node: str) -> float:
        """Return when a node, or the computer, was short of processor time last; -inf: never."""
        return max(self._short.get(each, -inf) for each in ("", node))

    def silence(self, publisher: Publisher) -> Case:
        """Return the case of a publisher that is silent for longer than it is allowed."""
        since, watch = publisher.silent_since or 0.0, self.watch
        together = self._late_with(_Gap(publisher.name, since, watch.now))
        return replace(
            self._late(Blame.SILENCE, publisher.name, since, watch.now, together),
            limit=watch.now + 2 * publisher.allowed - watch.passed(since),
            due=watch.when(since, publisher.allowed),
            reconnects_until=publisher.reconnects_until,
        )

    def slow(self, blame: Blame, publisher: Publisher, time: float) -> Case:
        """Return the case of a publisher whose messages come too seldom, or too old."""
        span = publisher.evidence.span if publisher.evidence is not None else 0.0
        if not 0.0 <= time - self._looked < settings.SAMPLE_S:
            self._looked = time
            slow = (each for each in self._everybody() if each.is_healthy and each.is_slow)
            self._slow = len({each.name for each in slow})
        return self._late(blame, publisher.name, time - span, time, self._slow)

    def range(self, publisher: Publisher, time: float, confirmed: bool) -> Case:
        """Return the case of a publisher with a value out of range; `confirmed`: by others."""
        causes = _wrong_with(publisher)
        outside = (
            p for p in self._everybody() if p.connected and p.evidence and p.evidence.outside
        )
        apart = [p for p in outside if p.service and causes.isdisjoint(_wrong_with(p))]
        return Case(Blame.RANGE, time, time, together=1 + len(apart), confirmed=confirmed)

    def heard(self, topic: str, publisher: Publisher, began: float, time: float) -> List[Key]:
        """Take the gap of a healthy publisher; return whose allowed silence has changed by that.

        One that is long waits for `learn`: only then it is known if the monitor was held up.
        """
        learned, service, length = publisher.learned, publisher.service, time - began
        if service is not None and length >= settings.MISSED_PERIODS * (service.period or length):
            gap = _Gap(publisher.name, began, time)
            self._gaps.append(gap)
            if learned is not None and learned.is_long(length):
                self._waiting.append((topic, publisher, gap))
                return []
        return [(topic, publisher.name)] if learned is not None and learned.add(length) else []

    def learn(self) -> List[Key]:
        """Learn from the long gaps before that have no alibi; return whose allowed silence that
        changes.
        """
        waiting, self._waiting = self._waiting, []
        changed: List[Key] = []
        for topic, publisher, gap in waiting:
            learned, together = publisher.learned, self._late_with(gap)
            case = self._late(Blame.GAP, gap.node, gap.began, gap.ended, together)
            if learned is None or decide(case):
                continue
            if learned.add(self.watch.passed(gap.began) - self.watch.passed(gap.ended)):
                changed.append((topic, publisher.name))
        return changed

    def _late(self, blame: Blame, node: str, began: float, time: float, together: int) -> Case:
        return Case(
            blame,
            time,
            began,
            connected=next((at for name, at in reversed(self._connected) if name == node), -inf),
            came_up=self._came_up,
            short=self.short(node),
            together=together,
        )

    def _late_with(self, gap: _Gap) -> int:
        """Return how many nodes were silent for half of a gap at least, up to TOGETHER_NODES."""
        if self._silent is None:
            now = self.watch.now
            late = (p for p in self._everybody() if _is_late(p, now))
            self._silent = [_Gap(p.name, p.last_heard or 0.0, now) for p in late]
        nodes: Set[str] = {gap.node}
        for gaps in (self._silent, self._gaps):
            for other in gaps:
                both = min(gap.ended, other.ended) - max(gap.began, other.began)
                if both >= (gap.ended - gap.began) / 2.0:
                    nodes.add(other.node)
                if len(nodes) >= settings.TOGETHER_NODES:
                    return len(nodes)
        return len(nodes)


def _wrong_with(publisher: Publisher) -> Set[str]:
    """Return whatever a publisher's values are wrong with: causes, and what they come from."""
    service = publisher.service
    return {*service.wrong_with, service.name, *service.upstream} if service else set()


def _is_late(publisher: Publisher, time: float) -> bool:
    """Tell if a healthy publisher has missed a message."""
    service, last = publisher.service, publisher.last_heard
    if last is None or service is None or service.period is None or not publisher.is_healthy:
        return False
    return time - last >= settings.MISSED_PERIODS * service.period
