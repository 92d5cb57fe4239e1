"""Every key of the ontology and the SOM: its reader and what it means, basic or for experts.

A new key is a line here and a field of its class in `model`.
"""
import re
from typing import Any, Dict, List, Optional, Tuple, Type, Union

from shsa_core.errors import ModelError, ModelErrors
from shsa_core.files.document import Value
from shsa_core.files.readers import ABOVE_0, HIGHEST, Key, Keys, Reader, basic, flag, interval
from shsa_core.files.readers import list_of, mapping, matching, not_negative, number, number_in
from shsa_core.files.readers import one_of, parsed, positive, read_entry, required, share, text
from shsa_core.files.readers import whole_number
from shsa_core.language.syntax import NAMING, is_name
from shsa_core.language.temporal import parse_formula
from shsa_core.language.vectors import LONGEST, elements
from shsa_core.model.checks import REGISTRY, Check, Checks, Formula, Limit, default_checks
from shsa_core.model.samples import OF_VALUE
from shsa_core.model.error import Error
from shsa_core.model.field import parse_field
from shsa_core.model.service import AdaptiveDeadline, LastResort, Placement
from shsa_core.model.kinds import Contain, OnPartition, Others, Policy, Standby

LONGEST_COMMAND = 100


def _error(value: Value, key: str) -> Error:
    if not isinstance(value.data, dict):
        return Error(positive.read(value, key))
    error = Error(**read_entry(value, key, ERROR, within=f"{key}: "))
    if abs(error.bias) > error.rms:
        bias = value.data["bias"]
        raise bias.error(f"{key}: bias must be at most rms, {error.rms:g}, not {error.bias:g}")
    return error


ERROR: Keys = {
    "rms": Key(positive, "root mean square of value minus truth", required=True),
    "bias": Key(number, "mean of value minus truth; at most rms in size"),
    "p95": Key(not_negative, "95th percentile of its size"),
    "delay": Key(not_negative, "s by which the value lags"),
    "baseline": Key(positive, "the RMS error of the mean"),
    "n": Key(whole_number(10**12), "points that it was measured on"),
    "source": Key(text, "where it was measured, in words"),
}
"""Figures of an error, in the unit of its value; delay in s."""
_quality = basic(share, "how far it can be trusted; not given: from its error")
_known_error = basic(
    Reader("number, or mapping", _error),
    "how far it is from the truth, in the unit of the value: its RMS, or figures",
)
_unit = basic(text, "its unit; 1: none; not given: not known")

_section = Reader("mapping", lambda value, key: {} if value.data is None else value.mapping(key))
ONTOLOGY: Keys = {
    "properties": basic(_section, "the quantities that change"),
    "constants": basic(_section, "the quantities that do not"),
    "relations": basic(_section, "how properties follow from others"),
}
PROPERTY: Keys = {
    "unit": _unit,
    "symbol": Key(text, "its sign in formulas"),
    "usual": Key(interval, "the interval of its 5th to 95th percentile"),
    "length": Key(whole_number(LONGEST), "it is a vector of `name_0`, `name_1`, ..."),
    "elements": Key(list_of(text, "list of properties"), "it is the vector of these; no other key"),
}


def _numbers(value: Value, key: str, within: int = 2) -> Any:
    """Return a number, a tuple of them for a vector, or tuples for the rows of a matrix."""
    if not isinstance(value.data, list) or not within:
        return value.number(key)
    found = tuple(_numbers(item, f"an element of {key}", within - 1) for item in value.data)
    lengths = {len(each) if isinstance(each, tuple) else 0 for each in found}
    if len(lengths) != 1 or len(found) > LONGEST:
        raise value.error(f"{key} must have 1 to {LONGEST} numbers, or rows of the same length")
    return found


CONSTANT: Keys = {
    "value": required(
        Reader("number, list of numbers, or list of rows", _numbers),
        "its value; a list is a vector, a list of rows a matrix",
    ),
    "unit": _unit,
}


def _steps(value: Value, key: str) -> Dict[str, Value]:
    entries = value.mapping(key)
    if not entries:
        raise value.error(f"{key} has no entry")
    return entries


# Expressions stay as they are: they are unfolded by what the whole file says.
FUNCTION: Keys = {
    "function": basic(
        Reader("expression, or list of them", lambda value, key: value),
        "how it is computed; may stand alone, without this key; a list: each element of a vector",
    ),
    "constraint": basic(
        Reader("condition", lambda value, key: value), "where it is false, there is no output"
    ),
    "quality": _quality,
    "error": _known_error,
    "where": Key(
        Reader("mapping", _steps),
        "names for values on the way, in order; as an entry of the relation: for all of it",
    ),
    "not_executable": Key(text, "instead of function: a text that becomes no code"),
    "inputs": Key(list_of(text, "list of names"), "with not_executable: properties it needs"),
}
"""One direction of a relation."""


def _check(kind: Type[Check]) -> Key:
    if kind is Formula:
        return Key(parsed("formula", lambda text: parse_formula(text).text), kind.tells)
    words: Dict[Union[bool, str], Optional[Limit]] = {False: None, True: kind.usual}
    form, highest = "false, true or a number above 0", HIGHEST
    if kind.usual is True:
        form, highest = "true or false", 0.0
    elif kind.usual is None:
        form = "false or a number above 0"
        del words[True]
    return Key(number_in(ABOVE_0, highest, form, words), kind.tells)


VALUE_CHECKS: Keys = {n: _check(each) for n, each in REGISTRY.items() if each.sample in OF_VALUE}
MESSAGE_CHECKS: Keys = {n: _check(e) for n, e in REGISTRY.items() if n not in VALUE_CHECKS}
COUNTS: Keys = {
    "bad": Key(whole_number(1000), "this many bad messages make a failure"),
    "of": Key(whole_number(1000), "among this many, the last ones"),
}


def _checks(value: Value, key: str) -> Checks:
    for name, item in value.mapping(key).items():
        if name in VALUE_CHECKS:
            raise item.error(
                f"{name} is about one value: it stands with a property, under provides"
            )
    given = read_entry(value, key, {**MESSAGE_CHECKS, **COUNTS})
    counts = {name: given.pop(name) for name in COUNTS if name in given}
    checks = Checks(each=default_checks(of_values=False, asked=given), **counts)
    if checks.bad > checks.of:
        raise value.error(f"bad must be at most of, {checks.of}, not {checks.bad}")
    return checks


_SLICE = re.compile(r"([^()]*)\[(\d{0,6}):(\d{1,6})\]([^()]*)")
_field = parsed("field of the message", lambda field: str(parse_field(field)))


def _fields(value: Value, key: str) -> Dict[str, str]:
    """Map what the name of a number, or of each element of a vector, ends with to its field."""
    if isinstance(value.data, list):
        items = value.data
    else:
        cut = _SLICE.fullmatch(value.string(key))
        if cut is None:
            return {"": _field.read(value, key)}
        places = range(int(cut[2] or 0), int(cut[3]))[: LONGEST + 1]
        texts = (f"{cut[1]}[{place}]{cut[4]}" for place in places)
        items = [Value(value.where, each, each) for each in texts]
    if not 0 < len(items) <= LONGEST:
        raise value.error(f"{key} must have 1 to {LONGEST} elements, not {value.describe()}")
    return dict(zip(elements("", len(items)), (_field.read(item, key) for item in items)))


VALUE: Keys = {
    "field": required(
        Reader("field of the message, or list of them", _fields),
        "where in the message the value stands; of a vector, of each element, or `position[0:6]`",
    ),
    "range": basic(interval, "what it can be at most, in the property's unit; outside, it fails"),
    "usual": basic(interval, "what it usually is; outside, people are warned"),
    "quality": _quality,
    "error": _known_error,
    "fault_tolerant_error": Key(positive, "p95 that a substitute's error may have, in its unit"),
    "checks": Key(
        Reader("mapping", lambda value, key: read_entry(value, key, VALUE_CHECKS)),
        "what else is a failure of the value",
    ),
    "calibrate": Key(flag, "learn gain and offset of its substitutes while the sensor works"),
}
"""A value of a service, under `provides`."""


def _provides(value: Value, key: str) -> Dict[str, Dict[str, Any]]:
    given: Dict[str, Dict[str, Any]] = {}
    errors: List[ModelError] = []
    for name, item in value.mapping(key).items():
        try:
            if not is_name(name):
                raise item.error(f"{name!a} cannot be the name of a property; {NAMING}")
            keys = read_entry(item, f"the property {name}", VALUE)
            for end, field in keys["field"].items():
                if name + end in given:
                    raise item.error(f"{name}{end} is provided already, as an element of a vector")
                given[name + end] = {**keys, "field": field, "where": item.where}
        except ModelError as error:
            errors += error.errors
    if errors:
        raise ModelErrors(errors)
    if not given:
        raise value.error("provides must name at least one property")
    return given


def _deadline(value: Value, key: str) -> Union[float, AdaptiveDeadline]:
    if isinstance(value.data, dict):
        return AdaptiveDeadline(**read_entry(value, key, DEADLINE))
    allowed = "1 to 1e+06 periods, or {false_alarms: NUMBER}"
    return number_in(1.0, 1e6, allowed).read(value, key)


def _placement(value: Value, key: str) -> Placement:
    placement = Placement(**read_entry(value, key, PLACEMENT))
    both = set(placement.prefer) & set(placement.forbid)
    if both:
        raise value.error(f"{min(both)} is both preferred and forbidden")
    return placement


def _last_resort(value: Value, key: str) -> LastResort:
    if value.data == "stop":
        return LastResort()
    if isinstance(value.data, dict):
        return LastResort(**read_entry(value, key, LAST_RESORT))
    allowed = "stop, {values: {PROPERTY: NUMBER}} or {command: [PROGRAM, ARGUMENT, ...]}"
    raise value.error(f"{key} must be {allowed}, not {value.describe()}")


def _safe_values(value: Value, key: str) -> Tuple[Tuple[str, float], ...]:
    entries = value.mapping(key).items()
    return tuple((name, item.number(f"the value of {name}")) for name, item in entries)


def _command(value: Value, key: str) -> Tuple[str, ...]:
    items = value.sequence(f"{key} (a program and its arguments)")
    words = tuple(item.string(f"a word of {key}") for item in items)
    if not 0 < len(words) <= LONGEST_COMMAND or not words[0]:
        raise value.error(f"{key} must have 1 to {LONGEST_COMMAND} words, the program first")
    if any("\0" in word for word in words):
        raise value.error(f"a word of {key} cannot hold a zero byte")
    return words


DEADLINE: Keys = {
    "false_alarms": Key(
        number_in(1e-3, 100.0, "0.001 to 100 an hour"),
        "how often a healthy stream may exceed the learned deadline",
        required=True,
    )
}
_hosts = list_of(text, "list of hosts")
PLACEMENT: Keys = {
    "prefer": Key(_hosts, "where it should run, the best first"),
    "forbid": Key(_hosts, "where it never runs"),
}
LAST_RESORT: Keys = {
    "values": Key(Reader("{PROPERTY: NUMBER}", _safe_values), "what is published"),
    "command": Key(
        Reader("list of words", _command),
        "a program, run once and by no shell; from the file alone",
    ),
}
HOST: Keys = {
    "cores": Key(positive, "number of CPUs; not given: nothing is refused"),
    "link": Key(positive, "bytes/s of its network link; not given: nothing is refused"),
}
_CAUSE = re.compile(r"/?[A-Za-z_][A-Za-z0-9_]*(/[A-Za-z0-9_]+)*\Z")
_GRAPH_NAME = re.compile(r"(/[A-Za-z0-9_]+|[A-Za-z]\w*)(/[A-Za-z0-9_]+)*\Z", re.ASCII)
_TYPE = re.compile(r"[A-Za-z][A-Za-z0-9_]*/[A-Za-z][A-Za-z0-9_]*\Z")

SERVICE: Keys = {
    "topic": required(
        matching(_GRAPH_NAME, "/battery_current or battery_current"),
        "its name; relative: in the namespace",
    ),
    "type": required(matching(_TYPE, "std_msgs/Float64"), "the message type"),
    "node": required(
        matching(_GRAPH_NAME, "/amperemeter or amperemeter"), "name of the node that publishes it"
    ),
    "period": required(
        number_in(1e-4, 1e6, "0.0001 to 1e+06 s, or none", {"none": None}),
        "s between two messages; none: event-driven",
    ),
    "needed": basic(flag, "it is healed; not given: while a node outside healing subscribes"),
    "standby": basic(one_of(Standby), "what is ready before a failure"),
    "policy": basic(one_of(Policy), "what is done about a failure"),
    "provides": required(Reader("mapping", _provides), "the properties in it, by name, see below"),
    "contain": basic(
        one_of(Contain),
        "node: its node is killed when it fails; none: never; not given: by what would be lost",
    ),
    "deadline": Key(
        Reader("1 to 1e+06 periods, or mapping", _deadline),
        "periods without a message after which a publisher is silent, or how to learn them",
    ),
    "bridge": Key(
        number_in(1.5, 1e6, "1.5 to 1e+06 periods, or false", {False: 0.0}),
        "periods without a message until a ready substitute fills in, at most; not given: 2.5 if "
        "it is hot",
    ),
    "checks": Key(Reader("mapping", _checks), "what else is a failure of its messages"),
    "last_resort": Key(
        Reader("stop, or mapping", _last_resort), "what is done when nothing can substitute"
    ),
    "others": Key(one_of(Others), "the content of fields that a substitute does not compute"),
    "latched": Key(flag, "latched: a late subscriber gets the newest message"),
    "fails_with": Key(
        list_of(matching(_CAUSE, "usb_hub or /driver"), "list of names"),
        "common causes: services that name the same cause fail together",
    ),
    "derived_from": Key(
        list_of(
            matching(_GRAPH_NAME, "odometry, the name of a service, or /odom, a topic"),
            "list of services or topics",
        ),
        "services or topics that its values are computed from; not given: measured",
    ),
    "prefer": Key(
        list_of(text, "list of relations"),
        "relations by which its substitute should be computed, unless they err more than the mean",
    ),
    "avoid": Key(
        list_of(matching(_GRAPH_NAME, "/camera or camera"), "list of nodes"),
        "nodes that its substitute reads only if nothing else is left",
    ),
    "cost": Key(
        whole_number(10**9),
        "what reading one of its values costs, as in kB/s; of equal substitutes the cheaper wins",
    ),
    "fault_tolerant_time": Key(positive, "s without good data that users tolerate; see `check`"),
    "gate": Key(
        matching(_GRAPH_NAME, "/battery_current/raw or battery_current/raw"),
        "the topic that its node publishes on; a gate checks it and publishes `topic`",
    ),
    "host": Key(text, "name of the host that its node runs on"),
    "placement": Key(Reader("mapping", _placement), "where a substitute of it may run"),
    "on_partition": Key(one_of(OnPartition), "what healing does while its computer is cut off"),
}
SOM: Keys = {
    "services": required(mapping, "the services, by name"),
    "act": basic(flag, "true: healing acts; otherwise it only advises"),
    "hosts": Key(mapping, "the robot's computers, by name"),
}
