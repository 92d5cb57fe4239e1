"""The SOM in a file and on the parameter server, read as strictly as the ontology."""
import dataclasses
import re
from typing import Any, Callable, Dict, Iterable, List, Optional, Tuple, Type

from shsa_core.errors import ModelError
from shsa_core.files.document import Value, from_parameters, read_yaml
from shsa_core.language.expression import is_name
from shsa_core.model.checks import REGISTRY, Check, Checks, Limit, ValueSample
from shsa_core.model.kinds import Kind, Policy, Standby, Word
from shsa_core.model.service import LastResort, Provision, Service
from shsa_core.model.som import Som

PARAMETER = "shsa/som"
FROM_FILE_ALONE = ("topic", "type", "node", "policy")
"""What decides whom healing may kill or start: never taken from a parameter, which anybody may
write.
"""

_GRAPH_NAME = re.compile(r"(/[A-Za-z0-9_]+)+\Z")
_TYPE = re.compile(r"[A-Za-z][A-Za-z0-9_]*/[A-Za-z][A-Za-z0-9_]*\Z")
_FIELD = re.compile(r"[A-Za-z]\w*(\[\d{1,6}\])?(\.[A-Za-z]\w*(\[\d{1,6}\])?)*\Z", re.ASCII)
_MAX_NAME = 255
_LONGEST_COMMAND = 100
_HIGHEST_COUNT = 1000
_SHORTEST_PERIOD, _LONGEST_PERIOD = 1e-4, 1e6

Reader = Callable[[Value, str], Any]


def read_som(path: str) -> Som:
    """The SOM in a file. Raises ModelError with file and line at the first thing that is wrong."""
    som, errors = load_som(path)
    if errors:
        raise errors[0]
    return som


def load_som(path: str) -> Tuple[Som, List[ModelError]]:
    """The valid services of the SOM in a file, and everything that is wrong with the rest.

    Raises ModelError if the file as a whole cannot be read.
    """
    return read_tree(read_yaml(path))


def read_tree(tree: Value) -> Tuple[Som, List[ModelError]]:
    """The valid services in a tree, and everything that is wrong with the rest.

    Raises ModelError.
    """
    entry = tree.entry("the SOM", ("services",), ("services",))
    collector = _Collector()
    for name, value in entry["services"].mapping("services").items():
        try:
            collector.add(_service(name, value))
        except ModelError as error:
            collector.errors.append(error)
    return Som(collector.services), collector.errors


def merge_parameters(
    current: Som, value: object, where: str = PARAMETER
) -> Tuple[Som, List[ModelError]]:
    """The SOM that a changed tree of parameters asks for, and everything that is wrong with the
    tree.

    Parameters change the numbers of services that the file has. A service that is not valid, or
    that is not there, stays as it is in `current`; what FROM_FILE_ALONE names, fields and commands
    must be as there.
    """
    errors: List[ModelError] = []
    try:
        tree = from_parameters(value, where).entry("the SOM", ("services",), ("services",))
        entries = tree["services"].mapping("services")
    except ModelError as error:
        return current, [error]
    services = dict(current.services)
    for name, entry in entries.items():
        try:
            if name not in services:
                raise entry.error("the SOM file has no such service; only the file can add one")
            services[name] = _as_in_file(_service(name, entry), services[name], entry)
        except ModelError as error:
            errors.append(error)
    return Som(services.values()), errors


def som_parameters(som: Som) -> Dict[str, object]:
    """A SOM as it lies on the parameter server: plain mappings, lists and values, and no
    command.
    """
    return {"services": {service.name: service_parameters(service) for service in som}}


def service_parameters(service: Service) -> Dict[str, Any]:
    """A service as it lies on the parameter server."""
    plain: Dict[str, Any] = {
        "topic": service.topic,
        "type": service.type,
        "node": service.node,
        "period": "none" if service.period is None else service.period,
        "needed": service.needed,
        "standby": str(service.standby),
        "policy": str(service.policy),
        "provides": {p.property: _provision_parameters(p) for p in service.provides},
    }
    checks: Dict[str, object] = _check_parameters(service.checks.each, of_values=False)
    for name in ("bad", "of", "recovery"):
        if getattr(service.checks, name) != getattr(Checks, name):
            checks[name] = getattr(service.checks, name)
    optional = {
        "deadline": service.deadline,
        "checks": checks,
        "last_resort": {"values": dict(service.last_resort.values)},
    }
    if not service.last_resort.values:
        del optional["last_resort"]
    plain.update({key: value for key, value in optional.items() if value})
    return plain


def _service(name: str, value: Value) -> Service:
    if not is_name(name):
        raise value.error(f"{name!a} cannot be the name of a service")
    required = ("topic", "type", "node", "period", "provides")
    entry = value.entry(f"the service {name}", (*_SERVICE, "provides"), required)
    given = {key: _SERVICE[key](item, key) for key, item in entry.items() if key != "provides"}
    service = Service(name=name, provides=_provides(entry["provides"]), where=value.where, **given)
    rates = {Kind.RATE_HIGH.value, Kind.RATE_LOW.value} & set(_keys(entry.get("checks")))
    if service.event_driven and rates:
        raise entry["checks"].error(f"{min(rates)} needs a period, and there is none")
    if service.event_driven and service.deadline is not None:
        raise entry["deadline"].error("an event-driven topic (period: none) has no deadline")
    _check_last_resort(service, entry)
    return service


def _keys(value: Optional[Value]) -> Iterable[str]:
    return value.data if value is not None and isinstance(value.data, dict) else ()


def _provides(value: Value) -> Tuple[Provision, ...]:
    provisions: List[Provision] = []
    for name, item in value.mapping("provides").items():
        if not is_name(name):
            raise item.error(f"{name!a} cannot be the name of a property")
        entry = item.entry(f"the property {name}", _PROVISION, ("field",))
        given = {key: _PROVISION[key](each, key) for key, each in entry.items()}
        other = next((p for p in provisions if p.field == given["field"]), None)
        if other is not None:
            raise item.error(
                f"the field {other.field} provides {other.property} already; "
                "a field can provide one property"
            )
        provisions.append(Provision(property=name, where=item.where, **given))
    if not provisions:
        raise value.error("provides must name at least one property")
    return tuple(provisions)


def _check_last_resort(service: Service, entry: Dict[str, Value]) -> None:
    for name, safe in service.last_resort.values:
        source = service.source(name)
        if source is None:
            known = ", ".join(service.properties)
            raise entry["last_resort"].error(f"it does not provide {name}, only {known}")
        limits = source.provision.range
        if limits is not None and not limits[0] <= safe <= limits[1]:
            raise entry["last_resort"].error(
                f"the value {safe:g} of {name} is outside the range [{limits[0]:g}, {limits[1]:g}]"
            )


def _as_in_file(service: Service, old: Service, entry: Value) -> Service:
    """A service from the parameter server, with the command of its file.

    Raises ModelError if it goes too far.
    """
    for key in FROM_FILE_ALONE:
        if getattr(service, key) != getattr(old, key):
            raise entry.error(
                f"{key} is {getattr(old, key)} in the SOM file, and can be changed there alone"
            )
    fields = [(p.property, p.field) for p in old.provides]
    if sorted((p.property, p.field) for p in service.provides) != sorted(fields):
        raise entry.error("properties and fields can be changed in the SOM file alone")
    if service.last_resort.command:
        raise entry.error("a command can stand in the SOM file only, not on the parameter server")
    # The parameter server does not keep the order, which the generated code follows.
    provides = tuple(
        next(p for p in service.provides if p.property == name) for name in old.properties
    )
    resort = dataclasses.replace(service.last_resort, command=old.last_resort.command)
    return dataclasses.replace(service, provides=provides, last_resort=resort)


class _Collector:
    """Collects services whose claims do not clash, and errors."""

    def __init__(self) -> None:
        self.services: List[Service] = []
        self.errors: List[ModelError] = []
        self._types: Dict[str, Service] = {}
        self._publishers: Dict[Tuple[str, str], Service] = {}

    def add(self, service: Service) -> None:
        """Adds a service. Raises ModelError if it clashes with one that is there."""
        first = self._types.setdefault(service.topic, service)
        if service.type != first.type:
            raise ModelError(
                service.where,
                f"{service.topic} has the type {first.type} already ({first.where}); "
                f"a topic has one type, not {service.type} as well",
            )
        other = self._publishers.setdefault((service.topic, service.node), service)
        if other is not service:
            raise ModelError(
                service.where,
                f"{service.node} on {service.topic} is the service {other.name} already "
                f"({other.where}); "
                "a service is one topic of one node: put all its properties into one `provides`",
            )
        self.services.append(service)


def _matching(pattern: "re.Pattern[str]", example: str) -> Reader:
    def read(value: Value, key: str) -> str:
        text = value.string(key)
        if len(text) > _MAX_NAME or not pattern.match(text):
            raise value.error(f"{key} must be written like {example}, not {value.describe()}")
        return text

    return read


def _positive(value: Value, key: str) -> float:
    number = value.number(key)
    if number <= 0.0:
        raise value.error(f"{key} must be above 0, not {number:g}")
    return number


def _period(value: Value, key: str) -> Optional[float]:
    if value.data == "none":
        return None
    if isinstance(value.data, str) or value.data is None:
        raise value.error(f"{key} must be a number of s, or none, not {value.describe()}")
    number = value.number(key)
    if not _SHORTEST_PERIOD <= number <= _LONGEST_PERIOD:
        allowed = f"{_SHORTEST_PERIOD:g} to {_LONGEST_PERIOD:g} s"
        raise value.error(f"{key} must be {allowed}, or none, not {number:g}")
    return number


def _share(value: Value, key: str) -> float:
    number = value.number(key)
    if not 0.0 < number <= 1.0:
        raise value.error(f"{key} must be above 0 and at most 1, not {number:g}")
    return number


def _interval(value: Value, key: str) -> Tuple[float, float]:
    items = value.sequence(f"{key}, [lowest, highest],")
    if len(items) != 2:
        raise value.error(f"{key} must be two numbers, [lowest, highest], not {len(items)}")
    lowest, highest = items[0].number(f"{key}'s lowest"), items[1].number(f"{key}'s highest")
    if lowest >= highest:
        raise value.error(f"{key} must have its lowest first, not [{lowest:g}, {highest:g}]")
    return (lowest, highest)


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
    return _each_check(value.entry(key, _names(of_values=True)), of_values=True)


def _checks(value: Value, key: str) -> Checks:
    counts = {"bad": Checks.bad, "of": Checks.of, "recovery": Checks.recovery}
    names = value.mapping(key)
    for name in _names(of_values=True):
        if name in names:
            raise names[name].error(
                f"{name} is about one value: it stands with a property, under provides"
            )
    entry = value.entry(key, [*_names(of_values=False), *counts])
    given = {name: _count(entry[name], name) for name in counts if name in entry}
    checks = Checks(each=_each_check(entry, of_values=False), **given)
    if checks.bad > checks.of:
        raise value.error(f"bad must be at most of, {checks.of}, not {checks.bad}")
    return checks


def _names(of_values: bool) -> List[str]:
    return [name for name, each in REGISTRY.items() if (each.sample is ValueSample) is of_values]


def _each_check(entry: Dict[str, Value], of_values: bool) -> Tuple[Check, ...]:
    """The checks that a mapping asks for: each false (off), true (as usual) or its limit."""
    found: List[Check] = []
    for name in _names(of_values):
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


_SERVICE: Dict[str, Reader] = {
    "topic": _matching(_GRAPH_NAME, "/battery_current"),
    "type": _matching(_TYPE, "std_msgs/Float64"),
    "node": _matching(_GRAPH_NAME, "/amperemeter"),
    "period": _period,
    "deadline": _positive,
    "needed": _flag,
    "standby": _one_of(Standby),
    "policy": _one_of(Policy),
    "checks": _checks,
    "last_resort": _last_resort,
}
"""What a service may say beside `provides`: a new key is a line here, and one in `Service`."""

_PROVISION: Dict[str, Reader] = {
    "field": _matching(_FIELD, "data or twist.twist.linear.x"),
    "range": _interval,
    "quality": _share,
    "checks": _value_checks,
}


def _provision_parameters(provision: Provision) -> Dict[str, object]:
    plain: Dict[str, object] = {"field": provision.field, "quality": provision.quality}
    checks = _check_parameters(provision.checks, of_values=True)
    if provision.range is not None:
        plain["range"] = list(provision.range)
    if checks:
        plain["checks"] = checks
    return plain


def _check_parameters(checks: Iterable[Check], of_values: bool) -> Dict[str, object]:
    """What differs from the defaults."""
    given = {check.kind.value: check.limit for check in checks}
    return {
        name: given.get(name, False)
        for name in _names(of_values)
        if given.get(name) != REGISTRY[name].default
    }
