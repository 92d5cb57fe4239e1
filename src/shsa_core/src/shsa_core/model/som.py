"""The service-to-ontology mapping (SOM): which topics provide which properties."""
import builtins
import dataclasses
import re
from dataclasses import dataclass
from dataclasses import field as key
from typing import (
    Any,
    Callable,
    Dict,
    Iterable,
    Iterator,
    List,
    Mapping,
    Optional,
    Sequence,
    Tuple,
)

from shsa_core.errors import ModelError
from shsa_core.model.checks import Checks, read_checks
from shsa_core.model.document import Value, from_parameters, read_yaml
from shsa_core.model.expression import is_name
from shsa_core.model.policies import POLICIES, SUBSTITUTE, LastResort, read_last_resort

PARAMETER = "/shsa/som"

_GRAPH_NAME = re.compile(r"(/[A-Za-z0-9_]+)+\Z")
_TYPE = re.compile(r"[A-Za-z][A-Za-z0-9_]*/[A-Za-z][A-Za-z0-9_]*\Z")
_FIELD = re.compile(r"[A-Za-z]\w*(\[\d{1,6}\])?(\.[A-Za-z]\w*(\[\d{1,6}\])?)*\Z", re.ASCII)
_MAX_NAME = 255

Reader = Callable[[Value, str], Any]


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


def _one_of(*words: str) -> Reader:
    def read(value: Value, key: str) -> str:
        text = value.string(key)
        if text not in words:
            raise value.error(f"{key} must be one of {', '.join(words)}, not {value.describe()}")
        return text

    return read


def _by(read: Reader) -> Mapping[str, Reader]:
    return {"read": read}


@dataclass(frozen=True, order=True)
class Service:
    """One field of one topic that provides a property.

    `period` in s; `range` (lowest, highest) in the property's unit, None for no limit; `quality` in (0, 1];
    `needed`: somebody relies on it; `standby`: `cold`, `warm` or `hot`; `deadline`: periods without a message after
    which a publisher is silent, None as usual; `checks`: what else is a failure; `policy`: what is done about a failure;
    `last_resort`: what is done when nothing can substitute; `where`: file and line, or parameter.
    A new key of the SOM is a new line here: its name, its default, and the function that reads it.
    """

    property: str
    topic: str = key(metadata=_by(_matching(_GRAPH_NAME, "/battery_current")))
    field: str = key(metadata=_by(_matching(_FIELD, "data or twist.twist.linear.x")))
    type: str = key(metadata=_by(_matching(_TYPE, "std_msgs/Float64")))
    node: str = key(metadata=_by(_matching(_GRAPH_NAME, "/amperemeter")))
    period: float = key(metadata=_by(_positive))
    range: Optional[Tuple[float, float]] = key(default=None, metadata=_by(_interval))
    quality: float = key(default=1.0, metadata=_by(_share))
    needed: bool = key(default=False, metadata=_by(_flag))
    standby: str = key(default="cold", metadata=_by(_one_of("cold", "warm", "hot")))
    deadline: Optional[float] = key(default=None, metadata=_by(_positive))
    checks: Checks = key(default=Checks(), metadata=_by(read_checks))
    policy: str = key(default=SUBSTITUTE, metadata=_by(_one_of(*POLICIES)))
    last_resort: LastResort = key(default=LastResort(), metadata=_by(read_last_resort))
    where: str = key(default="", compare=False, repr=False)

    @builtins.property
    def path(self) -> str:
        """Topic and field as `rostopic echo` takes them: `/odom/twist/twist/linear/x`."""
        return self.topic + "/" + self.field.replace(".", "/")


class Som:
    """All services, immutable: `Som(services)`."""

    def __init__(self, services: Iterable[Service] = ()) -> None:
        self.services: Tuple[Service, ...] = tuple(services)

    def __iter__(self) -> Iterator[Service]:
        return iter(self.services)

    def __eq__(self, other: object) -> bool:
        return isinstance(other, Som) and self.services == other.services

    def __hash__(self) -> int:
        return hash(self.services)

    def of_property(self, name: str) -> Tuple[Service, ...]:
        """The services that provide the property `name`."""
        return tuple(s for s in self.services if s.property == name)

    def of_topic(self, topic: str) -> Tuple[Service, ...]:
        """The services that sit on `topic`, in the order of the SOM."""
        return tuple(s for s in self.services if s.topic == topic)

    def topics(self) -> Tuple[str, ...]:
        """The topics, each once, in the order of the SOM."""
        return tuple(dict.fromkeys(s.topic for s in self.services))

    def policy(self, topic: str) -> str:
        """What is done about a failure of `topic`: the first of its services that asks for more than a substitute."""
        asked = (s.policy for s in self.of_topic(topic) if s.policy != SUBSTITUTE)
        return next(asked, SUBSTITUTE)

    def command(self, topic: str) -> Tuple[str, ...]:
        """The command that is run when nothing can substitute `topic`; empty if there is none."""
        commands = (s.last_resort.command for s in self.of_topic(topic) if s.last_resort.command)
        return next(commands, ())

    def parameters(self) -> Dict[str, object]:
        """The SOM as it lies on the parameter server at `/shsa/som`: plain mappings, lists and values."""
        tree: Dict[str, object] = {}
        for service in self.services:
            entries = tree.setdefault(service.property, [])
            assert isinstance(entries, list)
            entries.append(_entry(service))
        return tree


def read_som(path: str) -> Som:
    """The SOM in a file. Raises ModelError with file and line at the first thing that is wrong."""
    som, errors = load_som(path)
    if errors:
        raise errors[0]
    return som


def load_som(path: str) -> Tuple[Som, List[ModelError]]:
    """The valid part of the SOM in a file, and everything that is wrong with the rest.

    Raises ModelError if the file as a whole cannot be read.
    """
    return _collect(read_yaml(path), Som(), from_file=True)


def som_from_parameters(value: object, where: str = PARAMETER) -> Som:
    """The SOM in a tree of parameters. Raises ModelError with the parameter's name at the first thing wrong."""
    som, errors = _collect(from_parameters(value, where), Som())
    if errors:
        raise errors[0]
    return som


def merge_parameters(
    current: Som, value: object, where: str = PARAMETER
) -> Tuple[Som, List[ModelError]]:
    """The SOM that a changed tree of parameters asks for, and everything that is wrong with the tree.

    Where an entry is not valid, the entry of `current` that it would have changed stays.
    """
    try:
        return _collect(from_parameters(value, where), current)
    except ModelError as error:
        return current, [error]


def _entry(service: Service) -> Dict[str, object]:
    entry: Dict[str, object] = {}
    for attribute in dataclasses.fields(Service):
        if "read" in attribute.metadata:
            value = getattr(service, attribute.name)
            if isinstance(value, (Checks, LastResort)):
                value = value.parameters() or None
            if isinstance(value, tuple):
                entry[attribute.name] = list(value)
            elif value is not None:
                entry[attribute.name] = value
    return entry


def _collect(tree: Value, current: Som, from_file: bool = False) -> Tuple[Som, List[ModelError]]:
    collector = _Collector()
    for name, entries in tree.mapping("the SOM").items():
        olds = current.of_property(name)
        try:
            if not is_name(name):
                raise entries.error(f"{name!a} cannot be the name of a property")
            values = entries.sequence(f"{name} (the services that provide it)")
        except ModelError as error:
            collector.errors.append(error)
            collector.keep(olds)
            continue
        for index, value in enumerate(values):
            try:
                service = _service(name, value)
                collector.add(service if from_file else _with_command(service, olds))
            except ModelError as error:
                collector.errors.append(error)
                collector.keep(_replaced(olds, index, value))
    return Som(collector.services), collector.errors


def _service(name: str, value: Value) -> Service:
    readers = {
        attribute.name: attribute.metadata["read"]
        for attribute in dataclasses.fields(Service)
        if "read" in attribute.metadata
    }
    required = [
        attribute.name
        for attribute in dataclasses.fields(Service)
        if attribute.name in readers and attribute.default is dataclasses.MISSING
    ]
    entry = value.entry(f"a service of {name}", readers, required)
    given = {key: readers[key](item, key) for key, item in entry.items()}
    service = Service(property=name, where=value.where, **given)
    safe, limits = service.last_resort.value, service.range
    if safe is not None and limits is not None and not limits[0] <= safe <= limits[1]:
        raise entry["last_resort"].error(
            f"the value {safe:g} is outside the range [{limits[0]:g}, {limits[1]:g}]"
        )
    return service


def _with_command(service: Service, olds: Sequence[Service]) -> Service:
    """A service from the parameter server with the command that its file gave it.

    Anyone may write a parameter, so none may name a command. Raises ModelError if this one does.
    """
    if service.last_resort.command:
        raise ModelError(
            service.where, "a command can stand in the SOM file only, not on the parameter server"
        )
    for old in olds:
        if old.path == service.path and old.last_resort.command:
            resort = dataclasses.replace(service.last_resort, command=old.last_resort.command)
            return dataclasses.replace(service, last_resort=resort)
    return service


def _replaced(olds: Sequence[Service], index: int, value: Value) -> Sequence[Service]:
    """The old service that a new entry stands for: the one on the same field, else the one in the same place."""
    entry = value.data if isinstance(value.data, dict) else {}
    claim = tuple(entry[key].data if key in entry else None for key in ("topic", "field"))
    same = [old for old in olds if (old.topic, old.field) == claim]
    return same or olds[index : index + 1]


class _Collector:
    """Collects services whose claims do not clash, and errors."""

    def __init__(self) -> None:
        self.services: List[Service] = []
        self.errors: List[ModelError] = []
        self._claims: Dict[Tuple[str, str], Service] = {}
        self._topics: Dict[str, Service] = {}

    def add(self, service: Service) -> None:
        """Adds a service. Raises ModelError if it clashes with one that is there."""
        other = self._claims.get((service.topic, service.field))
        if other:
            raise ModelError(
                service.where,
                f"{service.path} provides {other.property} already ({other.where}); "
                "a field can provide one property",
            )
        first = self._topics.setdefault(service.topic, service)
        for key in ("type", "node"):
            if getattr(service, key) != getattr(first, key):
                raise ModelError(
                    service.where,
                    f"{service.topic} has the {key} {getattr(first, key)} already "
                    f"({first.where}); a topic has one {key}, not {getattr(service, key)} as well",
                )
        self._claims[service.topic, service.field] = service
        self.services.append(service)

    def keep(self, olds: Iterable[Service]) -> None:
        """Adds old services where nothing new has taken their place."""
        for old in olds:
            if old not in self.services:
                try:
                    self.add(old)
                except ModelError as error:
                    self.errors.append(error)
