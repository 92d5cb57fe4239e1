"""The checks that a service's messages must pass: one class a kind of failure.

A new kind is one more class here, a constant in shsa_msgs/Failure and a word in `kinds`; a test
holds the three together.
"""
from dataclasses import dataclass
from math import inf, isfinite
from types import MappingProxyType
from typing import Any, ClassVar, Dict, Iterable, Mapping, Optional, Tuple, Type, Union

from shsa_core.language import temporal
from shsa_core.model import samples
from shsa_core.model.field import difference
from shsa_core.model.kinds import Kind

Limit = Union[bool, float]
LEARNED = 0.0
"""The limit that a publisher's own healthy stream, or known errors, give; a SOM's are above 0."""


@dataclass(frozen=True)
class Check:
    """A kind of failure that messages show, with its limit.

    `sample` is what it judges. `default` holds where the SOM says nothing, None: off; `usual` is
    what `true` means, None: a limit must be given. A check without a limit has `usual` True.
    `tells` is its row in the documentation.
    """

    kind: ClassVar[Kind]
    sample: ClassVar[Type[Any]]
    default: ClassVar[Optional[Limit]]
    usual: ClassVar[Optional[Limit]]
    tells: ClassVar[str]

    limit: Limit

    def judge(self, sample: Any) -> Optional[str]:
        """Return the observation and the limit, in words, if `sample` is bad."""
        raise NotImplementedError


@dataclass(frozen=True)
class Finding:
    """A kind of failure, and in words what was seen and what is allowed."""

    kind: Kind
    detail: str


def judge(checks: Iterable[Check], sample: Any) -> Optional[Finding]:
    """Return what the first of the checks that judge such a sample finds wrong with it."""
    for check in checks:
        detail = check.judge(sample) if check.sample is type(sample) else None
        if detail is not None:
            return Finding(check.kind, detail)
    return None


class NotANumber(Check):
    kind, sample, default, usual = Kind.NOT_A_NUMBER, samples.ValueSample, True, True
    tells = "the value is NaN or infinite; off by default for distances, see [Fields](#fields)"

    def judge(self, sample: samples.ValueSample) -> Optional[str]:
        if isfinite(sample.value):
            return None
        return f"{sample.name} is {sample.value}, a finite number is needed"


class OutOfRange(Check):
    kind, sample, default, usual = Kind.OUT_OF_RANGE, samples.ValueSample, True, True
    tells = "the value is outside `range`"

    def judge(self, sample: samples.ValueSample) -> Optional[str]:
        if sample.range is None or not isfinite(sample.value):
            return None
        low, high = sample.range
        if low <= sample.value <= high:
            return None
        return f"{sample.name} is {sample.value:g}, {low:g} to {high:g} are allowed"


class Stuck(Check):
    kind, sample, default, usual = Kind.STUCK, samples.ValueSample, LEARNED, LEARNED
    tells = "the value has not changed for this long, s; off for distances, and at `range`'s limits"

    def judge(self, sample: samples.ValueSample) -> Optional[str]:
        if not isfinite(sample.value):
            return None
        seen = f"{sample.name} is {sample.value:g} for {sample.still:.3f} s"
        if self.limit == LEARNED:
            hold = None if sample.value in (sample.range or ()) else sample.hold  # it saturates
            if hold is None or sample.run <= hold.messages or sample.still <= hold.seconds:
                return None
            usual = f"it was never the same in more than {hold.longest} before"
            return f"{seen}, in {sample.run} messages; {usual}"
        if sample.still <= self.limit:
            return None
        return f"{seen}, it must change within {self.limit:g} s"


class Jump(Check):
    kind, sample, default, usual = Kind.JUMP, samples.ValueSample, None, None
    tells = "the value is further than this from the last good one, in the property's unit"

    def judge(self, sample: samples.ValueSample) -> Optional[str]:
        before = sample.last_good
        step = 0.0 if before is None else difference(sample.value, before, sample.angle)
        if before is None or not self.limit < abs(step) < inf:
            return None
        seen = f"{sample.name} went from {before:g} to {sample.value:g}"
        return f"{seen}, steps of {self.limit:g} are allowed"


class Witness(Check):
    kind, sample, default, usual = Kind.WITNESS, samples.WitnessSample, None, LEARNED
    tells = (
        "the value is further than this from what other nodes tell of it, or than errors explain"
    )

    def judge(self, sample: samples.WitnessSample) -> Optional[str]:
        limit = sample.allowed if self.limit == LEARNED else self.limit
        if limit is None or sample.mean <= limit:
            return None
        seen = f"{sample.name} is {sample.value:g}, by {sample.nodes} it is"
        return f"{seen} {sample.derived:g}; they differ by {sample.mean:g}, {limit:g} are allowed"


class RateHigh(Check):
    kind, sample, default, usual = Kind.RATE_HIGH, samples.RateSample, 1.5, 1.5
    tells = "messages come at more than this times the rate that `period` gives"

    def judge(self, sample: samples.RateSample) -> Optional[str]:
        allowed = self.limit / (sample.fastest or sample.period)
        if sample.count <= allowed * sample.longest:
            return None
        seen = f"{sample.count} messages came in {sample.longest:.3f} s"
        return f"{seen}, at most {allowed:.1f} Hz are allowed"


class RateLow(Check):
    kind, sample, default, usual = Kind.RATE_LOW, samples.RateSample, 0.6, 0.6
    tells = "messages come at less than this times the rate that `period` gives"

    def judge(self, sample: samples.RateSample) -> Optional[str]:
        needed = self.limit / sample.period
        if sample.count >= needed * sample.shortest:
            return None
        seen = f"{sample.count} messages came in {sample.shortest:.3f} s"
        return f"{seen}, at least {needed:.1f} Hz are needed"


class StaleStamp(Check):
    kind, sample, default, usual = Kind.STALE_STAMP, samples.StampSample, LEARNED, LEARNED
    tells = "the stamp is older than this at arrival, s; a stamp of zero is not judged"

    def judge(self, sample: samples.StampSample) -> Optional[str]:
        oldness = sample.age - sample.waited
        if self.limit != LEARNED:
            if oldness <= self.limit:
                return None
            return f"the stamp is {oldness:.3f} s old, {self.limit:g} s are allowed"
        if sample.usual is None:
            return None
        if oldness > sample.usual + sample.allowed:
            return _unusual(oldness, sample)
        return "the stamp is not newer than the one before" if sample.again else None


class FutureStamp(Check):
    kind, sample, default, usual = Kind.FUTURE_STAMP, samples.StampSample, LEARNED, LEARNED
    tells = "the stamp is newer than this at arrival, s"

    def judge(self, sample: samples.StampSample) -> Optional[str]:
        if self.limit != LEARNED:
            if -sample.age <= self.limit:
                return None
            return f"the stamp is {-sample.age:.3f} s in the future, {self.limit:g} s are allowed"
        # What is newer than usual has waited less, as long as it is not newer than now.
        if sample.usual is None or sample.age >= min(0.0, sample.usual) - sample.allowed:
            return None
        return _unusual(sample.age, sample)


def _unusual(age: float, sample: samples.StampSample) -> str:
    usual = f"{sample.usual:.3f} s are usual, {sample.allowed:g} s more or less allowed"
    return f"the stamp is {age:.3f} s old, {usual}"


class Frame(Check):
    kind, sample, default, usual = Kind.FRAME, samples.FormSample, True, True
    tells = "`frame_id` or `child_frame_id` is not that which all of the first 50 messages had"

    def judge(self, sample: samples.FormSample) -> Optional[str]:
        if isinstance(sample.found, int) or sample.found == sample.usual:
            return None
        return f"{sample.name} is {sample.found!r}, and was {sample.usual!r}"


class Length(Check):
    kind, sample, default, usual = Kind.LENGTH, samples.FormSample, True, True
    tells = "an array of numbers or names is shorter than in all of the first 50 messages"

    def judge(self, sample: samples.FormSample) -> Optional[str]:
        found, usual = sample.found, sample.usual
        if isinstance(found, str) or isinstance(usual, str) or found >= usual:
            return None
        return f"{sample.name} has {found} elements, and had {usual}"


@dataclass(frozen=True)
class Formula(Check):
    """Its limit is the text of a formula, see `language/temporal`."""

    kind, sample, default, usual = Kind.FORMULA, samples.FormulaSample, None, None
    tells = "the formula over its values is false, see [Formulas](#formulas)"

    limit: str  # type: ignore[assignment]

    @property
    def parsed(self) -> temporal.Formula:
        """The formula."""
        return temporal.parse_formula(self.limit)

    def judge(self, sample: samples.FormulaSample) -> Optional[str]:
        if sample.holds is not False:
            return None
        seen = ", ".join(f"{name} is {value:g}" for name, value in sample.values)
        return f"{self.limit} does not hold: {seen}"


class UnknownPublisher(Check):
    kind, sample, default, usual = Kind.UNKNOWN_PUBLISHER, samples.IntruderSample, 1.0, 1.0
    tells = "another publisher is beside `node` or its substitute for this long, s"

    def judge(self, sample: samples.IntruderSample) -> Optional[str]:
        if sample.lasted <= self.limit:
            return None
        seen = f"it publishes beside {', '.join(sample.rightful)} for {self.limit:g} s"
        return f"{seen}, neither the SOM nor a substitution names it"


REGISTRY: Dict[str, Type[Check]] = {each.kind.value: each for each in Check.__subclasses__()}
"""Every check by its name, in the order above: the key under `checks` in the SOM.

The first that finds something tells its kind.
"""

_SINGLE = (*samples.OF_VALUE, samples.StampSample, samples.FormSample, samples.FormulaSample)
BY_VALUE = tuple(each.kind for each in REGISTRY.values() if each.sample in _SINGLE)
"""The failures that single messages show: by what they say, not by when they come."""


def default_checks(
    of_values: bool,
    is_distance: bool = False,
    asked: Mapping[str, Optional[Limit]] = MappingProxyType({}),
) -> Tuple[Check, ...]:
    """Return the checks of a value, or of a message, by default and as `asked`; None: off."""
    limits = [
        (each, asked.get(name, default_limit(name, is_distance)))
        for name, each in REGISTRY.items()
        if (each.sample in samples.OF_VALUE) is of_values
    ]
    return tuple(each(limit) for each, limit in limits if limit is not None)


def default_limit(kind: str, is_distance: bool = False) -> Optional[Limit]:
    """Return the limit of a check where the SOM says nothing; None: it is off."""
    if is_distance and kind in (Kind.NOT_A_NUMBER, Kind.STUCK):
        return None  # nothing in reach reads the same for as long as that lasts
    return REGISTRY[str(kind)].default


LONG_WINDOW = 10


@dataclass(frozen=True)
class Checks:
    """The checks of a service's messages as a whole; those of one value stand with its property.

    `bad` bad messages among the last `of` make a failure: noise does not, a fault that comes and
    goes does. So do twice as many among LONG_WINDOW times as many. `recovery` good ones in a row
    end it.
    """

    each: Tuple[Check, ...] = default_checks(of_values=False)
    bad: int = 3
    of: int = 10

    recovery: ClassVar[int] = 5

    @property
    def formulas(self) -> Tuple[Formula, ...]:
        """The formula, if there is one."""
        return tuple(check for check in self.each if isinstance(check, Formula))
