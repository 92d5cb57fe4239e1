"""How often a service may be healed."""
from collections import deque
from typing import Deque, Iterable, Tuple

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

    @property
    def moments(self) -> Tuple[float, ...]:
        """When the service was healed."""
        return tuple(self._moments)

    def take_up(self, moments: Iterable[float]) -> None:
        """Go on counting from what a former reconfigurator has counted."""
        self._moments.extend(moments)

    def reached(self, time: float) -> bool:
        """Whether to heal the service once more is too often."""
        while self._moments and self._moments[0] <= time - WINDOW_S:
            self._moments.popleft()
        return self.exceeded or 0 < self.most <= len(self._moments)

    def healed(self, time: float) -> None:
        """The service is healed once more."""
        self._moments.append(time)

    def forget(self) -> None:
        """Start counting anew."""
        self._moments.clear()
        self.exceeded = False
