"""Incidents in a rosbag: the incidents, the failures told, and the values of substitutes."""
from typing import Dict, List, NamedTuple, Tuple

from shsa_learning.incident_log import newest, of_message
from shsa_core.errors import ModelError
from shsa_core.healing.incident import Incident
from shsa_core.model.field import parse_field
from shsa_core.model.field_value import field_value
from shsa_core.text import shown
from shsa_learning.recordings.bags import INCIDENTS, messages, opened

FAILURES = "/shsa/failures"
"""The end of the topic's name, whatever namespace healing ran in."""
BEFORE_S, AFTER_S = 5.0, 1.0
"""Failures that were told so long before an incident was detected, and after, belong to it."""

Values = Tuple[Tuple[float, float], ...]
"""Time in s, and a value."""


class Failure(NamedTuple):
    """A failure as it was told on /shsa/failures."""

    time: float
    topic: str
    publisher: str
    kind: str
    detail: str


class BagIncidents(NamedTuple):
    """The incidents and failures in a bag, and notes on what could not be read."""

    incidents: Tuple[Incident, ...]
    failures: Tuple[Failure, ...]
    notes: Tuple[str, ...]

    def evidence(self, incident: Incident) -> Tuple[Failure, ...]:
        """Return the failures that were told about the topic of an incident when it began."""
        begin, end = incident.detected - BEFORE_S, incident.detected + AFTER_S
        return tuple(
            each
            for each in self.failures
            if each.topic == incident.topic and begin <= each.time <= end
        )


def read_healing(path: str) -> BagIncidents:
    """Read the incidents and failures in a rosbag. Raises ModelError if it cannot be read."""
    told: List[Incident] = []
    failures: List[Failure] = []
    notes: List[str] = []

    def of_healing(topic: str) -> bool:
        return topic.endswith((INCIDENTS, FAILURES))

    with opened(path) as bag:
        for topic, message, _, _ in messages(bag, of_healing, notes):
            if topic.endswith(FAILURES):
                words = message.topic, message.publisher, message.kind, message.detail
                failures.append(Failure(message.header.stamp.to_sec(), *map(shown, words)))
                continue
            try:
                told.append(of_message(message))
            except ModelError as error:
                notes.append(str(error))
    return BagIncidents(newest(told), tuple(failures), tuple(dict.fromkeys(notes)))


def read_published(path: str, incident: Incident) -> Dict[str, Values]:
    """Read the times and values that the substitute of an incident published, by output.

    Raises ModelError.
    """
    fields = {each: each[len(incident.topic) + 1 :] for each in incident.outputs}
    found: Dict[str, List[Tuple[float, float]]] = {each: [] for each in fields}

    with opened(path) as bag:
        for _, message, time, publisher in messages(bag, incident.topic.__eq__, []):
            if publisher != incident.substitute:
                continue
            for output, field in fields.items():
                value = field_value(message, parse_field(field, "/"))
                if value is not None:
                    found[output].append((time, value))
    return {output: tuple(values) for output, values in found.items() if values}
