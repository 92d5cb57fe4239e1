"""When a substitute's next message is due: period and phase, and what comes early or late."""
import math
from typing import Optional

SHORTEST_SHARE = 0.5  # of the period; no less is between two messages
MADE_UP_S = 0.02
"""What is late by no more loses no slot: the next ones follow sooner, until none is missing.

What is later was a stall: its slots are left out, so that it is followed by no burst.
"""


class Schedule:
    """Due once a period, the first time at once; without a period, only when something hastens it.

    What is due stays due until it is `done`: nothing is lost, and nothing is done twice.
    """

    def __init__(self, period: Optional[float], now: float) -> None:
        self.period = math.inf if period is None else period
        self.due = now
        self._slot = now  # where `due` would be if nothing were ever late

    def hasten(self, moment: float) -> None:
        """Be due at `moment`, unless it is due sooner anyway."""
        if moment < self.due:
            self.due = self._slot = moment

    def begin(self, moment: float) -> None:
        """Be due at `moment`; what was due before and not done is no slot that was lost."""
        self.due = self._slot = moment

    def done(self, now: float) -> None:
        """The next one is a period later, in phase, and never sooner than half a period from now.

        The phase is lost if this one was late by more than that and than MADE_UP_S.
        """
        late, half = now - self._slot, SHORTEST_SHARE * self.period
        self._slot += self.period
        if late > max(half, MADE_UP_S):
            self._slot = now + self.period
        self.due = max(self._slot, now + half)
