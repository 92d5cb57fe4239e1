"""The robot's computers in a SOM: read, and looked up where services name them."""
import re
from typing import Collection, List, Tuple

from shsa_core.errors import ModelError, ModelErrors, listed
from shsa_core.files.document import Entry, Value
from shsa_core.files.som_values import HOST, read_keys
from shsa_core.model.host import Host
from shsa_core.model.service import Service

_NAME = re.compile(r"[A-Za-z][A-Za-z0-9_]{0,99}\Z")  # it becomes a part of topics


def read_hosts(entry: Entry, services: Collection[str]) -> Tuple[List[Host], List[ModelError]]:
    """The valid hosts of a SOM, and what is wrong with the rest; `services`: their names."""
    hosts: List[Host] = []
    errors: List[ModelError] = []
    for name, value in entry.items():
        try:
            hosts.append(_host(name, value, services))
        except ModelError as error:
            errors += error.errors
    return hosts, errors


def check_hosts(service: Service, entry: Entry, hosts: Collection[str]) -> None:
    """Raises ModelError if a service names a computer that is none of `hosts`, or forbids all."""
    placement = service.placement
    placed = (*placement.prefer, *placement.forbid)
    for key, names in ("host", (service.host,)), ("placement", placed):
        for name in names if key in entry else ():
            if name not in hosts:
                known = listed(sorted(hosts)) or "there are none"
                raise entry[key].error(f"{key} names {name!a}, which is none of the hosts: {known}")
    if hosts and set(hosts) == set(placement.forbid):
        raise entry["placement"].error("it forbids every host: a substitute could run nowhere")


def _host(name: str, value: Value, services: Collection[str]) -> Host:
    if not _NAME.match(name):
        raise value.error(f"the name of a host must be written like raspberry_pi, not {name!a}")
    if name in services:
        raise value.error(f"{name} is a service as well: what fails with it could not be told")
    what = f"the host {name}"
    entry, errors = value.mapping(what), list(value.wrong_keys(what, HOST))
    given = read_keys(entry, HOST, errors)
    if errors:
        raise ModelErrors(errors)
    return Host(name, **given)
