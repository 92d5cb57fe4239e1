"""The faults that healing must find without being tuned, their kinds, and how soon."""
from dataclasses import dataclass
from typing import Dict, FrozenSet, List, Sequence

from shsa_core.model.kinds import QUIET, Kind
from shsa_core.model.service import Service
from shsa_injection.invariants import Violation

RULE = "every fault is found"
PERIOD_S = 0.02
"""The period at which the times hold; a slower topic has as many messages."""
DEADLINES = 2.0  # a silence may be granted one deadline more
REACTION_S = 0.5


@dataclass(frozen=True)
class Finding:
    """The kinds of failure that fit a fault, and the s within which one must be told.

    `stranger`: the one who failed is not the topic's node.
    """

    kinds: FrozenSet[Kind]
    within: float
    stranger: bool = False


@dataclass(frozen=True)
class Told:
    """A failure that healing has told of: when, in s, of whom, and of what kind."""

    at: float
    topic: str
    publisher: str
    kind: str


def _as(within: float, *kinds: Kind, stranger: bool = False) -> Finding:
    return Finding(frozenset(kinds), within, stranger)


FINDINGS: Dict[str, Finding] = {
    "off": _as(1.0, *QUIET),
    "crash": _as(1.0, *QUIET),
    "hang": _as(1.0, *QUIET),
    "garbage": _as(1.0, Kind.OUT_OF_RANGE, Kind.JUMP),
    "slow": _as(3.0, Kind.RATE_LOW),
    "delayed": _as(1.0, Kind.STALE_STAMP, *QUIET),
    "fast": _as(1.5, Kind.RATE_HIGH),
    "nan": _as(3.0, Kind.NOT_A_NUMBER),
    "inf": _as(3.0, Kind.NOT_A_NUMBER, Kind.OUT_OF_RANGE),
    "old_stamp": _as(1.0, Kind.STALE_STAMP),
    "future_stamp": _as(1.0, Kind.FUTURE_STAMP),
    "duplicate": _as(1.5, Kind.RATE_HIGH, Kind.STALE_STAMP),
    "serial_silence": _as(1.0, *QUIET),
    "serial_unplug": _as(1.0, *QUIET),
    "spoof": _as(2.0, Kind.UNKNOWN_PUBLISHER, Kind.OUT_OF_RANGE, Kind.JUMP, stranger=True),
    "spoof_name": _as(2.0, Kind.UNKNOWN_PUBLISHER, Kind.OUT_OF_RANGE, Kind.JUMP, stranger=True),
}
"""Other faults depend on the robot: `stuck` on noise, `wrong` on a witness, `wrong_frame` and
`short_array` on what was learned, `intermittent` and `serial_noise` on what was drawn."""


def watched_kinds(service: Service) -> FrozenSet[Kind]:
    """Return the kinds of failure that a service is watched for, by its SOM."""
    checks = [*service.checks.each]
    for provision in service.provides:
        checks += [
            check
            for check in provision.checks
            if check.kind is not Kind.OUT_OF_RANGE or provision.range is not None
        ]
    return frozenset((*QUIET, *(check.kind for check in checks)))


def not_found(
    fault: str, service: Service, deadline: float, began: float, now: float, told: Sequence[Told]
) -> List[Violation]:
    """Return a fault of a service from `began` to `now` that must have been found, and was not."""
    finding = FINDINGS.get(fault)
    if finding is None or not service.needed or not finding.kinds & watched_kinds(service):
        return []
    within = finding.within * max(1.0, (service.period or 0.0) / PERIOD_S)
    within = max(within, DEADLINES * deadline + REACTION_S)
    if now - began < within:
        return []  # it was too short to be told
    for each in told:
        fits = each.kind in finding.kinds and (each.publisher != service.node) is finding.stranger
        if each.topic == service.topic and fits and began <= each.at <= began + within:
            return []
    seen = sorted({each.kind for each in told if each.topic == service.topic and each.at >= began})
    text = f"not found within {within:g} s"
    return [Violation(RULE, f"{service.topic} {fault}", text + _instead(seen))]


def _instead(kinds: Sequence[str]) -> str:
    return f"; told were {', '.join(kinds)}" if kinds else ""
