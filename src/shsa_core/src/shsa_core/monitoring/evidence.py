"""Evidence against a publisher: what is wrong with its messages, and when that is a failure."""
from collections import deque
from dataclasses import dataclass
from math import ceil, isfinite
from typing import Deque, List, Optional, Tuple

from shsa_core.monitoring.events import Message
from shsa_core.model import checks
from shsa_core.model.checks import Checks
from shsa_core.model.som import Service

RATE_MESSAGES = 20
RATE_SECONDS = 1.0
"""A rate is taken over so many messages, and over so many seconds' worth of them: the larger counts."""


@dataclass(frozen=True)
class Finding:
    """What was found wrong: the kind of failure, and in words what was seen and what is allowed."""

    kind: str
    detail: str


@dataclass(frozen=True)
class TopicChecks:
    """The checks of one topic: those of each of its services, in the order of the SOM."""

    services: Tuple[Service, ...]

    @property
    def common(self) -> Checks:
        """What is not about one field."""
        return self.services[0].checks

    @property
    def period(self) -> float:
        """The period in s; the longest, if the services do not agree."""
        return max(service.period for service in self.services)

    @property
    def deadline(self) -> Optional[float]:
        """Periods without a message that are allowed; None: as usual."""
        return next((s.deadline for s in self.services if s.deadline is not None), None)

    @property
    def of_values(self) -> bool:
        """Whether any check needs the values."""
        return any(
            service.checks.not_a_number
            or (service.range is not None and service.checks.out_of_range)
            or service.checks.stuck is not None
            or service.checks.jump is not None
            for service in self.services
        )

    @property
    def of_stamps(self) -> bool:
        """Whether any check needs the stamp in the header."""
        return self.common.stale_stamp is not None or self.common.future_stamp is not None


class _Field:
    """What is remembered of one field of one publisher."""

    def __init__(self, service: Service) -> None:
        self.service = service
        self.value: Optional[float] = None
        self.good: Optional[float] = None
        self.changed = 0.0

    def look(self, value: float, time: float, failed: bool) -> Optional[Finding]:
        """What is wrong with a new value; a failed publisher may start anew elsewhere, but must be steady there."""
        reference = self.value if failed else self.good
        if value != self.value:
            self.changed = time
        self.value = value
        finding = self._judge(value, time - self.changed, reference)
        if finding is None:
            self.good = value
        return finding

    def _judge(self, value: float, still: float, reference: Optional[float]) -> Optional[Finding]:
        name, limits, tuned = self.service.property, self.service.range, self.service.checks
        if not isfinite(value):
            if not tuned.not_a_number:
                return None
            return Finding(checks.NOT_A_NUMBER, f"{name} is {value}, a finite number is needed")
        if limits is not None and tuned.out_of_range and not limits[0] <= value <= limits[1]:
            allowed = f"{limits[0]:g} to {limits[1]:g} are allowed"
            return Finding(checks.OUT_OF_RANGE, f"{name} is {value:g}, {allowed}")
        if tuned.stuck is not None and still > tuned.stuck:
            seen = f"{name} is {value:g} for {still:.3f} s"
            return Finding(checks.STUCK, f"{seen}, it must change within {tuned.stuck:g} s")
        if tuned.jump is not None and reference is not None:
            if abs(value - reference) > tuned.jump:
                seen = f"{name} went from {reference:g} to {value:g}"
                return Finding(checks.JUMP, f"{seen}, steps of {tuned.jump:g} are allowed")
        return None


class Evidence:
    """The evidence against one publisher."""

    def __init__(self, topic_checks: TopicChecks) -> None:
        self._checks = topic_checks.common
        self._period = topic_checks.period
        self._fields = [_Field(service) for service in topic_checks.services]
        count = max(RATE_MESSAGES, ceil(RATE_SECONDS / self._period))
        self._times: Deque[Tuple[float, float]] = deque(maxlen=count + 1)
        self._history = 0

    def clear(self) -> None:
        """Forget what was bad."""
        self._history = 0

    def weigh(self, message: Message, failed: bool) -> Tuple[bool, Optional[Finding]]:
        """Whether a message is good, and the failure that it completes, if any; `failed`: there was one already."""
        finding = self._look(message, failed)
        window = (1 << self._checks.of) - 1
        self._history = (self._history << 1 | (finding is not None)) & window
        guilty = bin(self._history).count("1") >= self._checks.bad
        return finding is None, finding if guilty else None

    def _look(self, message: Message, failed: bool) -> Optional[Finding]:
        findings: List[Optional[Finding]] = [
            field.look(value, message.time, failed)
            for field, value in zip(self._fields, message.values or ())
        ]
        if message.error:
            findings.append(Finding(checks.NOT_A_NUMBER, message.error))
        findings.append(self._look_at_stamp(message))
        findings.append(self._look_at_rate(message))
        return next((finding for finding in findings if finding is not None), None)

    def _look_at_stamp(self, message: Message) -> Optional[Finding]:
        old, early = self._checks.stale_stamp, self._checks.future_stamp
        if message.age is None:
            return None
        oldness, earliness = message.age - message.waited, -message.age
        if old is not None and oldness > old:
            seen = f"the stamp is {oldness:.3f} s old"
            return Finding(checks.STALE_STAMP, f"{seen}, {old:g} s are allowed")
        if early is not None and earliness > early:
            seen = f"the stamp is {earliness:.3f} s in the future"
            return Finding(checks.FUTURE_STAMP, f"{seen}, {early:g} s are allowed")
        return None

    def _look_at_rate(self, message: Message) -> Optional[Finding]:
        """Judge the mean rate, in doubt for the publisher: a message came between `waited` ago and now."""
        times, earliest = self._times, message.time - message.waited
        times.append((earliest, message.time))
        count = len(times) - 1
        if count + 1 < (times.maxlen or 0):
            return None
        due = 1.0 / self._period
        longest, shortest = message.time - times[0][0], earliest - times[0][1]
        high, low = self._checks.rate_high, self._checks.rate_low
        if high is not None and count > high * due * longest:
            seen = f"{count} messages came in {longest:.3f} s"
            return Finding(checks.RATE_HIGH, f"{seen}, at most {high * due:.1f} Hz are allowed")
        if low is not None and count < low * due * shortest:
            seen = f"{count} messages came in {shortest:.3f} s"
            return Finding(checks.RATE_LOW, f"{seen}, at least {low * due:.1f} Hz are needed")
        return None
