"""Moments at which something is due: one a key, the earliest at hand."""
from heapq import heappop, heappush
from math import inf
from typing import Dict, Generic, List, Optional, Tuple, TypeVar

Key = TypeVar("Key")


class Agenda(Generic[Key]):
    """Moments by key; to set or find the earliest costs the same however many there are."""

    def __init__(self) -> None:
        self._due: Dict[Key, float] = {}
        self._heap: List[Tuple[float, int, Key]] = []
        self._count = 0

    def set(self, key: Key, due: Optional[float]) -> None:
        """Have `key` due at `due`, in s; None, or infinite: no more."""
        if due is None or due == inf:
            self._due.pop(key, None)
        elif due != self._due.get(key):
            self._due[key] = due
            self._count += 1  # so that keys need no order
            heappush(self._heap, (due, self._count, key))

    def bring_forward(self, key: Key, due: float) -> None:
        """Have `key` due at `due`, in s, or earlier if it was; never if that is infinite."""
        if due < self.when(key):
            self.set(key, due)

    def when(self, key: Key) -> float:
        """Return when `key` is due, in s; infinite: it is not."""
        return self._due.get(key, inf)

    def next(self) -> float:
        """Return when the earliest is due, in s; infinite: nothing is."""
        while self._heap and self._due.get(self._heap[0][2]) != self._heap[0][0]:
            heappop(self._heap)
        return self._heap[0][0] if self._heap else inf

    def pop_due(self, time: float) -> List[Key]:
        """Return the keys that are due at `time`, earliest first; they are due no more."""
        found: List[Key] = []
        while self.next() <= time and self._due:
            key = heappop(self._heap)[2]
            del self._due[key]
            found.append(key)
        return found


def doubled(first: float, times: int, longest: float = inf) -> float:
    """Return a pause in s that doubles each time, up to `longest`."""
    return min(first * 2.0 ** min(times, 60), longest)  # a power of a thousand is an error
