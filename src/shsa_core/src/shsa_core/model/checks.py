"""The checks that a service's messages must pass: one class a kind of failure.

A new kind is one more class here, a constant in shsa_msgs/Failure, a word in `kinds`, and a row in
docs/som.md; a test holds the four together.
"""
from dataclasses import dataclass
from math import isfinite
from typing import Any, ClassVar, Dict, Optional, Tuple, Type, Union

from shsa_core.model.kinds import Kind

Limit = Union[bool, float]


@dataclass(frozen=True)
class ValueSample:
    """One value of a message: of which property, in its unit; `still`: s since it changed.

    `last_good`: the one before it that was.
    """

    name: str
    value: float
    range: Optional[Tuple[float, float]] = None
    still: float = 0.0
    last_good: Optional[float] = None


@dataclass(frozen=True)
class RateSample:
    """`count` periods of `period` s passed between messages: in `shortest` to `longest` s."""

    count: int
    period: float
    longest: float
    shortest: float


@dataclass(frozen=True)
class StampSample:
    """A message arrived `age` s after its stamp.

    It may have waited `waited` s of these for its reader.
    """

    age: float
    waited: float = 0.0


@dataclass(frozen=True)
class IntruderSample:
    """A publisher that nobody names has published for `lasted` s beside `rightful` ones."""

    lasted: float
    rightful: Tuple[str, ...]


Sample = Union[ValueSample, RateSample, StampSample, IntruderSample]


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
        """What was seen and what is allowed, in words, if `sample` is bad."""
        raise NotImplementedError


class NotANumber(Check):
    kind, sample, default, usual = Kind.NOT_A_NUMBER, ValueSample, True, True
    tells = "the value is NaN or infinite"

    def judge(self, sample: ValueSample) -> Optional[str]:
        if isfinite(sample.value):
            return None
        return f"{sample.name} is {sample.value}, a finite number is needed"


class OutOfRange(Check):
    kind, sample, default, usual = Kind.OUT_OF_RANGE, ValueSample, True, True
    tells = "the value is outside `range`"

    def judge(self, sample: ValueSample) -> Optional[str]:
        if sample.range is None or not isfinite(sample.value):
            return None
        low, high = sample.range
        if low <= sample.value <= high:
            return None
        return f"{sample.name} is {sample.value:g}, {low:g} to {high:g} are allowed"


class Stuck(Check):
    kind, sample, default, usual = Kind.STUCK, ValueSample, None, 1.0
    tells = "the value has not changed for this long, s"

    def judge(self, sample: ValueSample) -> Optional[str]:
        if sample.still <= self.limit:
            return None
        seen = f"{sample.name} is {sample.value:g} for {sample.still:.3f} s"
        return f"{seen}, it must change within {self.limit:g} s"


class Jump(Check):
    kind, sample, default, usual = Kind.JUMP, ValueSample, None, None
    tells = "the value is further than this from the last good one, in the property's unit"

    def judge(self, sample: ValueSample) -> Optional[str]:
        before = sample.last_good
        if before is None or not abs(sample.value - before) > self.limit:
            return None
        seen = f"{sample.name} went from {before:g} to {sample.value:g}"
        return f"{seen}, steps of {self.limit:g} are allowed"


class RateHigh(Check):
    kind, sample, default, usual = Kind.RATE_HIGH, RateSample, 1.5, 1.5
    tells = "messages come at more than this times the rate that `period` gives"

    def judge(self, sample: RateSample) -> Optional[str]:
        allowed = self.limit / sample.period
        if sample.count <= allowed * sample.longest:
            return None
        seen = f"{sample.count} messages came in {sample.longest:.3f} s"
        return f"{seen}, at most {allowed:.1f} Hz are allowed"


class RateLow(Check):
    kind, sample, default, usual = Kind.RATE_LOW, RateSample, 0.5, 0.5
    tells = "messages come at less than this times the rate that `period` gives"

    def judge(self, sample: RateSample) -> Optional[str]:
        needed = self.limit / sample.period
        if sample.count >= needed * sample.shortest:
            return None
        seen = f"{sample.count} messages came in {sample.shortest:.3f} s"
        return f"{seen}, at least {needed:.1f} Hz are needed"


class StaleStamp(Check):
    kind, sample, default, usual = Kind.STALE_STAMP, StampSample, None, 0.5
    tells = (
        "the stamp in the header is older than this at arrival, s; a stamp of zero is not judged"
    )

    def judge(self, sample: StampSample) -> Optional[str]:
        oldness = sample.age - sample.waited
        if oldness <= self.limit:
            return None
        return f"the stamp is {oldness:.3f} s old, {self.limit:g} s are allowed"


class FutureStamp(Check):
    kind, sample, default, usual = Kind.FUTURE_STAMP, StampSample, None, 0.5
    tells = "the stamp in the header is newer than this at arrival, s"

    def judge(self, sample: StampSample) -> Optional[str]:
        if -sample.age <= self.limit:
            return None
        return f"the stamp is {-sample.age:.3f} s in the future, {self.limit:g} s are allowed"


class UnknownPublisher(Check):
    kind, sample, default, usual = Kind.UNKNOWN_PUBLISHER, IntruderSample, 1.0, 1.0
    tells = (
        "a publisher that is neither `node` nor a substitute publishes beside one of them "
        "for this long, s"
    )

    def judge(self, sample: IntruderSample) -> Optional[str]:
        if sample.lasted <= self.limit:
            return None
        seen = f"it publishes beside {', '.join(sample.rightful)} for {self.limit:g} s"
        return f"{seen}, neither the SOM nor a substitution names it"


REGISTRY: Dict[str, Type[Check]] = {
    each.kind.value: each
    for each in (
        NotANumber,
        OutOfRange,
        Stuck,
        Jump,
        RateHigh,
        RateLow,
        StaleStamp,
        FutureStamp,
        UnknownPublisher,
    )
}
"""Every check by its name: the key under `checks` in the SOM.

The first that finds something tells its kind.
"""


def default_checks(of_values: bool) -> Tuple[Check, ...]:
    """The checks of a value, or of a message, where the SOM says nothing."""
    return tuple(
        each(each.default)
        for each in REGISTRY.values()
        if each.default is not None and (each.sample is ValueSample) is of_values
    )


@dataclass(frozen=True)
class Checks:
    """The checks of a service's messages as a whole; those of one value stand with its property.

    `bad` bad messages among the last `of` make a failure: noise does not, a fault that comes and
    goes does. `recovery` good messages in a row end it.
    """

    each: Tuple[Check, ...] = default_checks(of_values=False)
    bad: int = 3
    of: int = 10
    recovery: int = 5
