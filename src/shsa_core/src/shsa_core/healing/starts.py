"""Paces the starts of what stands by, so that the robot's own nodes are not starved by them."""
from math import inf
from typing import Dict, List, Optional

AT_ONCE = 2
"""So many processes come up at a time: each costs most of a core until it is heard."""
PATIENCE_S = 5.0
"""So long at most is a process awaited: one that is never heard holds nobody up for good.

On a machine that is busy a start takes seconds: with less patience they would pile up.
"""
PREPARING_S = 5.0
"""So long at most nothing is started that stands by, until it can be forked."""


class Starts:
    """Which processes are coming up, and which services wait for a hot substitute.

    A failure never waits: only what is prepared asks for room.
    """

    def __init__(self) -> None:
        self._began: Dict[str, float] = {}
        self._waiting: Dict[str, None] = {}
        self._held = -inf

    @property
    def deadline(self) -> Optional[float]:
        """When the next one may be started at the latest, in s; None: nobody waits."""
        if not self._waiting:
            return None
        ends = sorted(began + PATIENCE_S for began in self._began.values())
        room = ends[-AT_ONCE] if len(ends) >= AT_ONCE else -inf
        return max(room, self._held)

    def hold(self, time: float) -> None:
        """Start nothing that stands by: it can soon be forked."""
        self._held = time + PREPARING_S

    def release(self) -> None:
        """It can be forked."""
        self._held = -inf

    def held(self, time: float) -> bool:
        """Whether what stands by waits until it can be forked."""
        return time < self._held

    def earliest(self, due: Optional[float]) -> Optional[float]:
        """When something that stands by, and is due at a moment, may be started; in s."""
        return None if due is None else max(due, self._held)

    def began(self, time: float, node: str) -> None:
        """A process is started; those that were awaited for long enough are forgotten."""
        self._began = {n: b for n, b in self._began.items() if time < b + PATIENCE_S}
        self._began[node] = time

    def over(self, node: str) -> None:
        """A process was heard, or has ended."""
        self._began.pop(node, None)

    def room(self, time: float, service: str) -> bool:
        """Whether a service may have a hot substitute started now; else it waits for its turn."""
        if self._room(time):
            return True
        self._waiting[service] = None
        return False

    def forget(self) -> None:
        """Nobody waits any more: we are about to end."""
        self._waiting.clear()

    def due(self, time: float) -> List[str]:
        """The services whose turn it is now: no more than have room."""
        names = list(self._waiting)[: self._room(time)]
        for name in names:
            del self._waiting[name]
        return names

    def _room(self, time: float) -> int:
        """How many may be started now."""
        coming_up = sum(time < began + PATIENCE_S for began in self._began.values())
        return 0 if self.held(time) else max(0, AT_ONCE - coming_up)
