"""The incidents that are shown: those of the log, and those that are told as they happen."""
from typing import Any, Dict, List, Mapping, Optional, Set

from shsa_core.healing.incident import State
from shsa_view.plain import code_at, items_at, number, text_at, texts_at

MOST = 200
"""So many are kept, the newest."""
SAME_S = 1.0
"""A moment is told by two looks at two clocks: more than this apart it is another incident's."""
MOMENTS = (
    *("last_good", "detected", "killed", "found"),
    *("spawned", "first_message", "returned", "ended"),
)
OVER = (State.ENDED.value,)
WITHOUT = (State.HEALING.value, State.UNHEALED.value, State.SAFE.value)
"""While an incident is so, what its topic told of is lost."""

Document = Dict[str, Any]


class Incidents:
    """The newest incidents by their keys; a key is unique over restarts of everything."""

    def __init__(self) -> None:
        self._rows: Dict[str, Document] = {}
        self._open: Dict[str, str] = {}
        self.changed: Set[str] = set()

    def add(self, record: Mapping[str, Any], logged: bool = False) -> Optional[str]:
        """Take a step of an incident. Returns its service; None if it is no incident."""
        document = as_document(record)
        detected = document["moments"]["detected"]
        if detected is None or not document["service"] or document["id"] is None:
            return None
        key = self._known(document, detected) or f"{detected * 1e3:.0f}-{document['id']}"
        document["key"] = key
        if logged and key in self._open.values():
            return None
        service: str = document["service"]
        if self._rows.get(key) != document:
            self._rows[key] = document
            self.changed.add(key)
        if document["state"] in OVER or logged:
            if self._open.get(service) == key:
                del self._open[service]
        else:
            self._open[service] = key
        while len(self._rows) > MOST:
            oldest = self.newest_first()[-1]["key"]
            del self._rows[oldest]
        return service

    def open_of(self, service: str) -> Optional[Document]:
        """The incident of a service that has not ended."""
        return self._rows.get(self._open.get(service, ""))

    def newest_first(self) -> List[Document]:
        """All of them."""
        return sorted(self._rows.values(), key=_when, reverse=True)

    def take_changed(self) -> List[Document]:
        """Those that changed since this was asked last."""
        keys, self.changed = self.changed, set()
        return [each for each in self.newest_first() if each["key"] in keys]

    def _known(self, document: Document, detected: float) -> Optional[str]:
        for key, row in self._rows.items():
            same = row["id"] == document["id"] and row["service"] == document["service"]
            if same and abs(row["moments"]["detected"] - detected) < SAME_S:
                return key
        return None


def _when(document: Document) -> float:
    return float(document["moments"]["detected"])


def as_document(record: Mapping[str, Any]) -> Document:
    """An incident as it is shown, of what a line of the log has; what is not valid is left out."""
    errors = [each if isinstance(each, dict) else {} for each in items_at(record, "errors")]
    id_ = number(record.get("id"))
    state, properties = text_at(record, "state"), texts_at(record, "properties")
    return {
        "key": "",
        "id": None if id_ is None else int(id_),
        "service": text_at(record, "service"),
        "topic": text_at(record, "topic"),
        "faulty_node": text_at(record, "faulty_node"),
        "kind": text_at(record, "kind"),
        "detail": text_at(record, "detail"),
        "state": state,
        "moments": {name: number(record.get(name)) for name in MOMENTS},
        "substitute": text_at(record, "substitute") or None,
        "inputs": texts_at(record, "inputs"),
        "outputs": texts_at(record, "outputs"),
        "relations": texts_at(record, "relations"),
        "code": code_at(record, "code"),
        "quality": number(record.get("quality")),
        "error_rms": [number(each.get("rms")) for each in errors],
        "error_p95": [number(each.get("p95")) for each in errors],
        "missing": texts_at(record, "missing"),
        "decision": text_at(record, "decision"),
        "restarts": int(number(record.get("restarts")) or 0),
        "kept_out": record.get("kept_out") is True,
        "properties": properties,
        "lost": properties if state in WITHOUT else [],
    }
