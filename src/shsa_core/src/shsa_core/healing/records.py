"""What the reconfigurator writes down before it acts, for the one that comes after it.

Each record has a key; the newest of a key counts. Times in s of the monotonic clock.
"""
from dataclasses import dataclass
from typing import Dict, Iterable, Optional, Tuple, Union

from shsa_core.healing.incident import Incident
from shsa_core.model.kinds import Kind, Word
from shsa_core.model.substitution import Substitution


@dataclass(frozen=True)
class Counters:
    """The last number of an incident, and the next one of a substitute's name."""

    incidents: int
    names: int

    @property
    def key(self) -> str:
        """There is one such record."""
        return "counters"


@dataclass(frozen=True)
class Trust:
    """How far the node of a service is trusted: see NodeReturn."""

    restarts: int = 0
    exhausted: bool = False
    relapses: int = 0
    returned: Optional[float] = None
    soon: bool = False
    well_since: Optional[float] = None
    start_at: Optional[float] = None
    awaited_by: Optional[float] = None
    doubtful: int = 0


class Fate(Word):
    """What becomes of a faulty node."""

    NONE = "none"
    """It is gone, or there is none."""
    OPEN = "open"
    """It is to be judged."""
    WAITS = "waits"
    """It is killed once it is taken over."""
    KILLED = "killed"
    KEPT = "kept"
    """It is not killed; it is judged again when the world changes."""


@dataclass(frozen=True)
class Blame:
    """What was decided about a faulty node: see FaultyNode."""

    kind: Kind
    fate: Fate = Fate.OPEN
    heard: bool = False


@dataclass(frozen=True)
class HealingRecord:
    """How the healing of a service stands: its incident, its substitute's row, its limits."""

    service: str
    incident: Optional[Incident] = None
    blame: Optional[Blame] = None
    substitution: Optional[Substitution] = None
    trust: Trust = Trust()
    healings: Tuple[float, ...] = ()

    @property
    def key(self) -> str:
        """One for each service."""
        return service_key(self.service)


@dataclass(frozen=True)
class IdleProcess:
    """An idle process of the pool, when it was started, and on which computer."""

    node: str
    started: float
    host: str = ""

    @property
    def key(self) -> str:
        """One for each process."""
        return f"idle {self.node}"


@dataclass(frozen=True)
class Healthy:
    """A publisher that does well since a moment, as the monitor told last."""

    topic: str
    publisher: str
    since: float

    @property
    def key(self) -> str:
        """One for each publisher of a topic."""
        return healthy_key(self.topic, self.publisher)


@dataclass(frozen=True)
class RestartedNode:
    """A node that was started again; `with_us` as in NodeRestarted."""

    node: str
    with_us: bool

    @property
    def key(self) -> str:
        """One for each node."""
        return f"restarted {self.node}"


@dataclass(frozen=True)
class Stray:
    """A substitute that must not run any more, on a computer that may not have been told so."""

    node: str
    host: str

    @property
    def key(self) -> str:
        """One for each process."""
        return stray_key(self.node)


Record = Union[Counters, HealingRecord, IdleProcess, Healthy, RestartedNode, Stray]


def service_key(service: str) -> str:
    """The key of the record of a service's healing."""
    return f"service {service}"


def stray_key(node: str) -> str:
    """The key of the record of a substitute that must not run any more."""
    return f"stray {node}"


def healthy_key(topic: str, publisher: str) -> str:
    """The key of the record that a publisher does well."""
    return f"healthy {topic} {publisher}"


class Records:
    """The records as they are to be, and which of them have changed since `change` was called."""

    def __init__(self) -> None:
        self._kept: Dict[str, Record] = {}
        self._changed: Dict[str, Optional[Record]] = {}

    def put(self, record: Record) -> None:
        """Keep a record; one that says nothing is none."""
        empty = isinstance(record, HealingRecord) and record == HealingRecord(record.service)
        self.set(record.key, None if empty else record)

    def get(self, key: str) -> Optional[Record]:
        """The record of a key; None: it has none."""
        return self._kept.get(key)

    def set(self, key: str, record: Optional[Record]) -> None:
        """The record of a key; None: it has none."""
        if self._kept.get(key) == record:
            return
        self._changed[key] = record
        if record is None:
            del self._kept[key]
        else:
            self._kept[key] = record

    def change(self) -> Tuple[Tuple[Record, ...], Tuple[str, ...]]:
        """The records that are new or changed, and the keys of those that are gone."""
        changed, self._changed = self._changed, {}
        new = tuple(record for record in changed.values() if record is not None)
        return new, tuple(key for key, record in changed.items() if record is None)

    def forget(self) -> None:
        """Keep nothing but the counters."""
        for key, record in list(self._kept.items()):
            if not isinstance(record, Counters):
                self.set(key, None)


def of_this_robot(
    records: Iterable[Record], same_run: bool, running: Iterable[str]
) -> Tuple[Record, ...]:
    """What of some records still tells of the robot.

    That is all of them if the ROS master's run is the same, or one of the substitutes still runs;
    else only the counters: the robot was started anew meanwhile.
    """
    records, running = tuple(records), set(running)
    named = {each.node for each in records if isinstance(each, IdleProcess)}
    rows = (each.substitution for each in records if isinstance(each, HealingRecord))
    named.update(row.node for row in rows if row is not None)
    if same_run or named & running:
        return records
    return tuple(each for each in records if isinstance(each, Counters))
