"""The row of a service in the document."""
from typing import Any, Dict, Optional, Sequence, Tuple

from shsa_core.model.ontology import Ontology
from shsa_core.model.service import Service
from shsa_learning.doctor import fate_of
from shsa_view.facts import Figures, Running, Substitute
from shsa_view.judgement import Judgement

Document = Dict[str, Any]


def place_of(service: Optional[Service], running: Optional[Running]) -> Tuple[str, str]:
    """Return the topic and the node of a service: of the running SOM, else of the file's."""
    if running is not None:
        return running.topic, running.node
    return (service.topic, service.node) if service is not None else ("", "")


def service_row(
    service: Optional[Service],
    running: Optional[Running],
    judged: Judgement,
    duties: Optional[str],
) -> Document:
    """Return the row of a service without its values.

    `duties`: what its node does beyond the SOM; None: not known.
    """
    topic, node = place_of(service, running)
    period = service.period if service is not None else None
    return {
        "topic": topic,
        "type": service.type if service else "",
        "needed": running.needed if running else bool(service and service.needed),
        "standby": service.standby.value if service else "",
        "period": running.period or None if running else period,
        "host": service.host if service else "",
        "node": node,
        "state": judged.condition.value,
        "detail": judged.detail,
        "publisher": judged.publisher,
        "fate": ""
        if service is None or duties is None
        else fate_of(service, [duties] if duties else []),
    }


def values_of(
    ontology: Ontology,
    service: Optional[Service],
    active: Optional[Substitute],
    figures: Optional[Figures],
    judged: Judgement,
) -> Document:
    """Return rate and values of a service, each with the expected error of its publisher."""
    properties: Document = {}
    for source in service.sources if service else ():
        provision = source.provision
        error = provision.error
        rms, p95 = (error.rms, error.p95) if error else (None, None)
        if active is not None:
            place = active.outputs.index(source.path) if source.path in active.outputs else -1
            rms, p95 = _at(active.error_rms, place), _at(active.error_p95, place)
        known = ontology.properties.get(source.property)
        properties[source.property] = {
            "field": provision.field,
            "unit": known.unit if known else "",
            "symbol": known.symbol if known else "",
            "value": figures.values.get(source.property) if figures else None,
            "error_rms": rms,
            "error_p95": p95,
            "range": list(provision.range) if provision.range else None,
        }
    return {
        "substitute": active.node if active else None,
        "rate": figures.rates.get(judged.publisher or "") if figures else None,
        "bridged": figures.bridged if figures else 0,
        "weakened": figures.weakened if figures else "",
        "properties": properties,
    }


def _at(errors: Sequence[Optional[float]], place: int) -> Optional[float]:
    return errors[place] if 0 <= place < len(errors) else None
