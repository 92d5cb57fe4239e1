"""A SOM as plain mappings, lists and values: as it lies on the parameter server, and in a file."""
from typing import Any, Dict, Iterable, Optional

from shsa_core.files.error_values import plain_error
from shsa_core.files.som_values import check_names
from shsa_core.model.checks import LEARNED, Check, Checks, Limit, default_limit
from shsa_core.model.field import tells_of_nothing
from shsa_core.model.host import Host, Placement
from shsa_core.model.kinds import OnPartition, Others
from shsa_core.model.service import AdaptiveDeadline, Provision, Service
from shsa_core.model.som import Som


def som_parameters(som: Som) -> Dict[str, object]:
    """A SOM as it lies on the parameter server: mappings, lists and values, and no command."""
    plain: Dict[str, object] = {"hosts": hosts_parameters(som)} if som.hosts else {}
    plain["services"] = {service.name: service_parameters(service) for service in som}
    return plain


def hosts_parameters(som: Som) -> Dict[str, object]:
    """The hosts of a SOM as they lie on the parameter server."""
    return {host.name: host_parameters(host) for host in som.hosts.values()}


def host_parameters(host: Host) -> Dict[str, float]:
    """A host as it lies on the parameter server."""
    given = {"cores": host.cores, "link": host.link}
    return {key: value for key, value in given.items() if value is not None}


def service_parameters(service: Service) -> Dict[str, Any]:
    """A service as it lies on the parameter server."""
    plain: Dict[str, Any] = {
        "topic": service.heard,
        "type": service.type,
        "node": service.node,
        "period": "none" if service.period is None else service.period,
        "needed": service.needed,
        "standby": str(service.standby),
        "policy": str(service.policy),
        "provides": {p.property: _provision_parameters(p, service.type) for p in service.provides},
    }
    checks: Dict[str, object] = _check_parameters(service.checks.each, of_values=False)
    for name in ("bad", "of", "recovery", "intermittent"):
        if getattr(service.checks, name) != getattr(Checks, name):
            checks[name] = getattr(service.checks, name)
    optional = {
        "deadline": _plain_deadline(service),
        "gate": service.topic if service.gated else "",
        "fails_with": list(service.fails_with),
        "fault_tolerant_time": service.fault_tolerant_time,
        "derived_from": list(service.derived_from),
        "checks": checks,
        "last_resort": {"values": dict(service.last_resort.values)},
        "contain": None if service.contain is None else str(service.contain),
        "others": str(service.others) if service.others is not Others.UNKNOWN else "",
        "latched": service.latched,
        "host": service.host,
        "placement": _placement_parameters(service.placement),
        "on_partition": str(service.on_partition)
        if service.on_partition is not OnPartition.HEAL
        else "",
    }
    if not service.last_resort.values:
        del optional["last_resort"]
    plain.update({key: value for key, value in optional.items() if value})
    if service.bridge is not None:
        plain["bridge"] = service.bridge or False
    return plain


def _plain_deadline(service: Service) -> object:
    deadline = service.deadline
    if isinstance(deadline, AdaptiveDeadline):
        return {"false_alarms": deadline.false_alarms}
    return deadline


def _placement_parameters(placement: Placement) -> Dict[str, object]:
    given = {"prefer": list(placement.prefer), "forbid": list(placement.forbid)}
    return {key: value for key, value in given.items() if value}


def _provision_parameters(provision: Provision, message_type: str) -> Dict[str, object]:
    plain: Dict[str, object] = {"field": provision.field}
    error = provision.error
    if error is None or provision.quality != error.quality:  # else the error says it
        plain["quality"] = provision.quality
    distance = tells_of_nothing(message_type, provision.field)
    checks = _check_parameters(provision.checks, True, distance)
    if provision.range is not None:
        plain["range"] = list(provision.range)
    if error is not None:
        plain["error"] = plain_error(error)
    if not provision.calibrate:
        plain["calibrate"] = False
    if checks:
        plain["checks"] = checks
    return plain


def _check_parameters(
    checks: Iterable[Check], of_values: bool, distance: bool = False
) -> Dict[str, object]:
    """What differs from the defaults."""
    given = {check.kind.value: _plain(check.limit) for check in checks}
    return {
        name: given.get(name, False)
        for name in check_names(of_values)
        if given.get(name) != _plain(default_limit(name, distance))
    }


def _plain(limit: Optional[Limit]) -> Optional[Limit]:
    """A limit as it is written; what is learned has no number."""
    return True if limit == LEARNED else limit
