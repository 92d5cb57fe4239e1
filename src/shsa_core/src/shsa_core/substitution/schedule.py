"""When a substitute's next message is due: period and phase, and what comes early."""
import math
from typing import Optional

SHORTEST_SHARE = 0.5  # of the period; no less is between two messages


class Schedule:
    """Due once a period, the first time at once; without a period, only when something hastens it.

    What is due stays due until it is `done`: nothing is lost, and nothing is done twice.
    """

    def __init__(self, period: Optional[float], now: float) -> None:
        self.period = math.inf if period is None else period
        self.due = now

    def hasten(self, moment: float) -> None:
        """Be due at `moment`, unless it is due sooner anyway."""
        self.due = min(self.due, moment)

    def done(self, now: float) -> None:
        """The next one is a period later.

        In phase, unless this one was so late that two would follow closely.
        """
        self.due += self.period
        if self.due < now + SHORTEST_SHARE * self.period:
            self.due = now + self.period
