"""The last few messages of each publisher, as bytes: a substitute's messages start from one."""
from collections import deque
from dataclasses import replace
from math import inf
from typing import Deque, Dict, Iterable, List, Optional, Tuple

from shsa_core.model.health import Key, PublisherHealth
from shsa_core.model.names import RecentNames
from shsa_core.model.substitution import Substitution
from shsa_core.monitoring.events import HealthChanged
from shsa_core.monitoring.settings import LAST_MESSAGE_B, MESSAGES_KEPT, OLDEST_MESSAGE_S


class LastMessages:
    """Messages by topic and publisher, each with the time at which it came, in s."""

    def __init__(self) -> None:
        self._kept: Dict[Key, Deque[Tuple[float, bytes]]] = {}
        self._failed: Dict[Key, PublisherHealth] = {}
        self._substitutes = RecentNames()  # each is used once
        self._stand_ins: Dict[str, str] = {}  # by service: who computed it last

    def keep(self, time: float, topic: str, publisher: str, data: bytes) -> None:
        """Keep a message; it takes the place of the oldest."""
        if len(data) > LAST_MESSAGE_B:
            return
        kept = self._kept.get((topic, publisher))
        if kept is None:
            since = time - OLDEST_MESSAGE_S
            self._kept = {each: m for each, m in self._kept.items() if m[-1][0] >= since}
            kept = self._kept[topic, publisher] = deque(maxlen=MESSAGES_KEPT)
        kept.append((time, data))

    def newest(self, topic: str, publisher: str, last: Optional[float], now: float) -> bytes:
        """Return the newest message that came at `last` or before; empty if none was kept."""
        if last is None:
            return b""
        for time, data in reversed(self._kept.get((topic, publisher), ())):
            if time <= last:
                return data if time >= now - OLDEST_MESSAGE_S else b""
        return b""

    def substitutions(self, rows: Iterable[Substitution]) -> None:
        """Note who stands in for whom; safe values tell nothing of the robot."""
        for row in (row for row in rows if row.node):  # the others are plans
            self._substitutes.add(row.node)
            if row.publishing and row.quality > 0.0:
                self._stand_ins[row.service] = row.node

    def rows(self, change: HealthChanged) -> Tuple[List[PublisherHealth], List[PublisherHealth]]:
        """Return changed rows, and those of new failures.

        Each failed one has the message from which a substitute goes on, a healthy original any.
        A row that failed before changes where its substitute has left: whoever takes over next, or
        a reconfigurator that is started then, goes on where that was.
        """
        rows = [self._row(row, change.time) for row in change.rows]
        new = [self._row(row, change.time) for row in change.failed]
        failed = {row.key for row in rows if row.has_failed}
        for key in (*change.removed, *(row.key for row in rows if row.key not in failed)):
            self._failed.pop(key, None)
        left = failed.union(change.removed)
        for key, row in self._failed.items():
            stand_in = row.topic, self._stand_ins.get(row.service, "")
            message = self.newest(*stand_in, inf, change.time) if stand_in in left else b""
            if message:
                self._failed[key] = replace(row, last_message=message)
                rows.append(self._failed[key])
        return rows, new

    def _row(self, row: PublisherHealth, time: float) -> PublisherHealth:
        ours, failed = row.publisher in self._substitutes, row.has_failed
        if not failed and (ours or not row.is_well):
            return row
        before = self._failed.get(row.key)
        if before is None or before.since != row.since:
            before = replace(row, last_message=self.newest(*row.key, row.last_good, time))
        row = replace(row, last_message=before.last_message)
        if failed and not ours:
            self._failed[row.key] = row
        return row
