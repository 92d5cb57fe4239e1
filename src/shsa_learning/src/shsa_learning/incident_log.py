"""Incidents as healing told them: in the lines of its log, and in messages."""
import os
from dataclasses import MISSING, fields
from math import isfinite
from typing import Any, Dict, Iterable, List, NamedTuple, Optional, Sequence, Tuple

from shsa_core.errors import ModelError, listed
from shsa_core.files.regular import open_to_read
from shsa_core.healing.incident import Incident, State
from shsa_core.journal.codec import Codec
from shsa_core.journal.lines import read_line
from shsa_core.model.error import Error
from shsa_core.model.kinds import Kind

MOMENTS = (
    *("last_good", "detected", "killed", "found"),
    *("spawned", "first_message", "returned", "ended"),
)
"""The eight moments of an incident, in their usual order."""
MOST_BYTES = 20_000_000
"""Of a longer log only so many at its end are read."""
SAME_S = 1.0
"""Incidents of one service and number are one if they were detected within so much of another."""
LATEST_S = 2.0**32
"""Times of ROS are before."""
MOST_NOTES = 3
"""Of more lines that are no incident, the count is told."""
REQUIRED = [
    each.name
    for each in fields(Incident)
    if each.default is MISSING and each.default_factory is MISSING
]
_CODEC = Codec(Incident)
_TEXTS = ("service", "topic", "faulty_node", "evidence", "detail", "substitute", "code", "decision")
_LISTS = ("properties", "inputs", "outputs", "relations", "gains", "offsets", "missing")


class Log(NamedTuple):
    """The incidents, in the order in which they were detected, and what could not be read."""

    incidents: Tuple[Incident, ...]
    notes: Tuple[str, ...]


def read_log(path: str) -> Log:
    """The incidents of `shsa_incidents.jsonl`, moments in s of ROS time; the last line of each.

    A line that is none is left out and told in the notes: who writes it may have been killed, or
    have been of another version. Raises ModelError if the file cannot be read, or if none of its
    lines is an incident.
    """
    with open_to_read(path) as file:
        size = os.fstat(file.fileno()).st_size
        notes: List[str] = []
        if size > MOST_BYTES:
            notes.append(f"{path}: only the last {MOST_BYTES} of {size} bytes were read")
            file.seek(size - MOST_BYTES)
            file.readline()
        try:
            lines = file.read(MOST_BYTES).split(b"\n")
        except OSError as error:
            raise ModelError(path, f"cannot be read: {error}") from error
    found: List[Incident] = []
    wrong: List[str] = []
    for number, line in enumerate(lines, 1):
        if line.strip():
            try:
                found.append(of_line(line, f"{path}:{number}"))
            except ModelError as error:
                wrong.append(str(error) if len(wrong) < MOST_NOTES else "")
    if wrong and not found:
        raise ModelError(path, f"is no incident log: none of its lines is an incident; {wrong[0]}")
    notes += wrong[:MOST_NOTES]
    if len(wrong) > MOST_NOTES:
        notes.append(f"{path}: {len(wrong) - MOST_NOTES} more lines are no incidents")
    return Log(newest(found), tuple(notes))


def of_line(line: bytes, where: str) -> Incident:
    """The incident that a line of the log is. Raises ModelError, with `where`."""
    data = read_line(line, where)
    data.pop("outage", None)  # it follows from the moments
    missing = [name for name in REQUIRED if name not in data]
    if missing:
        raise ModelError(where, f"is no incident: it lacks {listed(missing)}")
    incident: Incident = _CODEC.decode(data, where, "incident")
    moments = [getattr(incident, name) for name in MOMENTS]
    if not all(0.0 <= each <= LATEST_S for each in moments if each is not None):
        raise ModelError(where, f"a moment is no time from 0 to {LATEST_S:.0f} s")
    return incident


def of_message(message: Any) -> Incident:
    """The incident that a shsa_msgs/Incident tells of, also one that a rosbag holds.

    Messages of earlier versions may lack some fields. Raises ModelError if it is none.
    """
    values: Dict[str, Any] = {name: str(getattr(message, name, "")) for name in _TEXTS}
    values.update((name, tuple(getattr(message, name, ()))) for name in (*_LISTS, "unavailable"))
    values.update((name, _moment(getattr(message, name))) for name in MOMENTS)
    if values["detected"] is None:
        raise ModelError(message.topic, "an incident that nobody has detected")
    try:
        return Incident(
            id=message.id,
            kind=Kind(message.kind),
            state=State(message.state),
            quality=message.quality or None,
            errors=_errors(message.error_rms, message.error_p95),
            restarts=message.restarts,
            kept_out=message.kept_out,
            kept=message.kept,
            **values,
        )
    except ValueError as error:  # a word that is none
        raise ModelError(message.topic, str(error)) from error


def newest(told: Iterable[Incident]) -> Tuple[Incident, ...]:
    """Each incident as it was told last, in the order in which they were detected."""
    found: Dict[Tuple[str, int], List[Incident]] = {}
    for incident in told:
        known = found.setdefault((incident.service, incident.id), [])
        if known and abs(known[-1].detected - incident.detected) < SAME_S:
            known[-1] = incident
        else:
            known.append(incident)
    return tuple(sorted((i for each in found.values() for i in each), key=lambda i: i.detected))


def _moment(stamp: Any) -> Optional[float]:
    return None if stamp.is_zero() else float(stamp.to_sec())


def _errors(rms: Sequence[float], p95: Sequence[float]) -> Tuple[Optional[Error], ...]:
    return tuple(
        Error(one, p95=other if isfinite(other) else None) if isfinite(one) else None
        for one, other in zip(rms, p95)
    )
