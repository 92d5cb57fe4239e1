"""The last few messages of each publisher, as bytes: a substitute's messages start from one."""
from collections import deque
from typing import Deque, Dict, Optional, Tuple

COUNT = 20
"""So many are kept of each publisher: the evidence against it begins with one of the last `of`."""
LARGEST_B = 65536
"""A larger message is not kept: it would travel in a table."""
OLDEST_S = 60.0
"""An older message is not handed out."""

Key = Tuple[str, str]


class LastMessages:
    """Messages by topic and publisher, each with the time at which it came, in s."""

    def __init__(self) -> None:
        self._kept: Dict[Key, Deque[Tuple[float, bytes]]] = {}

    def keep(self, time: float, topic: str, publisher: str, data: bytes) -> None:
        """Keep a message; it takes the place of the oldest."""
        if len(data) > LARGEST_B:
            return
        kept = self._kept.get((topic, publisher))
        if kept is None:
            self._forget_before(time - OLDEST_S)
            kept = self._kept[topic, publisher] = deque(maxlen=COUNT)
        kept.append((time, data))

    def newest(self, topic: str, publisher: str, last: Optional[float], now: float) -> bytes:
        """The newest message that came at `last` or before; empty if none was kept."""
        if last is None:
            return b""
        for time, data in reversed(self._kept.get((topic, publisher), ())):
            if time <= last:
                return data if time >= now - OLDEST_S else b""
        return b""

    def _forget_before(self, time: float) -> None:
        for key in [key for key, kept in self._kept.items() if kept[-1][0] < time]:
            del self._kept[key]
