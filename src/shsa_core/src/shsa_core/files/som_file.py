"""The SOM in a file and on the parameter server, read as strictly as the ontology."""
import dataclasses
from typing import Collection, Container, Dict, Iterable, List, Optional, Tuple

from shsa_core.errors import ModelError, ModelErrors
from shsa_core.files.document import Value, from_parameters, read_yaml
from shsa_core.files.error_values import usual_quality
from shsa_core.files.som_hosts import check_hosts, read_hosts
from shsa_core.files.som_plain import hosts_parameters, service_parameters, som_parameters
from shsa_core.files.som_values import PROVISION, SERVICE, read_keys
from shsa_core.language.syntax import is_name
from shsa_core.model.checks import OFF_FOR_DISTANCES, default_checks
from shsa_core.model.field import tells_of_nothing
from shsa_core.model.kinds import Kind
from shsa_core.model.names import full_name
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
FROM_FILE_ALONE = (
    *("topic", "gate", "type", "node", "policy", "contain"),
    *("host", "placement", "on_partition"),
)
"""What decides whom healing may kill or start, and where: never taken from parameters."""
SECTIONS = ("services", "hosts")
HELD_AS = {"topic": "heard", "gate": "topic"}
"""Keys by whose name the model has something else."""
NAMES = ("topic", "gate", "node")
"""What a SOM may name relative to the namespace in which healing runs."""


def read_som(path: str, namespace: str = "/") -> Som:
    """The SOM in a file. Raises ModelErrors: all that is wrong, with file and line."""
    som, errors = load_som(path, namespace)
    if errors:
        raise ModelErrors(errors)
    return som


def load_som(path: str, namespace: str = "/") -> Tuple[Som, List[ModelError]]:
    """The valid services of the SOM in a file, and everything that is wrong with the rest.

    Relative names of topics and nodes are names in `namespace`.

    Raises ModelError if the file as a whole cannot be read.
    """
    return read_tree(read_yaml(path), namespace)


def read_tree(tree: Value, namespace: str = "/") -> Tuple[Som, List[ModelError]]:
    """The valid services in a tree, and what is wrong with the rest. Raises ModelError."""
    collector = _Collector()
    collector.errors += tree.wrong_keys("the SOM", SECTIONS, ("services",))
    sections = tree.mapping("the SOM")
    if "services" not in sections:
        raise ModelErrors(collector.errors)
    named = sections["services"].mapping("services")
    computers = sections["hosts"].mapping("hosts") if "hosts" in sections else {}
    hosts, refused = read_hosts(computers, named)
    collector.errors += refused
    for name, value in named.items():
        try:
            collector.add(_service(name, value, namespace, named, computers))
        except ModelError as error:
            collector.errors += error.errors
    return Som(collector.services, hosts), collector.errors


def merge_parameters(
    current: Som, value: object, where: str = PARAMETER, namespace: str = "/"
) -> Tuple[Som, List[ModelError]]:
    """The SOM that a changed tree of parameters asks for, and all that is wrong with it.

    Parameters change the numbers of services that the file has. A service that is not valid, or
    that is not there, stays as it is in `current`; what FROM_FILE_ALONE names, fields and commands
    must be as there.
    """
    given = value.get("services") if isinstance(value, dict) else None
    if not isinstance(value, dict) or not isinstance(given, dict):
        return current, [_no_table(value, where)]
    keys = from_parameters(dict.fromkeys(value), where)
    errors = list(keys.wrong_keys("the SOM", SECTIONS))
    hosts = hosts_parameters(current)
    if value.get("hosts", hosts) != hosts:
        errors.append(ModelError(f"{where}/hosts", "hosts can be changed in the SOM file alone"))
    services = dict(current.services)
    for name, plain in given.items():
        try:
            entry = from_parameters(plain, f"{where}/services/{name}")
            if name not in services:
                raise entry.error("the SOM file has no such service; only the file can add one")
            service = _service(name, entry, namespace, services, current.hosts)
            services[name] = _as_in_file(service, services[name], entry)
        except ModelError as error:
            errors += error.errors
    return current.with_services(services.values()), errors


def _no_table(value: object, where: str) -> ModelError:
    """Why there is no table of services in some parameters."""
    try:
        tree = from_parameters(value, where).entry("the SOM", SECTIONS, ("services",))
        tree["services"].mapping("services")
    except ModelError as error:
        return error
    return ModelError(where, "there is no table of services")


def _service(
    name: str,
    value: Value,
    namespace: str,
    services: Container[str],
    hosts: Collection[str],
) -> Service:
    """One service; `services` and `hosts`: the names of all."""
    if not is_name(name):
        raise value.error(f"{name!a} cannot be the name of a service")
    required = ("topic", "type", "node", "period", "provides")
    what, entry = f"the service {name}", value.mapping(f"the service {name}")
    errors = list(value.wrong_keys(what, (*SERVICE, "provides"), required))
    given = read_keys(entry, SERVICE, errors)
    if "provides" in entry:
        try:
            given["provides"] = _provides(entry["provides"], given.get("type", ""))
        except ModelError as error:
            errors += error.errors
    if errors:
        raise ModelErrors(errors)
    given.update({key: full_name(given[key], namespace) for key in NAMES if key in given})
    given["derived_from"] = tuple(
        each if each in services else full_name(each, namespace)
        for each in given.get("derived_from", ())
    )
    if {name, given["topic"], given.get("gate")} & set(given["derived_from"]):
        raise entry["derived_from"].error(f"{name} cannot be derived from itself")
    if given.get("gate") == given["topic"]:
        raise entry["gate"].error("gate must be another topic than the one that consumers hear")
    if "gate" in given:
        given["beyond_gate"], given["topic"] = given["topic"], given.pop("gate")
    service = Service(name=name, where=value.where, **given)
    rates = {Kind.RATE_HIGH.value, Kind.RATE_LOW.value} & set(_keys(entry.get("checks")))
    if service.event_driven and rates:
        raise entry["checks"].error(f"{min(rates)} needs a period, and there is none")
    if service.event_driven and service.deadline is not None:
        raise entry["deadline"].error("an event-driven topic (period: none) has no deadline")
    if service.event_driven and service.bridge:
        raise entry["bridge"].error("an event-driven topic (period: none) has no bridge")
    _check_last_resort(service, entry)
    check_hosts(service, entry, hosts)
    return service


def _keys(value: Optional[Value]) -> Iterable[str]:
    return value.data if value is not None and isinstance(value.data, dict) else ()


def _provides(value: Value, message_type: str) -> Tuple[Provision, ...]:
    provisions: List[Provision] = []
    errors: List[ModelError] = []
    for name, item in value.mapping("provides").items():
        try:
            provisions.append(_provision(name, item, provisions, message_type))
        except ModelError as error:
            errors += error.errors
    if errors:
        raise ModelErrors(errors)
    if not provisions:
        raise value.error("provides must name at least one property")
    return tuple(provisions)


def _provision(name: str, item: Value, others: Iterable[Provision], message_type: str) -> Provision:
    if not is_name(name):
        raise item.error(f"{name!a} cannot be the name of a property")
    what, entry = f"the property {name}", item.mapping(f"the property {name}")
    errors = list(item.wrong_keys(what, PROVISION, ("field",)))
    given = read_keys(entry, PROVISION, errors)
    if errors:
        raise ModelErrors(errors)
    given.setdefault("quality", usual_quality(given.get("error")))
    other = next((p for p in others if p.field == given["field"]), None)
    if other is not None:
        raise item.error(
            f"the field {other.field} provides {other.property} already; "
            "a field can provide one property"
        )
    if tells_of_nothing(message_type, given["field"]):
        asked = set(_keys(entry.get("checks")))
        checks = given.get("checks", default_checks(of_values=True))
        given["checks"] = tuple(
            c for c in checks if c.kind not in OFF_FOR_DISTANCES or c.kind.value in asked
        )
    return Provision(property=name, where=item.where, **given)


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
        asked, meant = (getattr(each, HELD_AS.get(key, key)) for each in (service, old))
        if asked != meant:
            raise entry.error(f"{key} is {meant} in the SOM file, and can be changed there alone")
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
        self._topics: Dict[str, Service] = {}

    def add(self, service: Service) -> None:
        """Adds a service. Raises ModelError if it clashes with one that is there."""
        for topic in service.topics:
            sharer = self._topics.setdefault(topic, service)
            if sharer is not service and (service.gated or sharer.gated):
                raise ModelError(
                    service.where,
                    f"{topic} is that of the service {sharer.name} already ({sharer.where}); "
                    "a topic that goes through a gate has one service",
                )
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
