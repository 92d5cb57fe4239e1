"""The SOM in a file and on the parameter server, read as strictly as the ontology."""
import dataclasses
import os
import re
from math import inf
from typing import Any, Collection, Dict, Iterable, List, Mapping, Optional, Tuple

from shsa_core.errors import ModelError, ModelErrors, listed
from shsa_core.files.document import Entry, Value, from_parameters, read_yaml
from shsa_core.files.keys import COUNTS, HOST, MESSAGE_CHECKS, SERVICE, SOM, VALUE, VALUE_CHECKS
from shsa_core.files.readers import Keys, plain_entry, read_entry, read_keys
from shsa_core.files.regular import written_by_others
from shsa_core.language.syntax import NAMING, is_name
from shsa_core.model.checks import LEARNED, Check, default_checks, default_limit
from shsa_core.model.error import quality_of
from shsa_core.model.field import is_distance
from shsa_core.model.cost import Host
from shsa_core.model.names import full_name
from shsa_core.model.som import Som, differences
from shsa_core.model.service import Provision, Service

PARAMETER = "shsa/som"
FROM_FILE_ALONE = (
    *("topic", "gate", "type", "node", "policy", "contain"),
    *("host", "placement", "on_partition"),
    *("needed", "deadline", "checks", "fails_with", "derived_from"),
    *("prefer", "avoid", "cost"),
)
"""The keys that decide whom healing may kill or start, and where, who may convict, and when it
looks away."""
NAMES = ("topic", "gate", "node")
"""The keys whose names may be relative to the namespace in which healing runs."""
_HOST_NAME = re.compile(r"[A-Za-z][A-Za-z0-9_]{0,99}\Z")  # it becomes a part of topics


def read_som(path: str, namespace: str = "/") -> Som:
    """Return the SOM in a file. Raises ModelErrors: all that is wrong, with file and line."""
    som, errors = load_som(path, namespace)
    if errors:
        raise ModelErrors(errors)
    return som


def load_som(path: str, namespace: str = "/") -> Tuple[Som, List[ModelError]]:
    """Return the valid services of the SOM in a file, and of those added to it, and what is wrong.

    Relative names are names in `namespace`. Raises ModelError if a file as a whole cannot be read.
    """
    tree, added = read_yaml(path), added_path(path)
    if os.path.lexists(added):
        why = written_by_others(added)
        if why:
            raise ModelError(added, why)
        tree = _with_added(tree, read_yaml(added))
    return read_tree(tree, namespace)


def refuse_others_commands(som: Som, path: str) -> None:
    """Raise ModelError if a SOM starts programs, and others can write its file."""
    names = [each.name for each in som if each.last_resort.command or each.policy.restarts]
    why = written_by_others(path) if names else ""
    if why:
        raise ModelError(path, f"it starts programs ({', '.join(names)}), and {why}")


def added_path(path: str) -> str:
    """Return the file beside a SOM in which `shsa add` keeps services."""
    root, ending = os.path.splitext(path)
    return f"{root}.added{ending}"


def _with_added(tree: Value, added: Value) -> Value:
    """Return a SOM with the services of another one. Raises ModelError if it has one already."""
    more = read_entry(added, "what is added", {"services": SOM["services"]})["services"]
    sections = tree.mapping("the SOM")
    services = sections["services"].mapping("services") if "services" in sections else {}
    for name in more.keys() & services.keys():
        raise more[name].error(f"{name} is in the SOM file already: change it there")
    return Value(tree.where, {**sections, "services": Value(tree.where, {**services, **more})})


def read_tree(tree: Value, namespace: str = "/") -> Tuple[Som, List[ModelError]]:
    """Return the valid services in a tree, and what is wrong with the rest. Raises ModelError."""
    sections, errors = read_keys(tree, "the SOM", SOM)
    if "services" not in sections:
        raise ModelErrors(errors)
    named, computers = sections["services"], sections.get("hosts", {})
    hosts: List[Host] = []
    services: List[Service] = []
    claimed: Dict[str, List[Service]] = {}
    for name, value in computers.items():
        try:
            hosts.append(_host(name, value, named))
        except ModelError as error:
            errors += error.errors
    for name, value in named.items():
        try:
            service = _service(name, value, namespace, named, computers)
            _claim(service, claimed)
            services.append(service)
        except ModelError as error:
            errors += error.errors
    return Som(services, hosts, sections.get("act", False)), errors


def merge_parameters(
    file: Som,
    value: object,
    where: str = PARAMETER,
    namespace: str = "/",
    current: Optional[Som] = None,
) -> Tuple[Som, List[ModelError]]:
    """Return the SOM that a changed tree of parameters asks for, and all that is wrong with it.

    What is healthy by the `file` stays so, however small the steps are: ranges and periods become
    only larger, and FROM_FILE_ALONE names the rest. A service that is not valid, or not there,
    stays as it is in `current`; None: as in the file.
    """
    current = current or file
    if not isinstance(value, dict) or not isinstance(value.get("services"), dict):
        return current, [ModelError(where, "there is no table of services")]
    tree = from_parameters(value, where).mapping("the SOM")
    errors = list(Value(where, tree).wrong_keys("the SOM", SOM))
    for key, plain_value in {"hosts": _plain_hosts(current), "act": current.act}.items():
        if value.get(key, plain_value) != plain_value:
            what = f"{key} can be changed in the SOM file alone"
            errors.append(ModelError(f"{where}/{key}", what))
    services = dict(current.services)
    for name, entry in tree["services"].mapping("services").items():
        try:
            if name not in services:
                raise entry.error("the SOM file has no such service; only the file can add one")
            service = _service(name, entry, namespace, services, current.hosts)
            services[name] = _as_in_file(service, file.services[name], entry)
        except ModelError as error:
            errors += error.errors
    return current.with_services(services.values()), errors


def _host(name: str, value: Value, services: Collection[str]) -> Host:
    if not _HOST_NAME.match(name):
        raise value.error(f"the name of a host must be written like raspberry_pi, not {name!a}")
    if name in services:
        raise value.error(f"{name} is a service as well: what fails with it could not be told")
    return Host(name, **read_entry(value, f"the host {name}", HOST))


def _service(
    name: str,
    value: Value,
    namespace: str,
    services: Collection[str],
    hosts: Collection[str],
) -> Service:
    """Return one service; `services` and `hosts`: the names of all."""
    if not is_name(name):
        raise value.error(f"{name!a} cannot be the name of a service; {NAMING}")
    given = read_entry(value, f"the service {name}", SERVICE)
    entry = value.mapping(name)
    given.update({key: full_name(given[key], namespace) for key in NAMES if key in given})
    given["avoid"] = tuple(full_name(each, namespace) for each in given.get("avoid", ()))
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
    given["provides"] = _provisions(given["provides"], given["type"])
    service = Service(name=name, where=value.where, **given)
    if service.event_driven:
        _check_event_driven(service, entry)
    _check_formula(service, entry)
    _check_last_resort(service, entry)
    _check_hosts(service, entry, hosts)
    return service


def _provisions(given: Mapping[str, Dict[str, Any]], message_type: str) -> Tuple[Provision, ...]:
    fields: Dict[str, str] = {}
    provisions: List[Provision] = []
    errors: List[ModelError] = []
    for name, keys in given.items():
        other = fields.setdefault(keys["field"], name)
        if other != name:
            what = f"the field {keys['field']} provides {other} already; "
            errors.append(ModelError(keys["where"], what + "a field can provide one property"))
        asked, distance = keys.pop("checks", {}), is_distance(message_type, keys["field"])
        keys.setdefault("quality", quality_of(keys.get("error")))
        provisions.append(Provision(name, checks=default_checks(True, distance, asked), **keys))
    if errors:
        raise ModelErrors(errors)
    return tuple(provisions)


def _check_event_driven(service: Service, entry: Entry) -> None:
    checks = entry["checks"].mapping("checks") if "checks" in entry else {}
    for name in ("rate_high", "rate_low"):
        if name in checks:
            raise checks[name].error(f"{name} needs a period, and there is none")
    for key in ("deadline", "bridge"):
        if getattr(service, key):
            raise entry[key].error(f"an event-driven topic (period: none) has no {key}")


def _check_formula(service: Service, entry: Entry) -> None:
    for name in [name for each in service.checks.formulas for name in each.parsed.names]:
        if name not in service.properties:
            formula = entry["checks"].mapping("checks")["formula"]
            known = ", ".join(service.properties)
            raise formula.error(f"formula uses {name}, but the service provides {known} alone")


def _check_last_resort(service: Service, entry: Entry) -> None:
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


def _check_hosts(service: Service, entry: Entry, hosts: Collection[str]) -> None:
    placed = (*service.placement.prefer, *service.placement.forbid)
    for key, names in ("host", (service.host,)), ("placement", placed):
        for name in names if key in entry else ():
            if name not in hosts:
                known = listed(sorted(hosts)) or "there are none"
                raise entry[key].error(f"{key} names {name!a}, which is none of the hosts: {known}")
    if hosts and set(hosts) == set(service.placement.forbid):
        raise entry["placement"].error("it forbids every host: a substitute could run nowhere")


def _claim(service: Service, claimed: Dict[str, List[Service]]) -> None:
    """Note the topics of a service. Raises ModelError if others claim what it claims."""
    for topic in service.topics:
        for other in claimed.get(topic, ()):
            there = f"the service {other.name} already ({other.where})"
            if service.gated or other.gated:
                what = (
                    f"{topic} is that of {there}; a topic that goes through a gate has one service"
                )
            elif service.type != other.type:
                what = (
                    f"{topic} has the type {other.type} already ({other.where}); "
                    f"a topic has one type, not {service.type} as well"
                )
            elif service.node == other.node:
                what = (
                    f"{service.node} on {topic} is {there}; "
                    "a service is one topic of one node: put all its properties into one `provides`"
                )
            else:
                continue
            raise ModelError(service.where, what)
    for topic in service.topics:
        claimed.setdefault(topic, []).append(service)


def _as_in_file(service: Service, old: Service, entry: Value) -> Service:
    """Return a service from the parameter server. Raises ModelError if it goes too far."""
    asked, meant = service_parameters(service), service_parameters(old)
    for key in FROM_FILE_ALONE:
        if asked.get(key) != meant.get(key):
            said = meant.get(key, "not said")
            raise entry.error(f"{key} is {said} in the SOM file, and can be changed there alone")
    fields = [(p.property, p.field) for p in old.provides]
    if sorted((p.property, p.field) for p in service.provides) != sorted(fields):
        raise entry.error("properties and fields can be changed in the SOM file alone")
    provisions = {each.property: each for each in service.provides}
    for before in old.provides:
        now = provisions[before.property]
        for what in ("checks", "error", "fault_tolerant_error"):
            if getattr(now, what) != getattr(before, what):
                raise entry.error(f"{what} of {now.property} can be changed in the SOM file alone")
        low, high = now.range or (-inf, inf)
        least, most = before.range or (-inf, inf)
        if low > least or high < most:
            raise entry.error(f"range of {now.property}: only the SOM file can make it narrower")
    if (service.period or inf) < (old.period or inf):
        raise entry.error("period: only the SOM file can make it shorter")
    if service.last_resort.command:
        raise entry.error("a command can be in the SOM file only, not on the parameter server")
    # The parameter server does not keep the order, which the generated code follows.
    provides = tuple(provisions[name] for name in old.properties)
    resort = dataclasses.replace(service.last_resort, command=old.last_resort.command)
    new = dataclasses.replace(service, provides=provides, last_resort=resort)
    fastest = old.period if new.period != old.period else None
    weakened = differences(new, old, "in the SOM file")
    return dataclasses.replace(new, weakened=weakened, fastest=fastest)


def som_parameters(som: Som) -> Dict[str, object]:
    """Return a SOM as it lies on the parameter server: plain values, and no command."""
    tree: Dict[str, object] = {"act": True} if som.act else {}
    if som.hosts:
        tree["hosts"] = _plain_hosts(som)
    tree["services"] = {service.name: service_parameters(service) for service in som}
    return tree


def service_parameters(service: Service) -> Dict[str, Any]:
    """Return a service as it lies on the parameter server: as in a file, without its command."""
    apart = ("gate", "provides", "checks", "last_resort")
    entry = plain_entry(service, {key: SERVICE[key] for key in SERVICE if key not in apart})
    entry["topic"] = service.heard
    if service.gated:
        entry["gate"] = service.topic
    if service.event_driven:
        entry["period"] = "none"
    if service.bridge == 0.0:
        entry["bridge"] = False
    checks = _check_entry(service.checks.each, MESSAGE_CHECKS)
    checks.update(plain_entry(service.checks, COUNTS))
    if checks:
        entry["checks"] = checks
    if service.last_resort.values:
        entry["last_resort"] = {"values": dict(service.last_resort.values)}
    entry["provides"] = {p.property: _value_entry(p, service.type) for p in service.provides}
    return entry


def _value_entry(provision: Provision, message_type: str) -> Dict[str, Any]:
    entry = plain_entry(provision, VALUE)
    if provision.error is not None and provision.quality == provision.error.quality:
        del entry["quality"]  # the error says it
    distance = is_distance(message_type, provision.field)
    entry["checks"] = _check_entry(provision.checks, VALUE_CHECKS, distance)
    if not entry["checks"]:
        del entry["checks"]
    return entry


def _check_entry(checks: Iterable[Check], keys: Keys, distance: bool = False) -> Dict[str, Any]:
    """Return what differs from the defaults; what is learned has no number."""
    given = {check.kind.value: check.limit for check in checks}
    differing = {n: given.get(n) for n in keys if given.get(n) != default_limit(n, distance)}
    words = {None: False, LEARNED: True}
    return {name: words.get(limit, limit) for name, limit in differing.items()}


def _plain_hosts(som: Som) -> Dict[str, object]:
    return {name: plain_entry(host, HOST) for name, host in som.hosts.items()}
