"""Evidence against a publisher: samples of its messages, which the checks of its service judge."""
from collections import deque
from dataclasses import dataclass
from math import ceil
from typing import Any, Deque, Iterable, Iterator, Optional, Tuple, Type

from shsa_core.model.checks import Check, OutOfRange, RateSample, StampSample, ValueSample
from shsa_core.model.kinds import Kind
from shsa_core.model.service import Provision, Service
from shsa_core.monitoring.events import Message

RATE_MESSAGES = 20
RATE_SECONDS = 1.0
"""A rate is taken over so many messages, or over so many seconds' worth if these are more."""


@dataclass(frozen=True)
class Finding:
    """What was found wrong: the kind of failure, and in words what was seen and what is allowed."""

    kind: Kind
    detail: str


def checked_provisions(service: Service) -> Tuple[Provision, ...]:
    """The provisions whose values some check needs; a message is decoded for no others."""
    return tuple(provision for provision in service.provides if _checks_of(provision))


def checks_stamps(service: Service) -> bool:
    """Whether any check needs the stamp in the header."""
    return bool(_of(service.checks.each, StampSample))


def judge(checks: Iterable[Check], sample: Any) -> Optional[Finding]:
    """What the first of the checks finds wrong with a sample."""
    for check in checks:
        detail = check.judge(sample)
        if detail is not None:
            return Finding(check.kind, detail)
    return None


def _of(checks: Iterable[Check], sample: Type[Any]) -> Tuple[Check, ...]:
    return tuple(check for check in checks if check.sample is sample)


def _checks_of(provision: Provision) -> Tuple[Check, ...]:
    unlimited = provision.range is None
    return tuple(c for c in provision.checks if not (unlimited and isinstance(c, OutOfRange)))


class _Value:
    """What is remembered of one value of one publisher."""

    def __init__(self, provision: Provision) -> None:
        self._name, self._range = provision.property, provision.range
        self._checks = _checks_of(provision)
        self._value: Optional[float] = None
        self._good: Optional[float] = None
        self._changed = 0.0

    def look(self, value: float, time: float, failed: bool) -> Optional[Finding]:
        """What is wrong with a new value.

        A failed publisher may start anew elsewhere, but must be steady there.
        """
        before = self._value if failed else self._good
        if value != self._value:
            self._changed = time
        self._value = value
        still = time - self._changed
        finding = judge(self._checks, ValueSample(self._name, value, self._range, still, before))
        if finding is None:
            self._good = value
        return finding


class Evidence:
    """The evidence against one publisher, who provides `service`."""

    def __init__(self, service: Service) -> None:
        checks = service.checks
        self._bad, self._window = checks.bad, (1 << checks.of) - 1
        self._values = [_Value(provision) for provision in checked_provisions(service)]
        self._stamp_checks = _of(checks.each, StampSample)
        self._rate_checks = () if service.period is None else _of(checks.each, RateSample)
        self._period = service.period or 0.0
        count = max(RATE_MESSAGES, ceil(RATE_SECONDS / self._period)) if self._rate_checks else 0
        self._times: Deque[Tuple[float, float]] = deque(maxlen=count + 1)
        self._history = 0

    def clear(self) -> None:
        """Forget what was bad."""
        self._history = 0

    def weigh(self, message: Message, failed: bool) -> Tuple[bool, Optional[Finding]]:
        """Whether a message is good, and the failure that it completes, if any.

        `failed`: there was one already.
        """
        # All of them look, so that each remembers what it saw; the first finding counts.
        finding = next(iter([each for each in self._findings(message, failed) if each]), None)
        self._history = (self._history << 1 | (finding is not None)) & self._window
        guilty = bin(self._history).count("1") >= self._bad
        return finding is None, finding if guilty else None

    def _findings(self, message: Message, failed: bool) -> Iterator[Optional[Finding]]:
        for value, seen in zip(self._values, message.values or ()):
            yield value.look(seen, message.time, failed)
        if message.error:
            yield Finding(Kind.NOT_A_NUMBER, message.error)
        if self._stamp_checks and message.age is not None:
            yield judge(self._stamp_checks, StampSample(message.age, message.waited))
        if self._rate_checks:
            yield self._look_at_rate(message)

    def _look_at_rate(self, message: Message) -> Optional[Finding]:
        """Judge the mean rate, in doubt for the publisher: it came within the last `waited` s."""
        times, earliest = self._times, message.time - message.waited
        times.append((earliest, message.time))
        if len(times) < (times.maxlen or 0):
            return None
        longest, shortest = message.time - times[0][0], earliest - times[0][1]
        sample = RateSample(len(times) - 1, self._period, longest, shortest)
        return judge(self._rate_checks, sample)
