"""An incident as one HTML page that needs nothing else."""
from datetime import datetime, timezone
from pathlib import Path
from typing import Any, Dict, List, NamedTuple, Optional, Sequence, Tuple

from shsa_learning.cli._common import render
from shsa_core.errors import ShsaError
from shsa_core.healing.incident import Incident
from shsa_core.model.error import Error
from shsa_core.model.ontology import Ontology
from shsa_core.model.som import Som
from shsa_learning.cli._explain_pictures import comparison, timeline
from shsa_learning.explain.bag import BagIncidents, Values, read_published
from shsa_learning.explain.searched import Found, Search, search_again
from shsa_learning.explain.truth import Truth, compare
from shsa_learning.explain.words import KINDS, duration, figure, steps, summary, title
from shsa_learning.recordings.bags import read_bag
from shsa_learning.recordings.recording import Recording

Cells = Tuple[str, ...]
TEMPLATES = Path(__file__).resolve().parent / "templates"


class Record:
    """A record and its models; what several pages need is read once."""

    def __init__(self, path: str, told: Any, models: Optional[Tuple[Ontology, Som]]) -> None:
        self.path = path
        self.bag: Optional[BagIncidents] = told if isinstance(told, BagIncidents) else None
        self.models = models
        self._recording: Optional[Recording] = None

    @property
    def recording(self) -> Recording:
        """The values of the services. Raises ShsaError, with why, if they are not known."""
        if self.bag is None:
            raise ShsaError("the incident log has no values; a rosbag of the run has")
        if self.models is None:
            raise ShsaError("--ontology and --som are not given, which tell what the topics mean")
        if self._recording is None:
            self._recording = read_bag(self.path, self.models[1])
        return self._recording


class Compared(NamedTuple):
    """The figures and the picture of how true one value was."""

    property: str
    verdict: str
    figures: Sequence[Cells]
    picture: str


def page(record: Record, incident: Incident) -> str:
    """Return the page of an incident."""
    compared, not_compared = _compared(record, incident)
    search, not_searched = _searched(record, incident)
    return render(
        TEMPLATES / "explain.html",
        title=title(incident),
        record=record.path,
        begun=moment(incident.detected),
        summary=summary(incident),
        timeline=timeline(incident),
        steps=[(name, "–" if at is None else duration(at)) for name, at in steps(incident)],
        failed=_failed(incident),
        believed=_believed(record, incident),
        search=search,
        not_searched=not_searched,
        ran=_ran(incident),
        code=incident.code,
        compared=compared,
        not_compared=not_compared,
    )


def index(record: str, pages: Sequence[Tuple[str, Incident]]) -> str:
    """Return the page that lists others, newest first."""
    rows = [
        (name, str(each.id), moment(each.detected), title(each), each.substitute, str(each.state))
        for name, each in reversed(pages)
    ]
    return render(TEMPLATES / "explain_index.html", record=record, rows=rows)


def moment(seconds: float) -> str:
    """Return a time of the wall clock, in UTC; one of a simulation in s."""
    try:
        return datetime.fromtimestamp(seconds, timezone.utc).strftime("%Y-%m-%d %H:%M:%S UTC")
    except (OverflowError, ValueError, OSError):
        return f"{seconds:.3f} s"


def _failed(incident: Incident) -> Sequence[Cells]:
    return (
        ("service", incident.service),
        ("topic", incident.topic),
        ("properties", ", ".join(incident.properties)),
        ("node", incident.faulty_node or "not known"),
        ("last good message", "none" if incident.last_good is None else moment(incident.last_good)),
    )


def _believed(record: Record, incident: Incident) -> Sequence[str]:
    said = [f"{incident.kind}: {KINDS[incident.kind]}."]
    if incident.evidence:
        said.append(f"What was seen: {_ended(incident.evidence)}")
    for each in record.bag.evidence(incident) if record.bag is not None else ():
        late = duration(each.time - (incident.last_good or incident.detected))
        said.append(
            f"{late} after the last good message /shsa/failures told of {each.publisher}: "
            f"{each.kind}, {_ended(each.detail)}"
        )
    if incident.decision:
        said.append(f"What was decided about the node: {_ended(incident.decision)}")
    return said


def _ended(sentence: str) -> str:
    return sentence.rstrip(".") + "."


def _searched(record: Record, incident: Incident) -> Tuple[Dict[str, Any], str]:
    if record.models is None:
        return {}, "--ontology and --som are not given"
    try:
        search = search_again(*record.models, incident)
    except ShsaError as error:
        return {}, str(error)
    return {"answer": search.answer, "properties": _properties(search, record.models[0])}, ""


def _properties(search: Search, ontology: Ontology) -> List[Dict[str, Any]]:
    return [
        {
            "name": each.property,
            "rows": [_row(found, _unit(ontology, each.property)) for found in each.found],
            "complete": each.complete,
            "dead": each.dead,
        }
        for each in search.properties
    ]


def _row(found: Found, unit: str) -> Dict[str, Any]:
    return {
        "by": ", ".join(found.relations) or "the same property elsewhere",
        "inputs": ", ".join(found.inputs) or "constants",
        "quality": f"{found.quality:.3g}",
        "error": _error(found.error, unit),
        "ran": found.ran,
        "why_not": found.why_not,
    }


def _error(error: Optional[Error], unit: str) -> str:
    return "not known" if error is None else f"{figure(error.rms, unit)} RMS"


def _ran(incident: Incident) -> Sequence[Cells]:
    if not incident.code:
        return ()
    rows = [
        ("node", incident.substitute or "none: it was only advised"),
        ("relations", ", ".join(incident.relations) or "the same property elsewhere"),
        ("inputs", ", ".join(incident.inputs) or "constants"),
        ("outputs", ", ".join(incident.outputs)),
        ("quality", figure(incident.quality)),
    ]
    for path, error in zip(incident.outputs, incident.errors):
        promised = "not known"
        if error is not None:
            promised = f"{figure(error.rms)} RMS, within {figure(error.p95)} in 95 % of the time"
        rows.append((f"expected error of {path}", promised))
    for path, gain, offset in zip(incident.outputs, incident.gains, incident.offsets):
        if (gain, offset) != (1.0, 0.0):
            rows.append((f"calibration of {path}", f"{gain:.4g} * computed + {offset:.4g}"))
    return rows


def _compared(record: Record, incident: Incident) -> Tuple[List[Compared], str]:
    try:
        recording = record.recording
        assert record.models is not None
        ontology, som = record.models
        truths = compare(som, incident, recording)
        published = read_published(record.path, incident) if incident.substitute else {}
    except ShsaError as error:
        return [], str(error)
    outputs = dict(zip((truth.property for truth in truths), incident.outputs))
    return [
        _picture(incident, truth, published.get(outputs[truth.property]), ontology, recording.end)
        for truth in truths
    ], ""


def _picture(
    incident: Incident, truth: Truth, published: Optional[Values], ontology: Ontology, end: float
) -> Compared:
    unit = _unit(ontology, truth.property)
    expected = truth.expected
    rows: List[Cells] = [("", "measured", "expected")]
    for name, key in (("RMS error", "rms"), ("within, in 95 % of the time", "p95")):
        promised = figure(None if expected is None else getattr(expected, key), unit)
        rows.append((name, figure(getattr(truth.error, key), unit), promised))
    rows.append(("mean error", figure(truth.error.bias, unit), ""))
    rows.append(("who always says the mean", figure(truth.error.baseline, unit), ""))
    rows.append(("values compared", str(truth.error.n), ""))
    if truth.within is not None:
        rows.append(("within what was expected in 95 %", f"{100.0 * truth.within:.0f} %", "95 %"))
    picture = comparison(incident, truth, published, unit, end)
    return Compared(truth.property, truth.verdict, rows, picture)


def _unit(ontology: Ontology, name: str) -> str:
    known = ontology.properties.get(name)
    return "" if known is None or not known.unit else str(known.unit)
