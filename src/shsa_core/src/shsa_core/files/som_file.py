"""The SOM in a file and on the parameter server, read as strictly as the ontology."""
import dataclasses
from typing import Dict, Iterable, List, Optional, Tuple

from shsa_core.errors import ModelError
from shsa_core.files.document import Value, from_parameters, read_yaml
from shsa_core.files.som_plain import service_parameters, som_parameters
from shsa_core.files.som_values import PROVISION, SERVICE
from shsa_core.language.expression import is_name
from shsa_core.model.kinds import Kind
from shsa_core.model.service import Provision, Service
from shsa_core.model.som import Som

__all__ = [
    "FROM_FILE_ALONE",
    "PARAMETER",
    "load_som",
    "merge_parameters",
    "read_som",
    "read_tree",
    "service_parameters",
    "som_parameters",
]

PARAMETER = "shsa/som"
FROM_FILE_ALONE = ("topic", "type", "node", "policy")
"""What decides whom healing may kill or start: never taken from parameters."""


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
    """The valid services in a tree, and what is wrong with the rest. Raises ModelError."""
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
    """The SOM that a changed tree of parameters asks for, and all that is wrong with it.

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


def _service(name: str, value: Value) -> Service:
    if not is_name(name):
        raise value.error(f"{name!a} cannot be the name of a service")
    required = ("topic", "type", "node", "period", "provides")
    entry = value.entry(f"the service {name}", (*SERVICE, "provides"), required)
    given = {key: SERVICE[key](item, key) for key, item in entry.items() if key != "provides"}
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
        entry = item.entry(f"the property {name}", PROVISION, ("field",))
        given = {key: PROVISION[key](each, key) for key, each in entry.items()}
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
