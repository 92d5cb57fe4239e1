"""The kinds of failure, and how each is switched and tuned: the key `checks` of a service in the SOM."""
import dataclasses
from dataclasses import dataclass
from typing import Any, Dict, Optional, Union

from shsa_core.model.document import Value

NODE_GONE = "node_gone"
SILENT = "silent"
NEVER_PUBLISHED = "never_published"
OUT_OF_RANGE = "out_of_range"
NOT_A_NUMBER = "not_a_number"
RATE_HIGH = "rate_high"
RATE_LOW = "rate_low"
STUCK = "stuck"
JUMP = "jump"
STALE_STAMP = "stale_stamp"
FUTURE_STAMP = "future_stamp"
UNKNOWN_PUBLISHER = "unknown_publisher"


@dataclass(frozen=True, order=True)
class Checks:
    """The checks of one service; None: off. What is not about one field goes by the topic's first service.

    `out_of_range`, `not_a_number`: of the field. `rate_high`, `rate_low`: times the rate that the period gives.
    `stuck`: s without a change of the field. `jump`: how far the field may lie from its last good value, in the
    property's unit. `stale_stamp`, `future_stamp`: s between the stamp in the message's header and its arrival;
    a stamp of zero is not judged. `unknown_publisher`: s that a publisher which is neither the SOM's node nor a
    substitute may publish beside one of them.

    `bad` bad messages among the last `of` make a failure: noise does not, a fault that comes and goes does.
    `recovery` good messages in a row end it.
    """

    out_of_range: bool = True
    not_a_number: bool = True
    rate_high: Optional[float] = 1.5
    rate_low: Optional[float] = 0.5
    stuck: Optional[float] = None
    jump: Optional[float] = None
    stale_stamp: Optional[float] = None
    future_stamp: Optional[float] = None
    unknown_publisher: Optional[float] = 1.0
    bad: int = 3
    of: int = 10
    recovery: int = 5

    def parameters(self) -> Dict[str, Union[bool, int, float]]:
        """What differs from the defaults, as it lies on the parameter server."""
        usual = Checks()
        return {
            name: False if value is None else value
            for name, value in dataclasses.asdict(self).items()
            if value != getattr(usual, name)
        }


_USUAL = {
    RATE_HIGH: 1.5,
    RATE_LOW: 0.5,
    STUCK: 1.0,
    STALE_STAMP: 0.5,
    FUTURE_STAMP: 0.5,
    UNKNOWN_PUBLISHER: 1.0,
}
_HIGHEST_COUNT = 1000


def read_checks(value: Value, key: str) -> Checks:
    """The checks in a mapping: each false (off), true (on, as usual) or its limit. Raises ModelError."""
    names = [each.name for each in dataclasses.fields(Checks)]
    entry = value.entry(key, names)
    given: Dict[str, Any] = {}
    for name, item in entry.items():
        if name in ("bad", "of", "recovery"):
            given[name] = _count(item, name)
        elif name in (OUT_OF_RANGE, NOT_A_NUMBER):
            given[name] = item.flag(name)
        else:
            given[name] = _limit(item, name)
    checks = Checks(**given)
    if checks.bad > checks.of:
        raise value.error(f"bad must be at most of, {checks.of}, not {checks.bad}")
    return checks


def _count(value: Value, name: str) -> int:
    number = value.number(name)
    if number != int(number) or not 1 <= number <= _HIGHEST_COUNT:
        raise value.error(
            f"{name} must be a whole number from 1 to {_HIGHEST_COUNT}, not {number:g}"
        )
    return int(number)


def _limit(value: Value, name: str) -> Optional[float]:
    if value.data is False:
        return None
    if value.data is True:
        if name not in _USUAL:
            raise value.error(f"{name} must be false or a number above 0; it has no usual limit")
        return _USUAL[name]
    number = value.number(name)
    if number <= 0.0:
        raise value.error(f"{name} must be false, true or a number above 0, not {number:g}")
    return number
