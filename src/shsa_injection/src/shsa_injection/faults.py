"""Faults of messages: each makes a faulty stream of a sound one; the same seed, the same stream."""
import math
from dataclasses import dataclass, replace
from random import Random
from typing import Dict, List, Optional, Tuple, Type

Value = Optional[float]
Range = Optional[Tuple[float, float]]

USUAL_PERIOD_S = 0.1  # of an event-driven topic, where a fault has to spread messages
LARGEST_EXPONENT = 12  # garbage is finite in a float32 as well
SHARES = (1.0, 0.5, 0.1)


@dataclass(frozen=True)
class Reading:
    """One message: the values that the SOM names, None where it has none, and its stamp.

    `stamp` in s, None: its type has no header; `frame`: in that; `share`: of the elements of its
    arrays, that are left.
    """

    values: Tuple[Value, ...]
    stamp: Optional[float] = None
    frame: Optional[str] = None
    share: float = 1.0


@dataclass(frozen=True)
class Stream:
    """A sound stream: its period in s, None: event-driven; the ranges of its values."""

    period: Optional[float]
    ranges: Tuple[Range, ...]


Timed = Tuple[float, Reading]


class Fault:
    """A fault of a stream. `detail`: what was drawn for it, in words.

    `feed(time, reading)` tells what is published instead of a message, and when; times in s of the
    monotonic clock, never before that of the message.
    """

    detail = ""

    def __init__(self, random: Random, stream: Stream) -> None:
        self._random = random
        self._stream = stream
        self._period = stream.period or USUAL_PERIOD_S

    def feed(self, time: float, reading: Reading) -> List[Timed]:
        """Return what comes instead of one message."""
        raise NotImplementedError


class Stuck(Fault):
    """The values of the first message, for good; stamps go on."""

    _values: Optional[Tuple[Value, ...]] = None

    def feed(self, time: float, reading: Reading) -> List[Timed]:
        if self._values is None:
            self._values = reading.values
        return [(time, replace(reading, values=self._values))]


class Garbage(Fault):
    """Random numbers of any size."""

    def feed(self, time: float, reading: Reading) -> List[Timed]:
        values = tuple(None if value is None else self._number() for value in reading.values)
        return [(time, replace(reading, values=values))]

    def _number(self) -> float:
        mantissa = self._random.uniform(-1.0, 1.0)
        return mantissa * 10.0 ** self._random.uniform(-3.0, LARGEST_EXPONENT)


class Wrong(Fault):
    """Every value is off by the same share of its range, and stays within that."""

    def __init__(self, random: Random, stream: Stream) -> None:
        super().__init__(random, stream)
        self._share = random.choice((-1.0, 1.0)) * random.uniform(0.1, 0.4)
        self.detail = f"off by {self._share:+.0%} of the range"

    def feed(self, time: float, reading: Reading) -> List[Timed]:
        pairs = zip(reading.values, self._stream.ranges)
        values = tuple(
            None if value is None else self._off(value, limits) for value, limits in pairs
        )
        return [(time, replace(reading, values=values))]

    def _off(self, value: float, limits: Range) -> float:
        low, high = limits if limits is not None else (-math.inf, math.inf)
        if not math.isfinite(high - low):
            return value + self._share * max(1.0, abs(value))
        off = value + self._share * (high - low)
        if not low <= off <= high:  # the other way then: it must not show by the range
            off = value - self._share * (high - low)
        return min(max(off, low), high)


class Slow(Fault):
    """One message in some."""

    def __init__(self, random: Random, stream: Stream) -> None:
        super().__init__(random, stream)
        self._every = random.randint(2, 4)
        self._count = -1
        self.detail = f"one message in {self._every}"

    def feed(self, time: float, reading: Reading) -> List[Timed]:
        self._count += 1
        return [] if self._count % self._every else [(time, reading)]


class Delayed(Fault):
    """Each message comes late, with the stamp that it had."""

    def __init__(self, random: Random, stream: Stream) -> None:
        super().__init__(random, stream)
        self._delay = random.uniform(0.5, 2.0)
        self.detail = f"{self._delay:.2f} s late"

    def feed(self, time: float, reading: Reading) -> List[Timed]:
        return [(time + self._delay, reading)]


class Intermittent(Fault):
    """Messages are missing for a while, then come for a while; it begins with silence."""

    def __init__(self, random: Random, stream: Stream) -> None:
        super().__init__(random, stream)
        self._there = True
        self._until = -math.inf

    def feed(self, time: float, reading: Reading) -> List[Timed]:
        while time >= self._until:
            self._there = not self._there
            self._until = max(self._until, time) + self._random.uniform(0.1, 1.0)
        return [(time, reading)] if self._there else []


class Fast(Fault):
    """Several messages instead of one, spread over the period, each with a stamp of its own."""

    def __init__(self, random: Random, stream: Stream) -> None:
        super().__init__(random, stream)
        self._times = random.randint(2, 5)
        self.detail = f"{self._times} times the rate"

    def feed(self, time: float, reading: Reading) -> List[Timed]:
        ahead = [number * self._period / self._times for number in range(self._times)]
        return [(time + each, _later(reading, each)) for each in ahead]


class NotANumber(Fault):
    """NaN instead of the values, in a share of the messages; in the first one for certain."""

    _first = True

    def __init__(self, random: Random, stream: Stream) -> None:
        super().__init__(random, stream)
        self._share = random.choice(SHARES)
        self.detail = f"in {self._share:.0%} of the messages"

    def feed(self, time: float, reading: Reading) -> List[Timed]:
        hit = self._random.random() < self._share or self._first
        self._first = False
        if not hit:
            return [(time, reading)]
        values = tuple(None if value is None else self._bad() for value in reading.values)
        return [(time, replace(reading, values=values))]

    def _bad(self) -> float:
        return math.nan


class Infinite(NotANumber):
    """Infinity, of either sign, instead of the values."""

    def _bad(self) -> float:
        return self._random.choice((-math.inf, math.inf))


class OldStamp(Fault):
    """Stamps that are too old."""

    _sign = -1.0

    def __init__(self, random: Random, stream: Stream) -> None:
        super().__init__(random, stream)
        self._shift = self._sign * random.uniform(1.0, 10.0)
        self.detail = f"stamps {self._shift:+.1f} s"

    def feed(self, time: float, reading: Reading) -> List[Timed]:
        return [(time, _later(reading, self._shift))]


class FutureStamp(OldStamp):
    """Stamps that lie ahead."""

    _sign = 1.0


class WrongFrame(Fault):
    """Another frame, or none."""

    def __init__(self, random: Random, stream: Stream) -> None:
        super().__init__(random, stream)
        self._frame = random.choice(("", f"wrong_{random.randrange(100)}"))
        self.detail = f"the frame {self._frame!r}"

    def feed(self, time: float, reading: Reading) -> List[Timed]:
        frame = None if reading.frame is None else self._frame
        return [(time, replace(reading, frame=frame))]


class ShortArray(Fault):
    """Arrays that lack elements at their ends."""

    def __init__(self, random: Random, stream: Stream) -> None:
        super().__init__(random, stream)
        self._share = random.choice((0.0, 0.5))
        self.detail = f"{self._share:.0%} of the elements are left"

    def feed(self, time: float, reading: Reading) -> List[Timed]:
        return [(time, replace(reading, share=self._share))]


class Duplicate(Fault):
    """Each message several times, at once."""

    def __init__(self, random: Random, stream: Stream) -> None:
        super().__init__(random, stream)
        self._times = random.randint(2, 4)
        self.detail = f"each message {self._times} times"

    def feed(self, time: float, reading: Reading) -> List[Timed]:
        return [(time, reading)] * self._times


MESSAGE_FAULTS: Dict[str, Type[Fault]] = {
    "stuck": Stuck,
    "garbage": Garbage,
    "wrong": Wrong,
    "slow": Slow,
    "delayed": Delayed,
    "intermittent": Intermittent,
    "fast": Fast,
    "nan": NotANumber,
    "inf": Infinite,
    "old_stamp": OldStamp,
    "future_stamp": FutureStamp,
    "wrong_frame": WrongFrame,
    "short_array": ShortArray,
    "duplicate": Duplicate,
}
"""The class of each fault that is made of messages."""


def message_fault(word: str, seed: int, stream: Stream) -> Fault:
    """Return the fault of a word; the same seed, the same fault."""
    return MESSAGE_FAULTS[word](Random(f"{word} {seed}"), stream)


def _later(reading: Reading, seconds: float) -> Reading:
    if reading.stamp is None or not seconds:
        return reading
    return replace(reading, stamp=max(0.0, reading.stamp + seconds))
