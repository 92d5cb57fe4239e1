"""The age of a publisher's stamps: learned while it is healthy, so that a constant offset is none.

Another computer's clock may differ from ours, and a driver may stamp what it measured earlier. What
it does all the time is no fault. A jump of our own clock is one of all publishers at once: it is
told, and everything is learned anew.
"""
from math import inf
from statistics import median
from typing import List, Optional

from shsa_core.model.samples import StampSample
from shsa_core.monitoring import settings
from shsa_core.monitoring.events import Message


class StampAges:
    """The stamps of one publisher; nothing is learned without the `period` of its service."""

    def __init__(self, period: Optional[float]) -> None:
        self.period = period
        self.forget()

    def forget(self) -> None:
        """Learn anew: our clock jumped."""
        self._ages: List[float] = []
        self._usual: Optional[float] = None
        self._allowed = 0.0
        self._last: Optional[int] = None
        self._grew = 0.0  # when a newer stamp came last
        self._growing: Optional[int] = 0
        self._stood = False

    def sample(self, time: float, stamp: int, age: float, waited: float) -> StampSample:
        """Return what is to be judged of what came at `time` s, `age` s after its `stamp` in ns."""
        if self._usual is None:
            return StampSample(age, waited)
        always = self._growing is not None and self._growing >= settings.LEARN_MESSAGES
        again = always and not self._grows(stamp) and self._stands(time)
        return StampSample(age, waited, self._usual, self._allowed, again)

    def heard(self, time: float, stamp: int, age: float, good: bool) -> None:
        """Learn from a message that has been judged, if it was `good`."""
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
        return time - self._grew > settings.BURST_PERIODS * (self.period or 0.0)

    def _learn_growth(self, grows: bool) -> None:
        """Stamps that now and then do not grow need not; those of a fault do so again and again."""
        if self._growing is None:
            return
        if grows:
            self._growing += 1
            if self._stood and self._growing >= settings.LEARN_MESSAGES + settings.STANDS_MESSAGES:
                self._growing = None
        elif self._growing < settings.LEARN_MESSAGES:
            self._growing = None
        else:
            self._stood, self._growing = True, settings.LEARN_MESSAGES

    def _learn(self, age: float) -> None:
        if self._usual is not None and age < self._usual - settings.AGE_LEAST_S / 2:
            self._usual = None  # it was learned of messages that had waited before we came
        if self._usual is not None:
            self._usual += settings.AGE_FOLLOWS * (age - self._usual)
            return
        self._ages.append(age)
        if len(self._ages) >= settings.AGES:
            self._usual = median(self._ages)
            spread = max(abs(each - self._usual) for each in self._ages)
            self._allowed = max(
                settings.AGE_LEAST_S,
                settings.AGE_PERIODS * (self.period or 0.0),
                settings.AGE_SPREADS * spread,
            )
            self._ages.clear()


class Backlog:
    """Tells the messages of one publisher that it sent while it could not be heard.

    So it is where a link to another computer was down. They come all at once: they are as old as
    the silence was, and come faster than it ever publishes.
    """

    def __init__(self) -> None:
        self._age: Optional[float] = None  # of its messages as they come, in s
        self._catches_up = False
        self._until = -inf

    def holds(
        self, message: Message, previous: Optional[float], allowed: float, period: Optional[float]
    ) -> bool:
        """Tell if a message tells of the past; `previous`: when the one before it came.

        After a silence of more than `allowed` s a message counts once its stamp is about as old as
        usual, and it comes half a period after another one. Where no stamp tells, the first of
        them might be old. What comes old for longer than the silence was is no backlog: a clock
        was set.
        """
        if previous is None or period is None:
            return self._count(message)
        passed = message.time - previous
        began = passed - message.waited > allowed
        self._catches_up = self._catches_up or began
        if began:
            self._until = message.time + passed
        if not self._catches_up:
            return self._count(message)
        late = began
        if message.age is not None and self._age is not None:
            late = message.age - self._age > allowed and message.time < self._until
        if late or passed < settings.BURST_PERIODS * period:
            return True
        return self._count(message)

    def _count(self, message: Message) -> bool:
        self._catches_up = False
        if message.age is not None:
            self._age = message.age
        return False
