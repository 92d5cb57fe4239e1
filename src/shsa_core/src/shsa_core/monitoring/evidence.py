"""Evidence against a publisher: samples of its messages, which the checks of its service judge."""
from collections import deque
from dataclasses import replace
from math import ceil, inf, isfinite
from typing import Deque, Dict, Iterator, List, Mapping, Optional, Set, Tuple

from shsa_core.backlog import Backlog
from shsa_core.codegen.program import Step, compile_program
from shsa_core.language.expression import Expression
from shsa_core.language.temporal import Truth
from shsa_core.model.checks import LONG_WINDOW, Check, Checks, Finding, Formula, OutOfRange, judge
from shsa_core.model.kinds import Kind
from shsa_core.model.field import is_angle
from shsa_core.model.samples import FormSample, FormulaSample, RateSample, StampSample, ValueSample
from shsa_core.model.service import Provision, Service
from shsa_core.monitoring.events import Message
from shsa_core.monitoring.learned import Form, StampAges, Stillness
from shsa_core.monitoring.settings import COMES_AND_GOES, FULL_PACE, RATE_MESSAGES, RATE_SECONDS


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


def _checks_of(provision: Provision) -> Tuple[Check, ...]:
    unlimited = provision.range is None
    checks = (check for check in provision.checks if check.sample is ValueSample)
    return tuple(check for check in checks if not (unlimited and isinstance(check, OutOfRange)))


class _Value:
    """One value of one publisher, how often the newest one came in a row, and the checks of it."""

    def __init__(self, provision: Provision, learned: Optional[Learned]) -> None:
        self.name, self.field, self._range = provision.property, provision.field, provision.range
        self._usual, self._back = provision.usual or (-inf, inf), 0
        self.unusual = ""
        self._angle, self._checks = is_angle(provision.field), _checks_of(provision)
        key = provision.property, provision.field
        self._stillness = None if learned is None else learned.setdefault(key, Stillness())
        self.good: Optional[float] = None
        self.outside: Optional[ValueSample] = None
        self._newest: Optional[float] = None
        self._run, self._began, self._step = 0, 0.0, 0.0
        self._teaches = False

    def look(self, value: float, time: float, failed: bool) -> Optional[Finding]:
        """Return what is wrong with a new value; a `failed` publisher may start anew elsewhere."""
        self._compare_with_usual(value)
        before = self._newest if failed else self.good
        self._count(value, time, not failed)
        hold = None if self._stillness is None else self._stillness.allowed(value)
        still = time - self._began
        seen = self.name, value, self._range, still, before, self._run
        sample = ValueSample(*seen, hold, self._angle)
        finding = judge(self._checks, sample)
        self.outside = sample if finding and finding.kind is Kind.OUT_OF_RANGE else None
        usual = hold is None or self._run <= hold.messages  # the time alone may let it off
        self._teaches = self._teaches and usual and finding is None
        if finding is None:
            self.good = value if isfinite(value) else None  # after a gap it may be anywhere
        return finding

    def _count(self, value: float, time: float, healthy: bool) -> None:
        """Count how often it came in a row; a run that ends teaches, if all of it was good."""
        before, self._newest = self._newest, value
        self._teaches = self._teaches and healthy
        if value == before:
            self._run += 1
            return
        step = 0.0
        if before is not None and isfinite(value - before):
            step = value - before
            if self._teaches and self._stillness is not None:
                self._stillness.learn(before, self._run, step, self._step)
        self._run, self._began, self._step, self._teaches = 1, time, step, healthy

    def _compare_with_usual(self, value: float) -> None:
        """Note a value that leaves what is usual, until as many as are judged together are back."""
        low, high = self._usual
        if low <= value <= high:
            self._back += 1
            if self._back >= Checks.of:
                self.unusual = ""
        elif isfinite(value):
            self._back = 0
            if not self.unusual:
                self.unusual = f"{self.name} is {value:g}, {low:g} to {high:g} are usual"


class _Rate:
    """The times in s at which the last messages came, where the rate of a service is judged."""

    def __init__(self, service: Service) -> None:
        self._period, self._fastest = service.period or 0.0, service.fastest
        judged = any(check.sample is RateSample for check in service.checks.each)
        self._judged = judged and service.period is not None
        self.was_full = -inf  # when it was as it should be last
        count = max(RATE_MESSAGES, ceil(RATE_SECONDS / self._period)) if self._judged else 0
        self.times: Deque[Tuple[float, float, float]] = deque(maxlen=count + 1)

    @property
    def is_known(self) -> bool:
        """True once enough have come."""
        return self._judged and len(self.times) == self.times.maxlen

    @property
    def span(self) -> float:
        """The time in which those messages came."""
        return self.times[-1][1] - self.times[0][1] if self.times else 0.0

    @property
    def pause(self) -> float:
        """The longest pause between those messages."""
        times = [each[1] for each in self.times]
        return max((b - a for a, b in zip(times, times[1:])), default=0.0)

    def is_below(self, pace: float) -> bool:
        """Tell if the rate is below so much of what it should be."""
        return self.is_known and (len(self.times) - 1) * self._period < pace * self.span

    def samples(self, message: Message, backlog: Backlog) -> Iterator[RateSample]:
        """Yield the mean rate, in doubt for the publisher: it waited for us, or in a silence."""
        came, due = message.time - message.waited, message.time - backlog.owed
        made_up = min(came, due) if backlog.makes_up else came
        self.times.append((made_up, message.time, message.apart or 0.0))
        if not self.is_below(FULL_PACE):
            self.was_full = message.time
        if self.is_known:
            yield self.sample(self._period, self._fastest)

    def beyond_doubt(self, rate: RateSample) -> RateSample:
        """Return a rate in doubt against the publisher: what waited for us came at no rate."""
        apart = self.times[-1][2] - self.times[0][2]
        return replace(rate, longest=rate.shortest + apart, shortest=rate.longest - apart)

    def sample(self, period: float, fastest: Optional[float] = None) -> RateSample:
        """Return the rate, to be judged by a period."""
        first, last = self.times[0], self.times[-1]
        longest = last[1] - first[0] + last[2] - first[2]
        return RateSample(len(self.times) - 1, period, longest, last[0] - first[1], fastest)


class _FormulaRun:
    """A formula and what it remembers of the messages so far."""

    def __init__(self, check: Formula) -> None:
        self._check, self._decide = check, check.parsed.root.judge()
        self._steps = [(each.names, _step(each)) for each in check.parsed.conditions]

    def look(self, message: Message, values: Mapping[str, float]) -> Optional[Finding]:
        """Return what is wrong; a condition whose values are not there is unknown."""
        now = message.time
        truths: List[Truth] = []
        for names, step in self._steps:
            there = all(name in values for name in names)
            result = step([values[name] for name in names], now) if there else None
            truths.append(None if result is None else result[0] == 1.0)
        seen = tuple((n, values[n]) for n in self._check.parsed.names if n in values)
        holds = self._decide((now, now - message.waited), truths)
        return judge([self._check], FormulaSample(holds, seen))


def _step(condition: Expression) -> Step:
    count = len(condition.names)
    inputs, given = [f"t{n}" for n in range(count)], [f"i{n + 1}" for n in range(count)]
    lines = [
        *(f"t{n}=x[{n}]" for n in range(count)),
        f"def _tf1({','.join(given)}):",
        f"  return {condition.code(dict(zip(condition.names, given)))}",
        f"t{count}=_tf1({','.join(inputs)})",
        f"y=t{count}",
    ]
    return compile_program("\n".join(lines), count, 1).step


class Verdict:
    """Counts the bad messages among the last ones: noise is no fault, what comes and goes is."""

    def __init__(self, checks: Checks) -> None:
        self._bad, self._seldom, self._least = checks.bad, 2 * checks.bad, checks.recovery
        self._short, self._long = (1 << checks.of) - 1, (1 << LONG_WINDOW * checks.of) - 1
        self._history = self._past = self._good_in_a_row = 0
        self._recovery = checks.recovery  # so many good ones: more if it came and went before

    def add(self, finding: Optional[Finding]) -> Optional[Finding]:
        """Count a message; return what is wrong with it if it was one bad one too many."""
        bad = finding is not None
        self._history = (self._history << 1 | bad) & self._long
        self._past = (self._past << 1 | bad) & self._long
        if not bad:
            return None
        recent = bin(self._history & self._short).count("1")
        guilty = recent >= self._bad or bin(self._history).count("1") >= self._seldom
        if guilty:
            # Good messages in a row between bad ones.
            gaps = [len(gap) for gap in bin(self._past)[2:].rstrip("0").split("1") if gap]
            comes_and_goes = len(gaps) >= COMES_AND_GOES
            self._recovery = max(self._least, COMES_AND_GOES * max(gaps) if comes_and_goes else 0)
        return finding if guilty else None

    def recovers(self, good: bool, steady: bool = True) -> bool:
        """Count good, `steady` messages in a row; tell if the failure is over, and forget it."""
        before = self._good_in_a_row if steady else 0
        self._good_in_a_row = before + 1 if good else 0
        if self._good_in_a_row < self._recovery:
            return False
        self._good_in_a_row = self._history = 0
        return True


class Evidence:
    """The evidence against one publisher, who provides `service`.

    `properties`: those whose values are judged. `learned`: what is known of its values from before;
    None: nothing is learned, as of a substitute, whose program may change.
    """

    def __init__(self, service: Service, learned: Optional[Learned] = None) -> None:
        self.service, checked = service, checked_provisions(service)
        self.properties = tuple(each.property for each in checked)
        self.written: Optional[Set[str]] = None  # the fields that it knows; None: all
        self.verdict, self.backlog = Verdict(service.checks), Backlog()
        self.rate, self.rate_was_good = _Rate(service), False
        self.newest_is_bad = False  # be it excused
        self.was_clean = -inf  # when a message came last with which nothing was wrong
        self._checks = service.checks.each
        self._values = [_Value(provision, learned) for provision in checked]
        self._formulas = [_FormulaRun(each) for each in service.checks.formulas]
        learns = learned is not None and service.period is not None
        self.stamps = StampAges(service.period if learns else None)
        self._form = Form(learns and any(each.sample is FormSample for each in self._checks))

    @property
    def outside(self) -> Optional[ValueSample]:
        """A value of the newest message that is out of its range."""
        return next((each.outside for each in self._values if each.outside), None)

    @property
    def unusual(self) -> str:
        """The first of what is not as usual, in words; empty: all is."""
        return next((each.unusual for each in self._values if each.unusual), "")

    def take_habits(self, other: "Evidence") -> None:
        """Go on with what another one learned of stamps, forms and the rate of the same node."""
        self._form, self.backlog = other._form, other.backlog
        if self.stamps.period == other.stamps.period:
            self.stamps, self.rate_was_good = other.stamps, other.rate_was_good

    def take_messages(self, other: "Evidence") -> None:
        """Go on with the messages of the same publisher, judged by other numbers so far."""
        self.rate.times.extend(other.rate.times)
        good = {each.name: each.good for each in other._values}
        for value in self._values:
            value.good = good.get(value.name)

    def violation(self, service: Service) -> Optional[Finding]:
        """Return how what was good so far violates the changed numbers of its service."""
        good = {each.name: each.good for each in self._values if each.good is not None}
        judged = [new for new in checked_provisions(service) if new.property in good]
        samples = (ValueSample(new.property, good[new.property], new.range) for new in judged)
        found = [judge(_checks_of(new), sample) for new, sample in zip(judged, samples)]
        if service.period is not None and len(self.rate.times) > 1:
            found.append(judge(service.checks.each, self.rate.sample(service.period)))
        return next(filter(None, found), None)

    def look(self, message: Message, failed: bool) -> Optional[Finding]:
        """Return what is wrong with a message, None: nothing is; `failed`: after a failure."""
        found = [*self.findings(message, failed)]  # all look: each remembers what it saw
        finding = next(filter(None, found), None)
        self.newest_is_bad = finding is not None
        self.was_clean = message.time if finding is None else self.was_clean
        good = finding is None and not failed
        self.stamps.heard(message, good)
        self._form.heard(message, good)
        return finding

    def findings(self, message: Message, failed: bool) -> Iterator[Optional[Finding]]:
        """Yield what each check that is due finds wrong with a message."""
        values: Dict[str, float] = {}
        for value, seen in zip(self._values, message.values or ()):
            if seen is not None and (self.written is None or value.field in self.written):
                values[value.name] = seen
                yield value.look(seen, message.time, failed)
        for formula in () if message.values is None else self._formulas:
            yield formula.look(message, values)
        if message.error:
            yield Finding(Kind.NOT_A_NUMBER, message.error)
        for sample in (*self.stamps.samples(message, self.backlog), *self._form.samples(message)):
            yield judge(self._checks, sample)
        for rate in self.rate.samples(message, self.backlog):
            if not self.rate_was_good:
                sure = self.rate.beyond_doubt(rate)
                self.rate_was_good = judge(self._checks, sure) is None
            yield judge(self._checks, rate)
