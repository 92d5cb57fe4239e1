"""Remembers what else was going on while a publisher was late, and which gaps teach a deadline."""
from collections import deque
from dataclasses import replace
from math import inf
from typing import Deque, Dict, Iterable, List, NamedTuple, Optional, Set, Tuple

from shsa_core.derivations.settings import SAMPLE_S
from shsa_core.model.kinds import Kind
from shsa_core.monitoring import settings
from shsa_core.monitoring.alibis import Case, decide
from shsa_core.monitoring.board import FAILED, Board
from shsa_core.monitoring.publishers import Publisher, WatchedTopic
from shsa_core.watch import Watch


class _Gap(NamedTuple):
    """No message of a node from `began` to `ended`, in s."""

    node: str
    began: float
    ended: float


class Surroundings:
    """Remembers connections and gaps, and makes the case of who is late. Times in s."""

    def __init__(self, board: Board) -> None:
        self._board = board
        self._watch = Watch()
        self._busy: Dict[str, float] = {}  # when healing connected, by node; "": to a substitute
        self._waited: Dict[str, Tuple[float, float]] = {}  # when, and how much in all, by node
        self._short: Dict[str, float] = {}  # when it waited for most of the time
        self._gaps: Deque[_Gap] = deque(maxlen=settings.REMEMBERED)
        self._waiting: List[Tuple[Publisher, _Gap]] = []
        self._silent: Optional[List[_Gap]] = None  # those that have not ended, as of this look
        self._slow: List[Tuple[str, float]] = []  # who was slow at that look, and since when
        self._looked = -inf

    def look(self, late: float) -> None:
        """Look at the time; the monitor was `late` to do so."""
        self._watch.look(self._board.now, self._board.now - late)
        self._silent = None

    def connected(self, topic: WatchedTopic, node: str, substitute: bool) -> None:
        """Note a connection to a node; a `substitute` comes up, and may listen to all."""
        if substitute or node in topic.nodes:  # of others there may be any number
            self._busy["" if substitute else node] = self._board.now

    def clock(self, waited: Iterable[Tuple[str, float]]) -> None:
        """Note for how long in all nodes, by the empty name any, have waited for a processor."""
        time = self._board.now
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
        since, watch = publisher.silent_since or 0.0, self._watch
        return replace(
            self._late(Kind.SILENT, _Gap(publisher.name, since, watch.now)),
            limit=watch.now + 2 * publisher.allowed - watch.passed(since),
            due=watch.when(since, publisher.allowed),
            reconnects_until=publisher.reconnects_until,
        )

    def slow(self, kind: Kind, publisher: Publisher) -> Case:
        """Return the case of a publisher whose messages come too seldom, or too old."""
        time, rate = self._board.now, publisher.evidence.rate
        if not 0.0 <= time - self._looked < SAMPLE_S:
            self._looked = time
            slow = (p for p in self._board.all() if p.is_healthy and p.is_slow)
            self._slow = [(p.name, p.evidence.rate.was_full + p.evidence.rate.span) for p in slow]
        # Those that were slow long before it are so for another reason.
        since = rate.was_full - settings.TOGETHER_S if kind is Kind.RATE_LOW else -inf
        slow_with = {name for name, began in self._slow if began >= since}
        return self._late(kind, _Gap(publisher.name, time - rate.span, time), len(slow_with))

    def range(self, publisher: Publisher, confirmed: bool) -> Case:
        """Return the case of a publisher with a value out of range; `confirmed`: by others."""
        causes, time = _wrong_with(publisher), self._board.now
        heard = (p for p in self._board.all() if p.connected and p.speaks(time))
        outside = (p for p in heard if p.evidence.outside)
        # Who failed long before it was good last has a reason of its own.
        since = max(publisher.since, publisher.evidence.was_clean) - settings.TOGETHER_S
        outside = (p for p in outside if p.state is not FAILED or p.since >= since)
        apart = [each for each in outside if causes.isdisjoint(_wrong_with(each))]
        return Case(Kind.OUT_OF_RANGE, time, time, together=1 + len(apart), confirmed=confirmed)

    def heard(self, publisher: Publisher, began: float) -> None:
        """Learn from the gap of a healthy publisher; from a long one once the next look is done."""
        learned, service, length = publisher.learned, publisher.service, self._board.now - began
        if length >= settings.MISSED_PERIODS * (service.period or length):
            gap = _Gap(publisher.name, began, self._board.now)
            self._gaps.append(gap)
            if learned is not None and learned.is_long(length):
                self._waiting.append((publisher, gap))
                return
        if learned is not None and learned.add(length):
            self._board.look_when_due(publisher)

    def learn(self) -> None:
        """Learn from the long gaps before that have no alibi."""
        waiting, self._waiting = self._waiting, []
        for publisher, gap in waiting:
            learned, watch = publisher.learned, self._watch
            if learned is None or decide(self._late(None, gap)):
                continue
            if learned.add(watch.passed(gap.began) - watch.passed(gap.ended)):
                self._board.look_when_due(publisher)

    def _late(self, kind: Optional[Kind], gap: _Gap, together: Optional[int] = None) -> Case:
        together = self._late_with(gap) if together is None else together
        short = self.short(gap.node)
        busy = max(self._busy.get(each, -inf) for each in ("", gap.node))
        return Case(kind, gap.ended, gap.began, busy=busy, short=short, together=together)

    def _late_with(self, gap: _Gap) -> int:
        """Return how many nodes were silent for half of a gap at least, up to TOGETHER_NODES."""
        if self._silent is None:
            now = self._watch.now
            late = (p for p in self._board.all() if _is_late(p, now))
            self._silent = [_Gap(p.name, p.last_heard or 0.0, now) for p in late]
        nodes: Set[str] = {gap.node}
        for other in (*self._silent, *self._gaps):
            both = min(gap.ended, other.ended) - max(gap.began, other.began)
            if both >= (gap.ended - gap.began) / 2.0:
                nodes.add(other.node)
            if len(nodes) >= settings.TOGETHER_NODES:
                break
        return len(nodes)


def _wrong_with(publisher: Publisher) -> Set[str]:
    """Return whatever a publisher's values are wrong with: causes, and what they come from."""
    service = publisher.service
    return {*service.wrong_with, service.name, *service.upstream}


def _is_late(publisher: Publisher, time: float) -> bool:
    """Tell if a healthy publisher has missed a message."""
    period, last = publisher.service.period, publisher.last_heard
    if last is None or period is None or not publisher.is_healthy:
        return False
    return time - last >= settings.MISSED_PERIODS * period
