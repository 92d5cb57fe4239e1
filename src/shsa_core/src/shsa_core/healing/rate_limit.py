"""How often a service may be healed."""
from collections import deque
from typing import Deque

WINDOW_S = 60.0


class HealingRateLimit:
    """Whether a service is healed too often: more than `most` times in a minute.

    If `most` is 0, any number will do.

    Once it was too often, it stays so until it is forgotten.
    """

    def __init__(self, most: int) -> None:
        self.most = most
        self.exceeded = False
        self._moments: Deque[float] = deque()

    def healed(self, time: float) -> None:
        """The service is to be healed once more."""
        self._moments.append(time)
        while self._moments[0] <= time - WINDOW_S:
            self._moments.popleft()
        self.exceeded = self.exceeded or 0 < self.most < len(self._moments)

    def forget(self) -> None:
        """Start counting anew."""
        self._moments.clear()
        self.exceeded = False
