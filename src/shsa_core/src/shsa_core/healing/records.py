"""The records that the reconfigurator writes before it acts, for the one that comes after it.

Each record has a key; the newest of a key counts. Times in s of the monotonic clock.
"""
from dataclasses import dataclass
from typing import Iterable, Optional, Tuple, Union

from shsa_core.healing.incident import Incident
from shsa_core.model.kinds import Kind, Word
from shsa_core.model.substitution import Substitution
from shsa_core.planning.pool import IdleProcess
from shsa_core.table import Keyed


class Fate(Word):
    """The fate of a node for one accusation."""

    NONE = "none"  # nothing more: it is gone, or can be neither reached nor verified
    OPEN = "open"  # it is to be judged
    WAITS = "waits"  # it is killed once its service is taken over
    KILLED = "killed"
    KEPT = "kept"  # it is judged again when the world changes


@dataclass(frozen=True)
class Trust:
    """The trust in a node, and what brings it back.

    `relapses` in a row; `doubtful`: those that may be its link's. `returned`: when it was well
    again last; `soon`: its last relapse came after its hold-off. `start_at`: when it is started
    again; `awaited_by`: when it should have come up.
    """

    restarts: int = 0
    exhausted: bool = False
    relapses: int = 0
    doubtful: int = 0
    soon: bool = False
    returned: Optional[float] = None
    well_since: Optional[float] = None
    start_at: Optional[float] = None
    awaited_by: Optional[float] = None


@dataclass(frozen=True)
class Counters(Keyed):
    """The last number of an incident, and the next one of a substitute's name."""

    KEY = "counters"
    incidents: int
    names: int


@dataclass(frozen=True)
class NodeRecord(Keyed):
    """The trust in a node."""

    KEY = "node {0.node}"
    node: str
    trust: Trust


@dataclass(frozen=True)
class ServiceRecord(Keyed):
    """The standing of a service: its incident, the fate of its node, its substitute's row.

    Its `kind` of failure may be another than the incident's. `last_message`: where no row has it.
    """

    KEY = "service {0.service} {0.topic}"
    service: str
    topic: str
    incident: Optional[Incident] = None
    kind: Kind = Kind.OTHER
    fate: Fate = Fate.NONE
    substitution: Optional[Substitution] = None
    last_message: bytes = b""


@dataclass(frozen=True)
class Healthy(Keyed):
    """A publisher that does well since a moment, a message and the address of it, as told last."""

    KEY = "healthy {0.topic} {0.publisher}"
    topic: str
    publisher: str
    since: float
    template: bytes = b""
    uri: str = ""


Record = Union[Counters, NodeRecord, ServiceRecord, IdleProcess, Healthy]


def of_this_robot(
    records: Iterable[Record], same_run: bool, running: Iterable[str]
) -> Tuple[Record, ...]:
    """Return the records that still tell of the robot.

    All of them if the ROS master's run is the same, or one of the substitutes still runs; else only
    the counters: the robot was started anew meanwhile.
    """
    records = tuple(records)
    named = {each.node for each in records if isinstance(each, IdleProcess)}
    rows = (each.substitution for each in records if isinstance(each, ServiceRecord))
    named.update(row.node for row in rows if row is not None)
    if same_run or not named.isdisjoint(running):
        return records
    return tuple(each for each in records if isinstance(each, Counters))
