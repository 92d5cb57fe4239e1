"""How often a muted substitute has filled in for an original that was late: so that it is seen.

Its messages are held against nobody, and are not taken for the original's.
"""
from dataclasses import dataclass
from math import inf
from typing import Dict, Optional

from shsa_core.model.substitution import Substitution
from shsa_core.monitoring.events import Bridged, Key

APART = 2.0
"""After so many of its bridges without a message it is another time."""
SERVES_S = 1.0
"""So long one that was muted serves consumers to whom the original is not connected yet."""
TELL_S = 60.0
"""People are told at the first time, and then so often at most."""


@dataclass
class _Count:
    """How often a service was bridged; when its next one is told."""

    times: int = 0
    tell: float = -inf


class Bridges:
    """The messages of muted substitutes. Times in s."""

    def __init__(self) -> None:
        self._counts: Dict[str, _Count] = {}
        self._latest: Dict[Key, float] = {}

    def muted(self, key: Key, time: float) -> None:
        """A substitute publishes no more: what comes soon is of those whom it still serves."""
        self._latest[key] = time + SERVES_S

    def heard(self, key: Key, row: Substitution, time: float) -> Optional[Bridged]:
        """A muted substitute has published; what people are told of that, if it is told now."""
        latest = self._latest.get(key, -inf)
        self._latest[key] = max(time, latest)
        if time - latest <= APART * row.bridge:
            return None
        count = self._counts.setdefault(row.service, _Count())
        count.times += 1
        if time < count.tell:
            return None
        count.tell = time + TELL_S
        return Bridged(time, row.service, *key, count.times)

    def times(self, service: str) -> int:
        """How often a service was bridged so far."""
        count = self._counts.get(service)
        return 0 if count is None else count.times
