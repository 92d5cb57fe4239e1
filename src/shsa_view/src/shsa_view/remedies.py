"""Remedies for a service that is not well: in words, with commands to type."""
import shlex
from typing import Any, Dict, Iterator, List, Optional, Tuple

from shsa_core.healing.incident import Incident
from shsa_core.model.kinds import Kind
from shsa_core.model.service import Service
from shsa_core.text import shown
from shsa_view.judgement import Condition, Judgement

Document = Dict[str, Any]
WELL = (Condition.WELL, Condition.STARTING)
BACK = (Condition.RETURNING,)
ENDED = (Kind.NODE_GONE, Kind.NEVER_PUBLISHED)


def why(judged: Judgement, incident: Optional[Incident]) -> str:
    """Return why a service is as it is: what was seen, and the limit."""
    evidence = shown(incident.evidence) if incident is not None else ""
    if judged.condition in WELL:
        return judged.detail
    return evidence or judged.detail


def remedies(
    service: Optional[Service],
    judged: Judgement,
    incident: Optional[Incident],
    command: str,
    namespace: str = "/",
) -> List[Document]:
    """Return what to do, in order. `command`: what the service's node was started by, or empty."""
    if service is None or judged.condition in (*WELL, *BACK):
        return []
    told = _told(service, incident, command, namespace)
    return [{"text": text, "command": typed} for text, typed in told]


def _told(
    service: Service, incident: Optional[Incident], command: str, namespace: str
) -> Iterator[Tuple[str, str]]:
    node = incident.faulty_node if incident is not None else service.node
    gone = incident is None or incident.kind in ENDED or incident.killed is not None
    if incident is not None and incident.kept_out:
        release = f"rosservice call {namespace}shsa/release {shlex.quote(service.topic)}"
        yield f"{node} is kept out. Repair it and restart healing, or, by operator:=true:", release
    if not gone:
        yield f"End {node}, if it does not recover:", f"rosnode kill {shlex.quote(node)}"
    if command:
        yield f"Start {node} again:", command
    else:
        yield f"Start {node} again, as you started it: its command is not known here.", ""
    where = _line(service, incident)
    if where:
        yield f"Or correct the limit, if {node} is right:", where
    if incident is not None and incident.missing:
        yield f"Bring back what a substitute needs: {', '.join(incident.missing[:5])}.", ""


def _line(service: Service, incident: Optional[Incident]) -> str:
    """Return the line of the SOM that has the limit, as file and line; empty: it has none."""
    if incident is None or incident.kind in ENDED:
        return ""
    text = incident.evidence
    lines = (each.where for each in service.provides if text.startswith(each.property))
    return shown(next(lines, "") or service.where)
