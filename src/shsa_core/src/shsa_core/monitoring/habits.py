"""Remembers how the messages of one publisher usually are, and which of them are of the past."""
from math import inf
from statistics import median
from typing import Iterator, List, Optional

from shsa_core.model.samples import FormSample, Hold, StampSample, Usual
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
        self._growing: Optional[int] = 0
        self._stood = False

    def samples(self, message: Message) -> Iterator[StampSample]:
        """Yield what is to be judged of a message."""
        if message.age is None:
            return
        sample = StampSample(message.age, message.waited)
        if message.apart is None and self._usual is not None:
            always = self._growing is not None and self._growing >= settings.LEARN_MESSAGES
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
        if grows or self._stands(message.time):
            self._learn_growth(grows)
        if grows:
            self._grew = message.time
        if good:
            self._learn(message.age)

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


class Form:
    """The frames that one publisher names, and the lengths of its arrays: what is always the same.

    `usual`: of its predecessor's, and then its own; None: nothing is learned.
    """

    def __init__(self, usual: Optional[Usual]) -> None:
        self._count, self._same, self._usual = 0, dict(usual or {}), usual
        self.unusual = ""

    def samples(self, message: Message) -> Iterator[FormSample]:
        """Yield what a message has otherwise than all of the first good ones."""
        if self._count >= settings.AGES:
            for name, part in message.form:
                if self._same.get(name, part) != part:
                    yield FormSample(name, part, self._same[name])

    def heard(self, message: Message, good: bool) -> None:
        """Learn from a message that has been judged, if it was `good`."""
        if self._usual is None or not good or self._count >= settings.AGES:
            return
        known, self._count = self._same if self._count else dict(message.form), self._count + 1
        self._same = {name: part for name, part in message.form if known.get(name) == part}
        if self._count == settings.AGES:
            for name, part in self._same.items():
                if self._usual.get(name, part) != part:
                    before = f"{self._usual[name]!r} before its node was started again"
                    self.unusual = f"{name} is {part!r}, and was {before}"
            self._usual.update(self._same)


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
