"""What the reconfigurator hears (events) and what it wants done (commands).

Times in s on one clock.
"""
from dataclasses import dataclass
from typing import Optional, Tuple, Union

from shsa_core.codegen.generator import Program
from shsa_core.healing.incident import Incident
from shsa_core.model.kinds import Kind, Word
from shsa_core.model.ontology import Ontology
from shsa_core.model.service import Service, Signal
from shsa_core.model.som import Som
from shsa_core.model.substitution import Substitution
from shsa_core.monitoring.events import PublisherHealth


class Level(Word):
    """How urgent a line of the log is."""

    INFO = "info"
    WARN = "warn"
    ERROR = "error"


class Where(Word):
    """Where the process of a node runs, as far as can be told."""

    HERE = "here"
    STOPPED = "stopped"
    DEAD = "dead"
    ELSEWHERE = "elsewhere"
    NOWHERE = "nowhere"


@dataclass(frozen=True)
class Started:
    """The reconfigurator is up; a former one has left these substitutes behind."""

    time: float
    leftovers: Tuple[str, ...] = ()


@dataclass(frozen=True)
class ShuttingDown:
    """The reconfigurator is about to end."""

    time: float


@dataclass(frozen=True)
class LaunchEnding:
    """The launch that the robot belongs to is ending: from now on nodes stop on purpose."""

    time: float


@dataclass(frozen=True)
class FailureSeen:
    """The monitor reports that `publisher` (empty if none was ever seen) of a service has failed.

    `service` may be empty: then it is told by topic and publisher.
    """

    time: float
    service: str
    topic: str
    publisher: str
    kind: Kind
    detail: str
    last_good: Optional[float] = None


@dataclass(frozen=True)
class HealthSeen:
    """What has changed in the monitor's table; `whole`: this is all of it.

    `removed`: topics and publishers.
    """

    time: float
    rows: Tuple[PublisherHealth, ...]
    removed: Tuple[Tuple[str, str], ...] = ()
    whole: bool = False


@dataclass(frozen=True)
class SomChanged:
    """The service-to-ontology mapping is another one now."""

    time: float
    som: Som


@dataclass(frozen=True)
class ModelsReloaded:
    """Ontology and SOM were read again."""

    time: float
    ontology: Ontology
    som: Som


@dataclass(frozen=True)
class NodeLearned:
    """It was looked which process a node is; `known`: that succeeded."""

    time: float
    node: str
    known: bool


@dataclass(frozen=True)
class NodeFound:
    """Where the process of a node runs that is to be killed."""

    time: float
    node: str
    where: Where


@dataclass(frozen=True)
class NodeLeft:
    """The process of a node has ended or, elsewhere, has answered `rosnode kill`."""

    time: float
    node: str


@dataclass(frozen=True)
class ProcessUntouchable:
    """The process of a node cannot be ended: it belongs to somebody else."""

    time: float
    node: str


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
    """Somebody wants `service` substituted now."""

    time: float
    service: str


@dataclass(frozen=True)
class NodeRestarted:
    """A node was started again.

    `with_us`: whoever started it first has started the reconfigurator too.
    """

    time: float
    node: str
    with_us: bool


@dataclass(frozen=True)
class RestartFailed:
    """The faulty node could not be started again."""

    time: float
    node: str
    detail: str


@dataclass(frozen=True)
class StarterEnded:
    """Whoever started `node` first has ended: roslaunch, or a terminal."""

    time: float
    node: str


@dataclass(frozen=True)
class Released:
    """Somebody lets the nodes that `service` keeps out return."""

    time: float
    service: str


@dataclass(frozen=True)
class Idle:
    """There is nothing else to do: one plan can be made ahead."""

    time: float


@dataclass(frozen=True)
class Tick:
    """Time passes."""

    time: float


Event = Union[
    Started,
    ShuttingDown,
    LaunchEnding,
    FailureSeen,
    HealthSeen,
    SomChanged,
    ModelsReloaded,
    NodeLearned,
    NodeFound,
    NodeLeft,
    ProcessUntouchable,
    SubstituteStarted,
    ProcessExited,
    SubstituteRequested,
    NodeRestarted,
    RestartFailed,
    StarterEnded,
    Released,
    Idle,
    Tick,
]


@dataclass(frozen=True)
class LearnNode:
    """Find out which process a healthy node is; answered by NodeLearned."""

    node: str


@dataclass(frozen=True)
class FindNode:
    """Find out where the process of a node runs that is to be killed; answered by NodeFound.

    `successor`: if the process that was learned is dead, the one that has its name now is meant.
    """

    node: str
    successor: bool = True


@dataclass(frozen=True)
class AskToLeave:
    """`rosnode kill`; answered by NodeLeft once the node is gone."""

    node: str


@dataclass(frozen=True)
class EndProcess:
    """`kill -9` the process of a node; answered by NodeLeft or ProcessUntouchable."""

    node: str


@dataclass(frozen=True)
class ClearNode:
    """Clear what a node that is gone has left registered at the master."""

    node: str


@dataclass(frozen=True)
class StartSubstitute:
    """Start a substitute's process, muted until the table of substitutions says that it publishes.

    Without a program it waits, idle, until the table gives it one. `inputs` and `outputs` are those
    of the program.
    """

    node: str
    program: Optional[Program]
    inputs: Tuple[Signal, ...] = ()
    outputs: Tuple[Signal, ...] = ()


@dataclass(frozen=True)
class AssignSubstitute:
    """A running process has a program now: the table of substitutions tells it.

    Answered by SubstituteStarted.
    """

    node: str


@dataclass(frozen=True)
class StopSubstitute:
    """End a substitute's process."""

    node: str


@dataclass(frozen=True)
class RestartNode:
    """Start a faulty node again, as it was started before.

    Answered by NodeRestarted or RestartFailed.
    """

    node: str


@dataclass(frozen=True)
class StopNode:
    """End a node that was started again."""

    node: str


@dataclass(frozen=True)
class RunCommand:
    """Run the command of a service that nothing can substitute: a program and its arguments."""

    service: str
    words: Tuple[str, ...]


@dataclass(frozen=True)
class ShowSubstitutions:
    """What has changed in the table of substitutions; they heed it.

    Rows without a node are the plans of warm services, which idle processes prepare for. `removed`:
    their nodes, or the services of those plans.
    """

    rows: Tuple[Substitution, ...]
    removed: Tuple[str, ...] = ()


@dataclass(frozen=True)
class ShowIncident:
    """Publish a step of an incident."""

    incident: Incident


@dataclass(frozen=True)
class ServiceState:
    """One row of the running SOM: who provides the service now, and whether it is available."""

    service: Service
    node: str
    available: bool
    detail: str


@dataclass(frozen=True)
class ShowSom:
    """What has changed in the running SOM."""

    rows: Tuple[ServiceState, ...]
    removed: Tuple[str, ...] = ()


@dataclass(frozen=True)
class Log:
    """Tell people, in plain words."""

    level: Level
    text: str


Command = Union[
    LearnNode,
    FindNode,
    AskToLeave,
    EndProcess,
    ClearNode,
    StartSubstitute,
    AssignSubstitute,
    StopSubstitute,
    RestartNode,
    StopNode,
    RunCommand,
    ShowSubstitutions,
    ShowIncident,
    ShowSom,
    Log,
]
