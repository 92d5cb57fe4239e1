"""How each key of a SOM is read: a new key is a line in SERVICE, PROVISION or HOST."""
import re
from typing import Any, Callable, Dict, List, Optional, Tuple, Type

from shsa_core.errors import ModelError, ShsaError
from shsa_core.files.document import Value
from shsa_core.files.error_values import read_error
from shsa_core.model.checks import OF_VALUE, REGISTRY, Check, Checks, Limit
from shsa_core.model.field import parse_field
from shsa_core.model.host import Placement
from shsa_core.model.kinds import Contain, OnPartition, Others, Policy, Standby, Word
from shsa_core.model.service import LastResort

_GRAPH_NAME = re.compile(r"(/[A-Za-z0-9_]+|[A-Za-z]\w*)(/[A-Za-z0-9_]+)*\Z", re.ASCII)
_TYPE = re.compile(r"[A-Za-z][A-Za-z0-9_]*/[A-Za-z][A-Za-z0-9_]*\Z")
_CAUSE = re.compile(r"/?[A-Za-z_][A-Za-z0-9_]*(/[A-Za-z0-9_]+)*\Z")
_MAX_NAME = 255
_LONGEST_COMMAND = 100
_HIGHEST_COUNT = 1000
_SHORTEST_PERIOD_S, _LONGEST_PERIOD_S = 1e-4, 1e6
_LONGEST_DEADLINE = 1e6  # periods

Reader = Callable[[Value, str], Any]


def _matching(pattern: "re.Pattern[str]", example: str) -> Reader:
    def read(value: Value, key: str) -> str:
        text = value.string(key)
        if len(text) > _MAX_NAME or not pattern.match(text):
            raise value.error(f"{key} must be written like {example}, not {value.describe()}")
        return text

    return read


def _field(value: Value, key: str) -> str:
    text = value.string(key)
    try:
        return str(parse_field(text))
    except ShsaError as error:
        raise value.error(f"{key}: {error}") from error


def _positive(value: Value, key: str) -> float:
    number = value.number(key)
    if number <= 0.0:
        raise value.error(f"{key} must be above 0, not {number:g}")
    return number


def _deadline(value: Value, key: str) -> float:
    number = value.number(key)
    if not 1.0 <= number <= _LONGEST_DEADLINE:
        raise value.error(f"{key} must be 1 to {_LONGEST_DEADLINE:g} periods, not {number:g}")
    return number


def _period(value: Value, key: str) -> Optional[float]:
    if value.data == "none":
        return None
    if isinstance(value.data, str) or value.data is None:
        raise value.error(f"{key} must be a number of s, or none, not {value.describe()}")
    number = value.number(key)
    if not _SHORTEST_PERIOD_S <= number <= _LONGEST_PERIOD_S:
        allowed = f"{_SHORTEST_PERIOD_S:g} to {_LONGEST_PERIOD_S:g} s"
        raise value.error(f"{key} must be {allowed}, or none, not {number:g}")
    return number


def _share(value: Value, key: str) -> float:
    number = value.number(key)
    if not 0.0 < number <= 1.0:
        raise value.error(f"{key} must be above 0 and at most 1, not {number:g}")
    return number


def _causes(value: Value, key: str) -> Tuple[str, ...]:
    read = _matching(_CAUSE, "usb_hub or /driver")
    return tuple(dict.fromkeys(read(item, f"a name in {key}") for item in value.sequence(key)))


def _derived_from(value: Value, key: str) -> Tuple[str, ...]:
    read = _matching(_GRAPH_NAME, "odometry, the name of a service, or /odom, a topic")
    return tuple(dict.fromkeys(read(item, f"a name in {key}") for item in value.sequence(key)))


def _hosts(value: Value, key: str) -> Tuple[str, ...]:
    names = (item.string(f"a name in {key}") for item in value.sequence(key))
    return tuple(dict.fromkeys(names))


def _host(value: Value, key: str) -> str:
    return value.string(key)


def _placement(value: Value, key: str) -> Placement:
    entry = value.entry(key, ("prefer", "forbid"))
    given = {name: _hosts(item, name) for name, item in entry.items()}
    placement = Placement(**given)
    both = set(placement.prefer) & set(placement.forbid)
    if both:
        raise value.error(f"{min(both)} is both preferred and forbidden")
    return placement


def _flag(value: Value, key: str) -> bool:
    return value.flag(key)


def _one_of(words: Type[Word]) -> Reader:
    def read(value: Value, key: str) -> Word:
        text = value.string(key)
        allowed = [str(each) for each in words]
        if text not in allowed:
            raise value.error(f"{key} must be one of {', '.join(allowed)}, not {value.describe()}")
        return words(text)

    return read


def _value_checks(value: Value, key: str) -> Tuple[Check, ...]:
    return _each_check(value.entry(key, check_names(of_values=True)), of_values=True)


def _checks(value: Value, key: str) -> Checks:
    counts = ("bad", "of", "recovery", "intermittent")
    names = value.mapping(key)
    for name in check_names(of_values=True):
        if name in names:
            raise names[name].error(
                f"{name} is about one value: it stands with a property, under provides"
            )
    entry = value.entry(key, [*check_names(of_values=False), *counts])
    given = {name: _count(entry[name], name) for name in counts if name in entry}
    checks = Checks(each=_each_check(entry, of_values=False), **given)
    if checks.bad > checks.of:
        raise value.error(f"bad must be at most of, {checks.of}, not {checks.bad}")
    return checks


def check_names(of_values: bool) -> List[str]:
    return [name for name, each in REGISTRY.items() if (each.sample in OF_VALUE) is of_values]


def _each_check(entry: Dict[str, Value], of_values: bool) -> Tuple[Check, ...]:
    """The checks that a mapping asks for: each false (off), true (as usual) or its limit."""
    found: List[Check] = []
    for name in check_names(of_values):
        kind = REGISTRY[name]
        limit = kind.default if name not in entry else _limit(entry[name], name)
        if limit is not None:
            found.append(kind(limit))
    return tuple(found)


def _limit(value: Value, name: str) -> Optional[Limit]:
    usual = REGISTRY[name].usual
    if value.data is False:
        return None
    if usual is True:
        return value.flag(name)
    if value.data is True:
        if usual is None:
            raise value.error(f"{name} must be false or a number above 0; it has no usual limit")
        return usual
    number = value.number(name)
    if number <= 0.0:
        raise value.error(f"{name} must be false, true or a number above 0, not {number:g}")
    return number


def _count(value: Value, name: str) -> int:
    number = value.number(name)
    if number != int(number) or not 1 <= number <= _HIGHEST_COUNT:
        raise value.error(
            f"{name} must be a whole number from 1 to {_HIGHEST_COUNT}, not {number:g}"
        )
    return int(number)


def _last_resort(value: Value, key: str) -> LastResort:
    if value.data == "stop":
        return LastResort()
    if not isinstance(value.data, dict):
        raise value.error(
            f"{key} must be stop, {{values: {{PROPERTY: NUMBER}}}} or "
            "{command: [PROGRAM, ARGUMENT, ...]}, "
            f"not {value.describe()}"
        )
    entry = value.entry(key, ("values", "command"))
    safe = entry["values"].mapping("values") if "values" in entry else {}
    values = tuple((name, item.number(f"the value of {name}")) for name, item in safe.items())
    words: List[str] = []
    if "command" in entry:
        items = entry["command"].sequence("command (a program and its arguments)")
        words = [item.string("a word of command") for item in items]
        if not 0 < len(words) <= _LONGEST_COMMAND or not words[0]:
            raise value.error(f"command must have 1 to {_LONGEST_COMMAND} words, the program first")
    if any("\0" in word for word in words):
        raise value.error("a word of command cannot hold a zero byte")
    return LastResort(values, tuple(words))


SERVICE: Dict[str, Reader] = {
    "topic": _matching(_GRAPH_NAME, "/battery_current or battery_current"),
    "type": _matching(_TYPE, "std_msgs/Float64"),
    "node": _matching(_GRAPH_NAME, "/amperemeter or amperemeter"),
    "period": _period,
    "deadline": _deadline,
    "needed": _flag,
    "standby": _one_of(Standby),
    "policy": _one_of(Policy),
    "checks": _checks,
    "last_resort": _last_resort,
    "contain": _one_of(Contain),
    "others": _one_of(Others),
    "latched": _flag,
    "fails_with": _causes,
    "fault_tolerant_time": _positive,
    "derived_from": _derived_from,
    "host": _host,
    "placement": _placement,
    "on_partition": _one_of(OnPartition),
}
"""What a service may say beside `provides`: a new key is a line here, and one in `Service`."""

PROVISION: Dict[str, Reader] = {
    "field": _field,
    "range": Value.interval,
    "quality": _share,
    "checks": _value_checks,
    "error": read_error,
    "calibrate": _flag,
}

HOST: Dict[str, Reader] = {"cores": _positive, "link": _positive}


def read_keys(
    entry: Dict[str, Value], readers: Dict[str, Reader], errors: List[ModelError]
) -> Dict[str, Any]:
    """What the keys of an entry say that have a reader; what is wrong goes to `errors`."""
    given: Dict[str, Any] = {}
    for key, item in entry.items():
        try:
            if key in readers:
                given[key] = readers[key](item, key)
        except ModelError as error:
            errors += error.errors
    return given
