"""Evidence against a publisher: samples of its messages, which the checks of its service judge."""
from collections import deque
from dataclasses import dataclass, replace
from math import ceil, isfinite
from typing import Any, Deque, Dict, Iterable, Iterator, List, Optional, Set, Tuple, Type

from shsa_core.model.checks import LONG_WINDOW, Check, Checks, OutOfRange
from shsa_core.model.samples import FormSample, RateSample, StampSample, Usual, ValueSample
from shsa_core.model.kinds import Kind
from shsa_core.model.service import Provision, Service
from shsa_core.monitoring.events import Message
from shsa_core.monitoring.form import Form
from shsa_core.monitoring.formulas import FormulaRun
from shsa_core.monitoring.settings import COMES_AND_GOES, RATE_MESSAGES, RATE_SECONDS
from shsa_core.monitoring.stamps import StampAges
from shsa_core.monitoring.stillness import Run, Stillness


@dataclass(frozen=True)
class Finding:
    """A kind of failure, and in words what was seen and what is allowed."""

    kind: Kind
    detail: str


Learned = Dict[Tuple[str, str], Stillness]
"""Knowledge of the values of one node, by property and field."""


def checked_provisions(service: Service) -> Tuple[Provision, ...]:
    """Return the provisions whose values are looked at; a message is decoded for no others."""
    named = {name for each in service.checks.formulas for name in each.parsed.names}
    return tuple(
        each
        for each in service.provides
        if each.usual or _checks_of(each) or each.property in named
    )


def checks_header(service: Service) -> bool:
    """Tell if any check needs the header."""
    return any(each.sample in (FormSample, StampSample) for each in service.checks.each)


def judge(checks: Iterable[Check], sample: Any) -> Optional[Finding]:
    """Return what the first of the checks finds wrong with a sample."""
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
    """One value of one publisher, and the checks of it."""

    def __init__(self, provision: Provision, learned: Optional[Learned]) -> None:
        self.name, self.field, self._range = provision.property, provision.field, provision.range
        self._usual, self._back = provision.usual, 0
        self.unusual = ""
        self._checks = _of(_checks_of(provision), ValueSample)
        key = provision.property, provision.field
        self._learns = learned is not None
        self._run = Run(Stillness() if learned is None else learned.setdefault(key, Stillness()))
        self.good: Optional[float] = None
        self._newest: Optional[float] = None
        self.outside: Optional[ValueSample] = None

    def look(self, value: float, time: float, failed: bool) -> Optional[Finding]:
        """Return what is wrong with a new value.

        A failed publisher may start anew elsewhere, but must be steady there.
        """
        if self._usual is not None:
            self._compare_with(self._usual, value)
        before = self._newest if failed else self.good
        self._newest = value
        run = self._run
        run.add(value, time, self._learns and not failed)
        still = time - run.began
        hold = run.allowed
        sample = ValueSample(self.name, value, self._range, still, before, run.length, hold)
        finding = judge(self._checks, sample)
        self.outside = None
        if finding is not None:
            run.spoil()
            self.outside = sample if finding.kind is Kind.OUT_OF_RANGE else None
        else:
            self.good = value if isfinite(value) else None  # after a gap it may be anywhere
        return finding

    def _compare_with(self, usual: Tuple[float, float], value: float) -> None:
        """Note a value that leaves what is usual, until as many as are judged together are back."""
        low, high = usual
        if low <= value <= high:
            self._back += 1
            if self._back >= Checks.of:
                self.unusual = ""
        elif isfinite(value):
            self._back = 0
            if not self.unusual:
                self.unusual = f"{self.name} is {value:g}, {low:g} to {high:g} are usual"


class Verdict:
    """Counts the bad messages among the last ones: noise is no fault, what comes and goes is."""

    def __init__(self, checks: Checks) -> None:
        self._bad, self._seldom, self._least = checks.bad, 2 * checks.bad, checks.recovery
        self._short, self._long = (1 << checks.of) - 1, (1 << LONG_WINDOW * checks.of) - 1
        self._history = self._past = 0
        self.recovery = checks.recovery
        """So many good messages in a row end a failure: more if it came and went before."""

    def add(self, bad: bool) -> bool:
        """Count a message; tell if it was one bad one too many."""
        self._history = (self._history << 1 | bad) & self._long
        self._past = (self._past << 1 | bad) & self._long
        if not bad:
            return False
        recent = bin(self._history & self._short).count("1")
        guilty = recent >= self._bad or bin(self._history).count("1") >= self._seldom
        if guilty:
            gaps = _gaps(self._past)
            comes_and_goes = len(gaps) >= COMES_AND_GOES
            self.recovery = max(self._least, COMES_AND_GOES * max(gaps) if comes_and_goes else 0)
        return guilty

    @property
    def newest_is_bad(self) -> bool:
        """True if the newest message was bad."""
        return bool(self._history & 1)

    def clear(self) -> None:
        """Forget what was bad."""
        self._history = 0


class Evidence:
    """The evidence against one publisher, who provides `service`.

    `properties`: those whose values are judged. `learned`: what is known of its values from before;
    None: nothing is learned, as of a substitute, whose program may change. `form`: of the messages
    of the process before it, and then of its own.
    """

    def __init__(
        self, service: Service, learned: Optional[Learned] = None, form: Optional[Usual] = None
    ) -> None:
        checks = service.checks
        self.verdict = Verdict(checks)
        checked = checked_provisions(service)
        self.properties = tuple(each.property for each in checked)
        self._values = [_Value(provision, learned) for provision in checked]
        judged = () if learned is None or service.period is None else checks.each
        self._form, self._form_checks = Form({} if form is None else form), _of(judged, FormSample)
        self._formulas = [(each, FormulaRun(each.parsed)) for each in checks.formulas]
        self._stamp_checks = _of(checks.each, StampSample)
        self._stamps = StampAges(None if learned is None else service.period)
        self._rate_checks = () if service.period is None else _of(checks.each, RateSample)
        self._period, self._fastest = service.period or 0.0, service.fastest
        count = max(RATE_MESSAGES, ceil(RATE_SECONDS / self._period)) if self._rate_checks else 0
        self._times: Deque[Tuple[float, float, float]] = deque(maxlen=count + 1)
        self._enough = count + 1
        self.rate_was_good = False
        self.written: Optional[Set[str]] = None  # the fields that it knows; None: all

    @property
    def pace(self) -> Optional[float]:
        """The rate of the last messages as a share of the service's; None: not known yet."""
        if not self._rate_checks or len(self._times) < self._enough:
            return None
        passed = self.span
        return (len(self._times) - 1) * self._period / passed if passed > 0.0 else None

    @property
    def outside(self) -> Optional[ValueSample]:
        """A value of the newest message that is out of its range."""
        return next((each.outside for each in self._values if each.outside), None)

    @property
    def unusual(self) -> str:
        """The first of what is not as usual, in words; empty: all is."""
        return next((each.unusual for each in self._values if each.unusual), self._form.unusual)

    @property
    def span(self) -> float:
        """The time in s in which those messages came."""
        return self._times[-1][1] - self._times[0][1] if self._times else 0.0

    @property
    def pause(self) -> float:
        """The longest pause in s between those messages."""
        times = [each[1] for each in self._times]
        return max((b - a for a, b in zip(times, times[1:])), default=0.0)

    def take_habits(self, other: "Evidence") -> None:
        """Go on with what another one learned of stamps and forms on the same connection."""
        self._form = other._form
        if self._stamps.period == other._stamps.period:
            self._stamps = other._stamps

    def take_messages(self, other: "Evidence") -> None:
        """Go on with the messages of the same publisher, judged by other numbers so far."""
        self._times.extend(other._times)
        good = {each.name: each.good for each in other._values}
        for value in self._values:
            value.good = good.get(value.name)

    def violation(self, service: Service) -> Optional[Finding]:
        """Return how what was good so far violates the changed numbers of its service."""
        good = {each.name: each.good for each in self._values if each.good is not None}
        for new in checked_provisions(service):
            if new.property in good:
                sample = ValueSample(new.property, good[new.property], new.range)
                finding = judge(_of(_checks_of(new), ValueSample), sample)
                if finding is not None:
                    return finding
        if service.period is None or len(self._times) < 2:
            return None
        return judge(_of(service.checks.each, RateSample), self._rate(service.period))

    def clock_jumped(self) -> None:
        """Forget what was learned of stamps."""
        self._stamps.forget()

    def weigh(self, message: Message, failed: bool) -> Tuple[bool, Optional[Finding]]:
        """Tell if a message is good, and which failure it completes, if any.

        `failed`: there was one already.
        """
        finding = None
        for found in self.findings(message, failed):  # all look: each remembers what it saw
            finding = finding or found
        good = finding is None and not failed
        self._heard_stamp(message, good)
        if self._form_checks and good:
            self._form.heard(message.form)
        guilty = self.verdict.add(finding is not None)
        return finding is None, finding if guilty else None

    def findings(self, message: Message, failed: bool) -> Iterator[Optional[Finding]]:
        """Yield what each check that is due finds wrong with a message."""
        values: Dict[str, float] = {}
        for value, seen in zip(self._values, message.values or ()):
            if seen is not None and (self.written is None or value.field in self.written):
                values[value.name] = seen
                yield value.look(seen, message.time, failed)
        for check, run in () if message.values is None else self._formulas:
            yield judge([check], run.sample(message.time, message.waited, values))
        if message.error:
            yield Finding(Kind.NOT_A_NUMBER, message.error)
        if self._stamp_checks and message.age is not None:
            sample = StampSample(message.age, message.waited)
            if message.apart is None:
                sample = self._stamps.sample(
                    message.time, message.stamp, message.age, message.waited
                )
            yield judge(self._stamp_checks, sample)
        for form in self._form.samples(message.form):
            yield judge(self._form_checks, form)
        if self._rate_checks:
            yield self._look_at_rate(message)

    def _heard_stamp(self, message: Message, good: bool) -> None:
        """Learn from a stamp.

        Under simulated time some nodes stamp what /clock says, and some what theirs does.
        """
        if message.age is not None and message.apart is None:
            self._stamps.heard(message.time, message.stamp, message.age, good)

    def _look_at_rate(self, message: Message) -> Optional[Finding]:
        """Judge the mean rate, in doubt for the publisher: it came within the last `waited` s."""
        earliest = message.time - message.waited
        self._times.append((earliest, message.time, message.apart or 0.0))
        if len(self._times) < self._enough:
            return None
        rate = replace(self._rate(self._period), fastest=self._fastest)
        apart = self._times[-1][2] - self._times[0][2]
        if not self.rate_was_good:  # beyond doubt: what waited for us came at no rate
            sure = replace(rate, longest=rate.shortest + apart, shortest=rate.longest - apart)
            self.rate_was_good = judge(self._rate_checks, sure) is None
        return judge(self._rate_checks, rate)

    def _rate(self, period: float) -> RateSample:
        first, last = self._times[0], self._times[-1]
        longest = last[1] - first[0] + last[2] - first[2]
        return RateSample(len(self._times) - 1, period, longest, last[0] - first[1])


def _gaps(history: int) -> List[int]:
    """Return the numbers of good messages in a row between bad ones."""
    gaps = bin(history)[2:].rstrip("0").split("1")
    return [len(gap) for gap in gaps if gap]
