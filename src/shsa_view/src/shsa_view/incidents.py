"""The incidents that are shown: those of the log, and those that are told as they happen."""
from typing import Any, Dict, Iterable, List, Optional, Set, Tuple

from shsa_learning.incident_log import MOMENTS, SAME_S
from shsa_core.healing.incident import Incident, State
from shsa_core.text import shown
from shsa_view.plain import code, number, texts

MOST = 200
"""So many are kept, the newest."""
WITHOUT = (State.HEALING, State.UNHEALED, State.SAFE)
"""While an incident is so, what its topic told of is lost."""

Document = Dict[str, Any]


class Incidents:
    """The newest incidents by their keys; a key is unique over restarts of everything."""

    def __init__(self) -> None:
        self._known: Dict[str, Incident] = {}
        self._documents: Dict[str, Document] = {}
        self._open: Dict[str, str] = {}
        self._changed: Set[str] = set()

    def add(self, incident: Incident, logged: bool = False) -> None:
        """Take a step of an incident. `logged`: it may be older than what was told of it."""
        key, service = self._key(incident), incident.service
        if logged and key in self._known:
            return
        if self._known.get(key) != incident:
            self._known[key] = incident
            self._documents[key] = as_document(key, incident)
            self._changed.add(key)
        if incident.state is State.ENDED or logged:
            if self._open.get(service) == key:
                del self._open[service]
        else:
            self._open[service] = key
        if len(self._known) > MOST:
            self._forget(min(self._known, key=lambda each: self._known[each].detected))

    def open_of(self, service: str) -> Optional[Tuple[str, Incident]]:
        """Return the incident of a service that has not ended, and its key."""
        key = self._open.get(service)
        return None if key is None else (key, self._known[key])

    def known(self) -> Iterable[Tuple[str, Incident]]:
        """Return all of them by their keys."""
        return self._known.items()

    def leave_open(self) -> Set[str]:
        """Nobody works on any of them, until it is told again. Returns the services concerned."""
        services, self._open = set(self._open), {}
        return services

    def newest_first(self) -> List[Document]:
        """Return all of them."""
        order = sorted(self._known, key=lambda key: self._known[key].detected, reverse=True)
        return [self._documents[key] for key in order]

    def take_changed(self) -> List[Document]:
        """Return those that changed since this was asked last, the newest first."""
        changed, self._changed = self._changed, set()
        return [each for each in self.newest_first() if each["key"] in changed]

    def _key(self, incident: Incident) -> str:
        for key, known in self._known.items():
            same = (known.id, known.service) == (incident.id, incident.service)
            if same and abs(known.detected - incident.detected) < SAME_S:
                return key
        return f"{incident.detected * 1e3:.0f}-{incident.id}"

    def _forget(self, key: str) -> None:
        incident = self._known.pop(key)
        del self._documents[key]
        if self._open.get(incident.service) == key:
            del self._open[incident.service]


def as_document(key: str, incident: Incident) -> Document:
    """Return an incident as it is shown."""
    properties = texts(incident.properties)
    errors = incident.errors
    return {
        "key": key,
        "id": incident.id,
        "service": shown(incident.service),
        "topic": shown(incident.topic),
        "properties": properties,
        "faulty_node": shown(incident.faulty_node),
        "kind": incident.kind.value,
        "evidence": shown(incident.evidence),
        "detail": shown(incident.detail),
        "state": incident.state.value,
        "moments": {name: number(getattr(incident, name)) for name in MOMENTS},
        "substitute": shown(incident.substitute) or None,
        "inputs": texts(incident.inputs),
        "outputs": texts(incident.outputs),
        "relations": texts(incident.relations),
        "code": code(incident.code),
        "quality": number(incident.quality),
        "error_rms": [number(each.rms) if each else None for each in errors],
        "error_p95": [number(each.p95) if each else None for each in errors],
        "missing": texts(incident.missing),
        "unavailable": texts(incident.unavailable),
        "decision": shown(incident.decision),
        "restarts": incident.restarts,
        "kept": incident.kept,
        "kept_out": incident.kept_out,
        "lost": properties if incident.state in WITHOUT else [],
    }
