"""Remembers how the messages of one publisher usually are, and which of them are of the past."""
from math import inf
from statistics import median
from typing import Dict, Iterator, List, Optional

from shsa_core.backlog import BURST_PERIODS
from shsa_core.model.samples import FormSample, Hold, Part, StampSample
from shsa_core.monitoring import settings
from shsa_core.monitoring.events import Message


class StampAges:
    """The age of one publisher's stamps; nothing is learned without the `period` of its service.

    Another computer's clock may differ from ours, and a driver may stamp what it measured earlier.
    What it does all the time is no fault. A jump of our own clock is one of all publishers at once:
    it is told, and everything is learned anew. Under simulated time some nodes stamp what /clock
    says, and some what theirs does: nothing is learned.
    """

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
        self._growing = 0.0  # so many were newer than the one before, -inf: not always

    def samples(self, message: Message) -> Iterator[StampSample]:
        """Yield what is to be judged of a message."""
        if message.age is None:
            return
        sample = StampSample(message.age, message.waited)
        if message.apart is None and self._usual is not None:
            always = self._growing >= settings.LEARN_MESSAGES
            again = always and not self._grows(message.stamp) and self._stands(message.time)
            sample = StampSample(message.age, message.waited, self._usual, self._allowed, again)
        yield sample

    def heard(self, message: Message, good: bool) -> None:
        """Learn from a message that has been judged, if it was `good`."""
        if message.age is None or message.apart is not None:
            return
        grows = self._grows(message.stamp)
        self._last = message.stamp
        if self.period is None:
            return
        if grows:
            self._growing += 1
            self._grew = message.time
        elif self._growing < settings.LEARN_MESSAGES and self._stands(message.time):
            self._growing = -inf
        if good:
            self._learn(message.age)

    def _grows(self, stamp: int) -> bool:
        return self._last is None or stamp > self._last

    def _stands(self, time: float) -> bool:
        return time - self._grew > BURST_PERIODS * (self.period or 0.0)

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


class Form:
    """The frames that one publisher names, and the lengths of its arrays: what is always the same.

    `learns`: from its first good messages.
    """

    def __init__(self, learns: bool) -> None:
        self._left = settings.AGES if learns else 0  # messages until it is known
        self._same: Optional[Dict[str, Part]] = None

    def samples(self, message: Message) -> Iterator[FormSample]:
        """Yield what a message has otherwise than all of the first good ones."""
        if self._same is not None and self._left <= 0:
            for name, part in message.form:
                if self._same.get(name, part) != part:
                    yield FormSample(name, part, self._same[name])

    def heard(self, message: Message, good: bool) -> None:
        """Learn from a message that has been judged, if it was `good`."""
        if good and self._left > 0:
            known = dict(message.form) if self._same is None else self._same
            self._same = {name: part for name, part in message.form if known.get(name) == part}
            self._left -= 1


class Stillness:
    """The time for which one value stays the same, in messages.

    Outlives connections: a longest run only allows more.

    Only noise tells: a sensor whose reading differs from message to message does not read the same
    bits for long. What moves without noise, or in coarse steps, stands still whenever the robot
    does, and is never judged; neither is an exact 0, as long as that may be rest.
    """

    def __init__(self) -> None:
        self._count = self._repeats = self._turns = self._crossings = 0
        self._longest, self._longest_zero = 1, 0
        self._low, self._high = inf, -inf

    def learn(self, value: float, run: int, step: float, step_before: float) -> None:
        """`value` came `run` times, after a step of `step_before`, and was left by `step`."""
        if value == 0.0:
            self._longest_zero = max(self._longest_zero, run)
            return
        self._count += run
        self._repeats += run - 1
        self._turns += step * step_before < 0.0
        self._crossings += value * (value + step) < 0.0
        self._longest = max(self._longest, run)
        self._low, self._high = min(self._low, value), max(self._high, value)
        if self._count > settings.FORGET_MESSAGES:
            self._count //= 2
            self._repeats //= 2
            self._turns //= 2

    def allowed(self, value: float) -> Optional[Hold]:
        """Return how long `value` may stay the same; None: for ever, or nobody knows yet."""
        changes = self._count - self._repeats
        known = self._count >= settings.LEARN_MESSAGES
        if not known or self._repeats > settings.MOST_REPEATS * self._count:
            return None
        if self._turns < settings.LEAST_TURNS * changes:
            return None
        if value == 0.0 and (self._crossings < settings.LEARN_MESSAGES or self._longest_zero > 1):
            return None
        # Whoever reads more than he can tell reads his limit, as long as that lasts.
        inside = self._low < value < self._high
        factor = 1 if inside else settings.STILL_FACTOR
        return Hold(
            settings.STILL_FACTOR * factor * self._longest,
            settings.STILL_LEAST_S * factor,
            self._longest,
        )
