"""An incident in words: what failed, why it was believed, and what was done."""
from typing import Dict, List, Optional, Tuple

from shsa_learning.incident_log import MOMENTS
from shsa_core.healing.incident import Incident, State
from shsa_core.model.kinds import Kind

KINDS: Dict[Kind, str] = {
    Kind.NODE_GONE: "its connection was lost, and the node was gone: it died or left",
    Kind.SILENT: "it sent no message within its deadline",
    Kind.NEVER_PUBLISHED: "it sent no message since it was started",
    Kind.OUT_OF_RANGE: "it sent values beyond the range that the SOM states",
    Kind.NOT_A_NUMBER: "it sent values that are no numbers, or messages that cannot be decoded",
    Kind.RATE_HIGH: "it sent too often",
    Kind.RATE_LOW: "it sent too seldom",
    Kind.STUCK: "its value did not change any more",
    Kind.JUMP: "its value jumped too far from the last good one",
    Kind.WITNESS: "its value was too far from what other services tell of it",
    Kind.STALE_STAMP: "its stamps were too old",
    Kind.FUTURE_STAMP: "its stamps lay in the future",
    Kind.FRAME: "its messages named another frame",
    Kind.LENGTH: "its arrays were too short",
    Kind.FORMULA: "its values broke the formula that the SOM states",
    Kind.UNKNOWN_PUBLISHER: "a node that nobody knows published beside the right one",
    Kind.NO_VALUE: "the law of what stood in for it did not hold, or had no value",
    Kind.REQUESTED: "somebody asked for a substitute",
    Kind.OTHER: "somebody else than the monitor reported it",
}
"""Words for each kind of failure, of a service."""
STATES: Dict[State, str] = {
    State.WELL: "it is well",
    State.HEALING: "a substitute was being searched or started when the record ends",
    State.HEALED: "a substitute still publishes it when the record ends",
    State.RETURNING: "the original had come back, and was on probation, when the record ends",
    State.UNHEALED: "nothing could replace it",
    State.SAFE: "nothing could replace it, so that its safe value was published, or its "
    "command was run",
    State.KEPT: "the faulty node was kept, and nothing was done beside it",
    State.ENDED: "the original publishes it again",
}
"""Words for the state of an incident at the end of the record."""
STEPS: Dict[str, str] = {
    "last_good": "last good message",
    "detected": "failure detected",
    "killed": "faulty node gone for certain",
    "found": "search done",
    "spawned": "substitute set to work",
    "first_message": "substitute's first message",
    "returned": "original's first good message",
    "ended": "substitute stopped",
}
"""The eight moments."""


def title(incident: Incident) -> str:
    """Return the incident in a few words."""
    return f"{incident.topic} failed: {incident.kind}"


def summary(incident: Incident) -> Tuple[str, ...]:
    """Return what happened, sentence by sentence."""
    told: List[str] = []
    who = incident.faulty_node or "The node that publishes it"
    told.append(f"{who} failed to publish {incident.topic}: {KINDS[incident.kind]}.")
    if incident.substitute and incident.first_message is not None:
        told.append(f"{incident.substitute} stood in for it{_after(incident)}, {_by(incident)}.")
    elif incident.code and incident.state is State.KEPT:
        told.append(f"It could have been replaced, {_by(incident)}.")
    elif incident.missing:
        told.append(f"Nothing could replace it: {', '.join(incident.missing)} would be needed.")
    if incident.decision:
        told.append(f"{incident.decision}.")
    if incident.restarts:
        times = "once" if incident.restarts == 1 else f"{incident.restarts} times"
        told.append(f"The node was started again {times}.")
    if incident.kept_out:
        told.append("The node is kept out until somebody releases the service.")
    told.append(f"In the end {STATES[incident.state]}{_lasted(incident)}.")
    return tuple(told)


def steps(incident: Incident) -> Tuple[Tuple[str, Optional[float]], ...]:
    """Return the eight moments by name, in s after the first one; None: it has not happened."""
    moments = [getattr(incident, name) for name in MOMENTS]
    first = min(each for each in moments if each is not None)
    return tuple(
        (STEPS[name], None if moment is None else moment - first)
        for name, moment in zip(MOMENTS, moments)
    )


def duration(seconds: float) -> str:
    """Return a time in the unit in which it is read best."""
    if abs(seconds) < 1.0:
        return f"{1000.0 * seconds:.0f} ms"
    if abs(seconds) < 120.0:
        return f"{seconds:.1f} s"
    return f"{seconds / 60.0:.1f} min"


def figure(value: Optional[float], unit: str = "") -> str:
    """Return a number with three digits and its unit; a dash where it is not known."""
    return "–" if value is None else f"{value:.3g} {unit}".strip()


def _after(incident: Incident) -> str:
    outage = incident.outage
    return "" if outage is None else f" {duration(outage)} after the last good message"


def _by(incident: Incident) -> str:
    by = " and ".join(incident.relations) or "the same property elsewhere"
    return f"by {by} from {', '.join(incident.inputs) or 'constants'}"


def _lasted(incident: Incident) -> str:
    if incident.ended is None:
        return ""
    return f", {duration(incident.ended - incident.detected)} after it was detected"
