"""The age of a publisher's stamps: learned while it is healthy, so that a constant offset is none.

Another computer's clock may differ from ours, and a driver may stamp what it measured earlier. What
it does all the time is no fault. A jump of our own clock is one of all publishers at once: it is
told, and everything is learned anew.
"""
from statistics import median
from typing import List, Optional

from shsa_core.model.checks import StampSample

LEARN_MESSAGES = 50
FOLLOW = 0.001
"""Of a message's difference the usual age follows: clocks drift apart by parts in a million."""
LEAST_S = 0.5
PERIODS = 10.0
SPREADS = 3.0
"""A stamp may differ by this, by so many periods or by so many times the largest difference while
learning, whichever is most."""
LEARN_GROWING = 200
GRACE_MESSAGES = 10
"""Stamps that grew so often always grow, unless one does not and so many after it do."""
STAND_PERIODS = 0.5
"""Some clocks are coarse, and a node may send in a burst what it was held up with: a stamp stands
only once it did so for this."""


class Stamps:
    """The stamps of one publisher; nothing is learned without the `period` of its service."""

    def __init__(self, period: Optional[float]) -> None:
        self.period = period
        self.forget()

    def forget(self) -> None:
        """Our clock jumped: learn anew."""
        self._ages: List[float] = []
        self._usual: Optional[float] = None
        self._allowed = 0.0
        self._last: Optional[int] = None
        self._grew = 0.0  # when a newer stamp came last
        self._growing: Optional[int] = 0
        self._stood = False

    def sample(self, time: float, stamp: int, age: float, waited: float) -> StampSample:
        """What is to be judged of what came at `time` s, `age` s after its `stamp` in ns."""
        if self._usual is None:
            return StampSample(age, waited)
        always = self._growing is not None and self._growing >= LEARN_GROWING
        again = always and not self._grows(stamp) and self._stands(time)
        return StampSample(age, waited, self._usual, self._allowed, again)

    def heard(self, time: float, stamp: int, age: float, good: bool) -> None:
        """A message has been judged; learn from it if it was `good`."""
        grows = self._grows(stamp)
        self._last = stamp
        if self.period is None:
            return
        if grows or self._stands(time):
            self._learn_growth(grows)
        if grows:
            self._grew = time
        if good:
            self._learn(age)

    def _grows(self, stamp: int) -> bool:
        return self._last is None or stamp > self._last

    def _stands(self, time: float) -> bool:
        return time - self._grew > STAND_PERIODS * (self.period or 0.0)

    def _learn_growth(self, grows: bool) -> None:
        """Stamps that now and then do not grow need not; those of a fault do so again and again."""
        if self._growing is None:
            return
        if grows:
            self._growing += 1
            if self._stood and self._growing >= LEARN_GROWING + GRACE_MESSAGES:
                self._growing = None
        elif self._growing < LEARN_GROWING:
            self._growing = None
        else:
            self._stood, self._growing = True, LEARN_GROWING

    def _learn(self, age: float) -> None:
        if self._usual is not None and age < self._usual - LEAST_S / 2:
            self._usual = None  # it was learned of messages that had waited before we came
        if self._usual is not None:
            self._usual += FOLLOW * (age - self._usual)
            return
        self._ages.append(age)
        if len(self._ages) >= LEARN_MESSAGES:
            self._usual = median(self._ages)
            spread = max(abs(each - self._usual) for each in self._ages)
            self._allowed = max(LEAST_S, PERIODS * (self.period or 0.0), SPREADS * spread)
            self._ages.clear()
