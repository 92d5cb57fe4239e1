"""How each key of a SOM is read: a new key is a line in SERVICE, PROVISION or HOST."""
import re
from typing import Any, Callable, Dict, List, NamedTuple, Optional, Tuple, Type, Union

from shsa_core.errors import ModelError, ShsaError
from shsa_core.files.document import Value
from shsa_core.files.error_values import read_error
from shsa_core.model.checks import OF_VALUE, REGISTRY, Check, Checks, Limit
from shsa_core.model.field import parse_field
from shsa_core.model.host import Placement
from shsa_core.model.kinds import Contain, OnPartition, Others, Policy, Standby, Word
from shsa_core.model.service import AdaptiveDeadline, LastResort

_GRAPH_NAME = re.compile(r"(/[A-Za-z0-9_]+|[A-Za-z]\w*)(/[A-Za-z0-9_]+)*\Z", re.ASCII)
_TYPE = re.compile(r"[A-Za-z][A-Za-z0-9_]*/[A-Za-z][A-Za-z0-9_]*\Z")
_CAUSE = re.compile(r"/?[A-Za-z_][A-Za-z0-9_]*(/[A-Za-z0-9_]+)*\Z")
_MAX_NAME = 255
_LONGEST_COMMAND = 100
_HIGHEST_COUNT = 1000
_SHORTEST_PERIOD_S, _LONGEST_PERIOD_S = 1e-4, 1e6
_LONGEST_DEADLINE = 1e6  # periods
_FEWEST_ALARMS, _MOST_ALARMS = 1e-3, 100.0  # an hour of the topic
_SHORTEST_BRIDGE = 1.5  # periods: a message is not late before

Reader = Callable[[Value, str], Any]


COUNTS = {
    "bad": "so many bad messages make a failure",
    "of": "that many messages, the last ones, are looked at for it",
    "recovery": "so many good messages in a row end it",
    "intermittent": "so many bad messages among ten times as many make one, too; unsaid: twice bad",
}
"""What a service's `checks` may count, and what each means."""
PLACEMENT = {
    "prefer": "the hosts that it rather runs on, best first",
    "forbid": "the hosts that it never runs on",
}
ADAPTIVE = {
    "false_alarms": "so many an hour, at most, of a deadline that is learned from healthy gaps",
}
LAST_RESORT = {
    "values": "safe values that are published: PROPERTY: NUMBER",
    "command": "a program and its arguments, run once and through no shell; from the file alone",
}


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


def _deadline(value: Value, key: str) -> Union[float, AdaptiveDeadline]:
    if isinstance(value.data, dict):
        item = value.entry(key, ADAPTIVE, ADAPTIVE)["false_alarms"]
        rate = item.number("false_alarms")
        if not _FEWEST_ALARMS <= rate <= _MOST_ALARMS:
            allowed = f"{_FEWEST_ALARMS:g} to {_MOST_ALARMS:g} an hour"
            raise item.error(f"false_alarms must be {allowed}, not {rate:g}")
        return AdaptiveDeadline(rate)
    if isinstance(value.data, (str, list, bool)) or value.data is None:
        raise value.error(
            f"{key} must be a number of periods, or {{false_alarms: NUMBER}}, "
            f"not {value.describe()}"
        )
    number = value.number(key)
    if not 1.0 <= number <= _LONGEST_DEADLINE:
        raise value.error(f"{key} must be 1 to {_LONGEST_DEADLINE:g} periods, not {number:g}")
    return number


def _bridge(value: Value, key: str) -> float:
    if value.data is False:
        return 0.0
    allowed = f"{_SHORTEST_BRIDGE:g} to {_LONGEST_DEADLINE:g} periods, or false"
    if value.data is True:
        raise value.error(f"{key} must be {allowed}, not true")
    number = value.number(key)
    if not _SHORTEST_BRIDGE <= number <= _LONGEST_DEADLINE:
        raise value.error(f"{key} must be {allowed}, not {number:g}")
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
    entry = value.entry(key, PLACEMENT)
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


def _words(words: Type[Word]) -> str:
    return ", ".join(str(each) for each in words)


def _value_checks(value: Value, key: str) -> Tuple[Check, ...]:
    return _each_check(value.entry(key, check_names(of_values=True)), of_values=True)


def _checks(value: Value, key: str) -> Checks:
    names = value.mapping(key)
    for name in check_names(of_values=True):
        if name in names:
            raise names[name].error(
                f"{name} is about one value: it stands with a property, under provides"
            )
    entry = value.entry(key, [*check_names(of_values=False), *COUNTS])
    given = {name: _count(entry[name], name) for name in COUNTS if name in entry}
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
    entry = value.entry(key, LAST_RESORT)
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


class Key(NamedTuple):
    """A key of a file: how it is read, what is written there, and what it means, in words."""

    read: Reader
    form: str
    means: str


SERVICE: Dict[str, Key] = {
    "topic": Key(
        _matching(_GRAPH_NAME, "/battery_current or battery_current"),
        "name",
        "name of the topic; relative: in the namespace in which healing runs",
    ),
    "type": Key(_matching(_TYPE, "std_msgs/Float64"), "package/Type", "the message type"),
    "node": Key(
        _matching(_GRAPH_NAME, "/amperemeter or amperemeter"),
        "name",
        "name of the node that publishes it",
    ),
    "period": Key(
        _period,
        f"{_SHORTEST_PERIOD_S:g} to {_LONGEST_PERIOD_S:g} s, or none",
        "s between two messages; none: event-driven",
    ),
    "deadline": Key(
        _deadline,
        f"1 to {_LONGEST_DEADLINE:g} periods, or {{false_alarms: {_FEWEST_ALARMS:g} to "
        f"{_MOST_ALARMS:g} an hour}}",
        "periods without a message after which a publisher is silent, or how they are learned",
    ),
    "needed": Key(_flag, "true or false", "somebody relies on it: it is healed"),
    "standby": Key(_one_of(Standby), _words(Standby), "what is ready before a failure"),
    "policy": Key(_one_of(Policy), _words(Policy), "what is done about a failure"),
    "checks": Key(_checks, "mapping", "what else is a failure of its messages"),
    "last_resort": Key(
        _last_resort,
        "stop, or mapping",
        "what is done when nothing can substitute",
    ),
    "gate": Key(
        _matching(_GRAPH_NAME, "/battery_current/raw or battery_current/raw"),
        "name",
        "the topic that its node publishes on, where a gate checks it and publishes `topic`",
    ),
    "contain": Key(
        _one_of(Contain),
        _words(Contain),
        "whether its node is killed when it fails; unsaid, what would be lost decides",
    ),
    "others": Key(
        _one_of(Others),
        _words(Others),
        "what stands in the fields that a substitute does not compute",
    ),
    "latched": Key(_flag, "true or false", "who subscribes late gets its newest message"),
    "fails_with": Key(
        _causes,
        "list of names",
        "what else makes it fail, together with other services that name it",
    ),
    "fault_tolerant_time": Key(
        _positive, "s, above 0", "s without good data that its users tolerate; checked if given"
    ),
    "derived_from": Key(
        _derived_from,
        "list of services or topics",
        "what its values are computed from; unsaid, they are measured",
    ),
    "host": Key(_host, "name of a host", "the computer that its node runs on"),
    "placement": Key(_placement, "mapping", "where a substitute of it may run"),
    "on_partition": Key(
        _one_of(OnPartition),
        _words(OnPartition),
        "what is done while its computer cannot be reached",
    ),
    "bridge": Key(
        _bridge,
        f"{_SHORTEST_BRIDGE:g} to {_LONGEST_DEADLINE:g} periods, or false",
        "periods without a message after which a substitute that stands by fills in; unsaid, 2.5 "
        "where standby is hot",
    ),
}
"""What a service may say beside `provides`: a new key is a line here, and one in `Service`."""

PROVISION: Dict[str, Key] = {
    "field": Key(_field, "field of the message", "where in the message the value stands"),
    "range": Key(Value.interval, "[lowest, highest]", "limits in the property's unit"),
    "quality": Key(
        _share, "above 0, at most 1", "how far it can be trusted; unsaid, what its error says"
    ),
    "checks": Key(_value_checks, "mapping", "what else is a failure of the value"),
    "error": Key(
        read_error,
        "number, or mapping",
        "how far the value is from the truth, in the property's unit: its RMS, or figures",
    ),
    "calibrate": Key(
        _flag, "true or false", "whether what would derive the value is calibrated while it lives"
    ),
}

HOST: Dict[str, Key] = {
    "cores": Key(_positive, "number, above 0", "how many CPUs it has; unsaid, nothing is refused"),
    "link": Key(_positive, "bytes/s, above 0", "what its network link carries; unsaid, the same"),
}


def read_keys(
    entry: Dict[str, Value], readers: Dict[str, Key], errors: List[ModelError]
) -> Dict[str, Any]:
    """What the keys of an entry say that have a reader; what is wrong goes to `errors`."""
    given: Dict[str, Any] = {}
    for key, item in entry.items():
        try:
            if key in readers:
                given[key] = readers[key].read(item, key)
        except ModelError as error:
            errors += error.errors
    return given
