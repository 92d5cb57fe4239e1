"""Values of the last minutes and states of the last hour, the latter as CSV as well."""
import csv
import io
from collections import deque
from typing import Any, Deque, Dict, Iterable, Iterator, List, Mapping, NamedTuple, Optional, Tuple

from shsa_core.healing.incident import Incident
from shsa_view.judgement import LETTERS, Condition

SAMPLES_S = 300.0
"""Values are kept for so long."""
HOUR_S = 3600.0
"""States are kept for so long."""
MOST_RUNS = 1000
"""Changes of state that are kept of a service."""
AROUND_S = 60.0
"""Values are kept longer that came so much before and after an incident was detected."""
MOST_CLIPS = 40
SHOWN = (
    *(Condition.WELL, Condition.SUBSTITUTED, Condition.HEALING),
    *(Condition.NOT_HEALED, Condition.UNKNOWN),
)
WORDS: Mapping[str, str] = {LETTERS[each]: each.value for each in SHOWN}

Document = Dict[str, Any]
Witnesses = Mapping[str, Mapping[str, float]]
"""By property and relation: the value that follows from other services."""


class Sample(NamedTuple):
    """A second of a service; values and errors are by property."""

    time: float
    substituted: bool
    values: Mapping[str, Optional[float]]
    errors: Mapping[str, Optional[float]]
    witnesses: Witnesses


class History:
    """Samples of each service, one a second, and those around each of the newest incidents."""

    def __init__(self) -> None:
        self._begin()

    def _begin(self) -> None:
        self._samples: Dict[str, Deque[Sample]] = {}
        self._runs: Dict[str, Deque[Tuple[float, str]]] = {}
        self._clips: Dict[str, List[Sample]] = {}
        self._last = 0.0

    def second(self, now: float, name: str, row: Document, witnesses: Witnesses) -> None:
        """Take a sample of a service; time that runs backwards begins anew."""
        if now < self._last:
            self._begin()
        self._last = now
        properties = row["properties"].items()
        samples = self._samples.setdefault(name, deque())
        samples.append(
            Sample(
                now,
                row["substitute"] is not None,
                {each: prop["value"] for each, prop in properties},
                {each: _error(prop) for each, prop in properties},
                witnesses,
            )
        )
        while samples[0].time < now - SAMPLES_S:
            samples.popleft()
        runs, letter = self._runs.setdefault(name, deque(maxlen=MOST_RUNS)), LETTERS[row["state"]]
        if not runs or runs[-1][1] != letter:
            runs.append((now, letter))
        while len(runs) > 1 and runs[1][0] < now - HOUR_S:
            runs.popleft()

    def cut(self, now: float, incidents: Iterable[Tuple[str, Incident]]) -> None:
        """Keep the values around incidents that have become old enough."""
        for key, incident in incidents:
            began = incident.detected
            old_enough = began + AROUND_S <= now <= began + AROUND_S + SAMPLES_S
            if key not in self._clips and old_enough and incident.service in self._samples:
                samples = self._samples[incident.service]
                kept = [each for each in samples if abs(each.time - began) <= AROUND_S]
                if kept:
                    self._clips[key] = kept
        while len(self._clips) > MOST_CLIPS:
            del self._clips[next(iter(self._clips))]

    def knows(self, name: str) -> bool:
        """Return true if there is a sample of a service."""
        return name in self._samples

    def values(self, name: str, key: str = "") -> Document:
        """Return the values of a service: the newest, or those around an incident, by its key."""
        samples = self._clips.get(key) or list(self._samples.get(name, ()))
        properties = {each for sample in samples for each in sample.values}
        return {
            "service": name,
            "incident": key if key in self._clips else None,
            "times": [round(each.time, 3) for each in samples],
            "substituted": [each.substituted for each in samples],
            "properties": {each: _column(each, samples) for each in sorted(properties)},
        }

    def timeline(self, now: float, incidents: Iterable[Document]) -> Document:
        """Return the states of all services, as `[since, state]`, and the incidents of the hour."""
        since = now - HOUR_S
        begun = (each for each in incidents if (each["moments"]["detected"] or 0.0) >= since)
        return {
            "now": now,
            "since": since,
            "services": {
                name: [[max(since, at), WORDS[letter]] for at, letter in runs]
                for name, runs in sorted(self._runs.items())
            },
            "incidents": [
                {
                    **{name: each[name] for name in ("key", "service", "kind", "state")},
                    "from": each["moments"]["detected"],
                    "to": each["moments"]["ended"],
                }
                for each in begun
            ],
        }


def as_csv(timeline: Mapping[str, Any]) -> str:
    """Return a timeline as CSV: a line for each state of a service, and for each incident."""
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(("what", "service", "from", "to", "state"))
    writer.writerows(_lines(timeline))
    return text.getvalue()


def _lines(timeline: Mapping[str, Any]) -> Iterator[Tuple[Any, ...]]:
    for name, runs in timeline["services"].items():
        ends = [*(run[0] for run in runs[1:]), timeline["now"]]
        for (since, state), end in zip(runs, ends):
            yield "state", _cell(name), since, end, state
    for each in timeline["incidents"]:
        yield "incident", _cell(each["service"]), each["from"], each["to"], each["kind"]


def _cell(text: str) -> str:
    """Return a text that no spreadsheet takes for a formula."""
    return f"'{text}" if text[:1] in "=+-@" else text


def _column(name: str, samples: Iterable[Sample]) -> Document:
    rows = list(samples)
    relations = {each for row in rows for each in row.witnesses.get(name, ())}
    return {
        "values": [row.values.get(name) for row in rows],
        "errors": [row.errors.get(name) for row in rows],
        "witnesses": {
            each: [row.witnesses.get(name, {}).get(each) for row in rows]
            for each in sorted(relations)
        },
    }


def _error(prop: Document) -> Optional[float]:
    found = prop["error_p95"] if prop["error_p95"] is not None else prop["error_rms"]
    return None if found is None else float(found)
