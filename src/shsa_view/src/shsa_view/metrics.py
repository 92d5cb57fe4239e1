"""The state of the robot as text for Prometheus."""
from typing import Any, Dict, Iterator, List, Mapping, Optional, Tuple

from shsa_view.judgement import Condition

Document = Dict[str, Any]
Labels = Mapping[str, str]
Line = Tuple[Labels, Optional[float]]

HELP: Mapping[str, str] = {
    "shsa_up": "1 while a part of healing is heard",
    "shsa_service_state": "1 for the state that a service has, 0 for the others",
    "shsa_service_rate_hertz": "messages a second of the publisher of a service",
    "shsa_service_late_total": "late messages that a hot substitute filled in for",
    "shsa_value": "newest value, in the unit of its property",
    "shsa_value_error": "error of a value that is not exceeded in 95 % of the time",
    "shsa_incidents_open": "incidents that have not ended",
    "shsa_incidents": "incidents that are remembered, by service and kind",
}


def text(document: Document) -> str:
    """Return the metrics of a state; what is not known is left out."""
    lines: List[str] = []
    for name, told in HELP.items():
        kind = "counter" if name.endswith("_total") else "gauge"
        lines += [f"# HELP {name} {told}", f"# TYPE {name} {kind}"]
        for labels, value in _LINES[name](document):
            if value is not None:
                lines.append(f"{name}{_labels(labels)} {value:.9g}")
    return "\n".join(lines) + "\n"


def _labels(labels: Labels) -> str:
    told = ",".join(f'{name}="{_escaped(value)}"' for name, value in labels.items())
    return f"{{{told}}}" if told else ""


def _escaped(value: str) -> str:
    return value.replace("\\", "\\\\").replace('"', '\\"').replace("\n", "\\n")


def _up(document: Document) -> Iterator[Line]:
    for part, state in document["healing"].items():
        if part != "text":
            yield {"part": part}, float(state == "alive")


def _states(document: Document) -> Iterator[Line]:
    for name, row in document["services"].items():
        for state in Condition:
            labels = {"service": name, "topic": row["topic"], "state": state.value}
            yield labels, float(row["state"] == state.value)


def _rates(document: Document) -> Iterator[Line]:
    for name, row in document["services"].items():
        yield {"service": name, "topic": row["topic"]}, row["rate"]


def _late(document: Document) -> Iterator[Line]:
    for name, row in document["services"].items():
        yield {"service": name, "topic": row["topic"]}, float(row["bridged"])


def _values(document: Document, key: str) -> Iterator[Line]:
    for name, row in document["services"].items():
        for each, prop in row["properties"].items():
            yield {"service": name, "property": each, "unit": prop["unit"]}, prop[key]


def _open(document: Document) -> Iterator[Line]:
    yield {}, float(sum(row["incident"] is not None for row in document["services"].values()))


def _incidents(document: Document) -> Iterator[Line]:
    counts: Dict[Tuple[str, str], int] = {}
    for each in document["incidents"]:
        of = each["service"], each["kind"]
        counts[of] = counts.get(of, 0) + 1
    for (service, kind), count in sorted(counts.items()):
        yield {"service": service, "kind": kind}, float(count)


_LINES = {
    "shsa_up": _up,
    "shsa_service_state": _states,
    "shsa_service_rate_hertz": _rates,
    "shsa_service_late_total": _late,
    "shsa_value": lambda document: _values(document, "value"),
    "shsa_value_error": lambda document: _values(document, "error_p95"),
    "shsa_incidents_open": _open,
    "shsa_incidents": _incidents,
}
