"""What the reconfigurator hears (events) and what it wants done (commands). Times in s on one clock."""
from dataclasses import dataclass
from typing import Optional, Tuple, Union

from shsa_core.codegen.generator import Program
from shsa_core.healing.incident import Incident
from shsa_core.monitoring.events import PublisherHealth
from shsa_core.model.som import Som


@dataclass(frozen=True)
class FailureSeen:
    """The monitor reports that `publisher` (empty if none was ever seen) of `topic` has failed."""

    time: float
    topic: str
    publisher: str
    kind: str
    detail: str
    last_good: Optional[float] = None


@dataclass(frozen=True)
class HealthSeen:
    """The monitor's whole table, made at `made`."""

    time: float
    made: float
    publishers: Tuple[PublisherHealth, ...]


@dataclass(frozen=True)
class SomChanged:
    """The service-to-ontology mapping is another one now."""

    time: float
    som: Som


@dataclass(frozen=True)
class NodeKilled:
    """A killed node is gone (`certain`), or could not be reached to make sure."""

    time: float
    node: str
    certain: bool
    detail: str = ""


@dataclass(frozen=True)
class SubstituteStarted:
    """The process of the substitute `node` was started; the search for it had ended at `found`."""

    time: float
    node: str
    found: float


@dataclass(frozen=True)
class ProcessExited:
    """The process of the substitute `node` ended, or never started."""

    time: float
    node: str
    detail: str


@dataclass(frozen=True)
class SubstituteRequested:
    """Somebody wants `topic` substituted now."""

    time: float
    topic: str


@dataclass(frozen=True)
class RestartFailed:
    """The faulty node could not be started again."""

    time: float
    node: str
    detail: str


@dataclass(frozen=True)
class Released:
    """Somebody lets the nodes that `topic` keeps out return."""

    time: float
    topic: str


@dataclass(frozen=True)
class Tick:
    """Time passes."""

    time: float


Event = Union[
    FailureSeen,
    HealthSeen,
    SomChanged,
    NodeKilled,
    SubstituteStarted,
    ProcessExited,
    SubstituteRequested,
    RestartFailed,
    Released,
    Tick,
]


@dataclass(frozen=True)
class KillNode:
    """Kill a faulty node for certain; answered by NodeKilled. `urgent`: it may still speak."""

    node: str
    urgent: bool


@dataclass(frozen=True)
class StartSubstitute:
    """Start a substitute's process, mute until the table of substitutions says that it speaks.

    Without a program it waits, idle, until the table gives it one.
    """

    node: str
    program: Optional[Program]


@dataclass(frozen=True)
class AssignSubstitute:
    """A running process has a program now: the table of substitutions tells it."""

    node: str


@dataclass(frozen=True)
class StopSubstitute:
    """End a substitute's process."""

    node: str


@dataclass(frozen=True)
class RestartNode:
    """Start a faulty node again, as it was started before."""

    node: str


@dataclass(frozen=True)
class RunCommand:
    """Run the command of a topic that nothing can substitute: a program and its arguments."""

    topic: str
    words: Tuple[str, ...]


@dataclass(frozen=True)
class Substitution:
    """One row of the table of substitutions; see shsa_msgs/Substitution."""

    node: str
    topic: str
    program: Program
    relations: Tuple[str, ...]
    quality: float
    speaking: bool
    original: str = ""


@dataclass(frozen=True)
class ShowSubstitutions:
    """Publish the table of running substitutes; they heed it."""

    substitutions: Tuple[Substitution, ...]


@dataclass(frozen=True)
class ShowIncident:
    """Publish a step of an incident."""

    incident: Incident


@dataclass(frozen=True)
class ServiceState:
    """One row of the running SOM: who provides the service now, and whether it is available."""

    index: int
    node: str
    available: bool
    detail: str


@dataclass(frozen=True)
class ShowSom:
    """Publish the running SOM; `states` follow the services of `som`."""

    som: Som
    states: Tuple[ServiceState, ...]


@dataclass(frozen=True)
class Say:
    """Tell people, in plain words. `level` is info, warn or error."""

    level: str
    text: str


Command = Union[
    KillNode,
    StartSubstitute,
    AssignSubstitute,
    StopSubstitute,
    RestartNode,
    RunCommand,
    ShowSubstitutions,
    ShowIncident,
    ShowSom,
    Say,
]
