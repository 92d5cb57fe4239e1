"""What is due when: costs what is due, not how much there is."""
import heapq
from math import inf
from typing import Dict, Generic, Hashable, Iterator, List, Tuple, TypeVar

What = TypeVar("What", bound=Hashable)


class Alarms(Generic[What]):
    """One alarm for each thing, at a time in s.

    An alarm may come early: whoever hears it looks, and sets it again.
    """

    def __init__(self) -> None:
        self._heap: List[Tuple[float, int, What]] = []
        self._set: Dict[What, Tuple[float, int]] = {}
        self._count = 0

    @property
    def next(self) -> float:
        """When the next alarm comes; inf: none will."""
        heap = self._heap
        while heap and self._set.get(heap[0][2]) != heap[0][:2]:
            heapq.heappop(heap)
        return heap[0][0] if heap else inf

    def when(self, what: What) -> float:
        """When the alarm of `what` comes; inf: it will not."""
        return self._set.get(what, (inf, 0))[0]

    def set(self, what: What, time: float) -> None:
        """Give the alarm of `what` at `time`, or earlier if it is set already."""
        if time < self.when(what):
            self._count += 1
            self._set[what] = time, self._count
            heapq.heappush(self._heap, (time, self._count, what))

    def due(self, time: float) -> Iterator[What]:
        """The things whose time has come, each once; they may be set again meanwhile."""
        while self.next <= time:
            what = heapq.heappop(self._heap)[2]
            del self._set[what]
            yield what
