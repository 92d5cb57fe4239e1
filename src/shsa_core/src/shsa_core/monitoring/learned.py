"""Learns how one publisher usually is: how long it is silent, and what its messages are like."""
from bisect import insort
from collections import deque
from math import ceil, inf, log
from statistics import median
from typing import Deque, Dict, Iterator, List, Optional

from shsa_core.backlog import BURST_PERIODS, Backlog
from shsa_core.derivations.settings import REFRESH_S
from shsa_core.model.samples import FormSample, Hold, Part, StampSample
from shsa_core.monitoring import settings
from shsa_core.monitoring.events import Message
from shsa_core.watch import INSTANT_S


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
        self._learned = 0.0  # when it learned last
        self._grew = 0.0  # when a newer stamp came last
        self._growing = 0.0  # so many were newer than the one before, -inf: not always

    def samples(self, message: Message, backlog: Backlog) -> Iterator[StampSample]:
        """Yield what is to be judged of a message; what a silence held up may be as much older."""
        if message.age is None:
            return
        sample = StampSample(message.age, message.waited)
        if message.apart is None and self._usual is not None:
            always = self._growing >= settings.LEARN_MESSAGES
            again = always and not self._grows(message.stamp) and self._stands(message.time)
            allowed = self._allowed + (backlog.owed if backlog.makes_up else 0.0)
            sample = StampSample(message.age, message.waited, self._usual, allowed, again)
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
            self._learn(message.age, message.time)

    def _grows(self, stamp: int) -> bool:
        return self._last is None or stamp > self._last

    def _stands(self, time: float) -> bool:
        return time - self._grew > BURST_PERIODS * (self.period or 0.0)

    def _learn(self, age: float, time: float) -> None:
        drift, self._learned = settings.AGE_FOLLOWS * (time - self._learned), time
        if self._usual is not None and age < self._usual - settings.AGE_LEAST_S / 2:
            self._usual = None  # it was learned of messages that had waited before we came
        if self._usual is not None:
            self._usual += max(-drift, min(drift, age - self._usual))
            return
        self._ages.append(age)
        if len(self._ages) >= settings.AGES:
            self._usual = median(self._ages)
            spreads = sorted(abs(each - self._usual) for each in self._ages)
            self._allowed = max(
                settings.AGE_LEAST_S,
                settings.AGE_PERIODS * (self.period or 0.0),
                settings.AGE_SPREADS * spreads[int(settings.AGE_SHARE * len(spreads)) - 1],
            )
            self._ages.clear()


class Form:
    """Learns frames and lengths of arrays, if it `learns`; an empty frame may become any."""

    def __init__(self, learns: bool) -> None:
        self._left = settings.AGES if learns else inf  # messages until it is known
        self._same: Optional[Dict[str, Part]] = None

    def samples(self, message: Message) -> Iterator[FormSample]:
        """Yield what a message has otherwise than all of the first good ones."""
        for name, part in message.form if self._left <= 0 else ():
            usual = (self._same or {}).get(name, part)
            if usual != part:
                yield FormSample(name, part, usual)

    def heard(self, message: Message, good: bool) -> None:
        """Learn from a message that has been judged, if it was `good`: what varies is not usual."""
        if good and self._left < inf:
            form = dict(message.form)
            before = (form if self._same is None else self._same).items()
            self._same = {n: part for n, part in before if part != "" and form.get(n, part) == part}
            self._left -= 1


class Stillness:
    """The time for which one value stays the same, in messages; it outlives connections.

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
        known = self._count >= settings.LEARN_MESSAGES
        noisy = self._turns >= settings.LEAST_TURNS * (self._count - self._repeats)
        if not (known and noisy) or self._repeats > settings.MOST_REPEATS * self._count:
            return None
        if value == 0.0 and (self._crossings < settings.LEARN_MESSAGES or self._longest_zero > 1):
            return None
        # Whoever reads more than he can tell reads his limit, as long as that lasts.
        factor = 1 if self._low < value < self._high else settings.STILL_FACTOR
        messages = settings.STILL_FACTOR * factor * self._longest
        return Hold(messages, settings.STILL_LEAST_S * factor, self._longest)


class LearnedDeadline:
    """The silence in s that a stream of a `period` in s is allowed, for `false_alarms` an hour.

    `fixed`: what is allowed before enough is known, and ever: a stream that was steady so far may
    be late once; `most`: the most that is. What was learned `before` of a stream of the same period
    goes on to count. Costs the same for every message, but for the few that are among the longest.

    The gaps beyond a high threshold `u` are about exponentially distributed, with the mean of what
    they are longer. With k of them in some hours, the silence that is exceeded so many times an
    hour is u + mean * log(k / (hours * times)) (peaks over a threshold: Coles, An Introduction to
    Statistical Modeling of Extreme Values, 2001, chapter 4). A tail that is heavier is covered by
    SPARE times the longest healthy gap.
    """

    def __init__(
        self,
        period: float,
        false_alarms: float,
        fixed: float,
        most: float,
        before: Optional["LearnedDeadline"] = None,
    ) -> None:
        self.period, self.false_alarms, self._fixed, self._most = period, false_alarms, fixed, most
        self._rate = false_alarms / 3600.0  # 1/s
        share = ceil(settings.LEARN_SHARE / (self._rate * period))
        self.needed = max(settings.LEARN_GAPS, share)
        self._every = max(1, round(REFRESH_S / period))
        self._blocks: Deque[_Block] = deque([_Block()], settings.BLOCKS)
        if before is not None and before.period == period:
            self._blocks = before._blocks
        self.allowed = fixed
        self._look()

    @property
    def gaps(self) -> int:
        """The number of gaps that it stands on."""
        return sum(block.count for block in self._blocks)

    @property
    def is_learned(self) -> bool:
        """True once enough is known."""
        return self.gaps >= self.needed

    def is_long(self, gap: float) -> bool:
        """Tell if a gap would be one of those that are kept."""
        return gap > self._blocks[-1].threshold

    def add(self, gap: float) -> bool:
        """Add a gap of the healthy stream, in s; tell if another silence is allowed now."""
        self._blocks[-1].add(gap)
        count = self.gaps
        due = count % self._every == 0 or count == self.needed
        return (due or gap * settings.SPARE > self.allowed) and self._look()

    def told(self) -> str:
        """Return in words on what it stands."""
        if not self.is_learned:
            return f"the fixed deadline until {self.needed} gaps are known, {self.gaps} are so far"
        return f"learned from {self.gaps} gaps, {self.false_alarms:g} false alarms an hour"

    def _look(self) -> bool:
        before, newest = self.allowed, self._blocks[-1]
        enough = self.needed / (settings.BLOCKS - 1)
        if newest.seconds >= settings.BLOCK_S and newest.count >= enough:
            self._blocks.append(_Block())
        wanted = self._wanted() if self.is_learned else 0.0
        self.allowed = min(max(wanted, self._fixed), self._most)
        return self.allowed != before

    def _wanted(self) -> float:
        beyond = max(block.threshold for block in self._blocks)
        tail = sorted(gap for block in self._blocks for gap in block.longest if gap >= beyond)
        tail = tail[-(self.gaps // settings.TAIL) :]
        seconds = max(INSTANT_S, sum(block.seconds for block in self._blocks))
        times = max(1.0, len(tail) / (seconds * self._rate))
        excess = sum(tail) / len(tail) - tail[0]
        return max(tail[0] + excess * log(times), settings.SPARE * tail[-1])


class _Block:
    """The gaps of one stretch of the stream; `longest` in order."""

    def __init__(self) -> None:
        self.longest: List[float] = []
        self.count, self.seconds = 0, 0.0
        self.threshold = -inf  # all that is above is kept

    def add(self, gap: float) -> None:
        self.count += 1
        self.seconds += gap
        if gap <= self.threshold:
            return
        insort(self.longest, gap)
        if len(self.longest) > settings.TAIL_KEPT:
            del self.longest[0]
            self.threshold = self.longest[0]
