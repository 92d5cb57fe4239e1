"""A SOM as plain mappings, lists and values: as it lies on the parameter server, and in a file."""
from typing import Any, Dict, Iterable

from shsa_core.files.som_values import check_names
from shsa_core.model.checks import REGISTRY, Check, Checks
from shsa_core.model.service import Provision, Service
from shsa_core.model.som import Som


def som_parameters(som: Som) -> Dict[str, object]:
    """A SOM as it lies on the parameter server: mappings, lists and values, and no command."""
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
        for name in check_names(of_values)
        if given.get(name) != REGISTRY[name].default
    }
