"""The reconfigurator's events (it hears them) and commands (it wants them done).

Times in s on one clock.
"""
from dataclasses import dataclass
from typing import Optional, Tuple, Union

from shsa_core.healing.incident import Incident
from shsa_core.healing.records import Record
from shsa_core.model.kinds import Kind, Word
from shsa_core.model.log import Log
from shsa_core.model.ontology import Ontology
from shsa_core.model.service import Service, Signal
from shsa_core.model.som import Som
from shsa_core.model.substitution import Program, Substitution
from shsa_core.monitoring.events import CalibrationRow, PublisherHealth


class Where(Word):
    """The place where the process of a node runs, as far as can be told."""

    HERE = "here"
    STOPPED = "stopped"
    DEAD = "dead"
    ELSEWHERE = "elsewhere"
    NOWHERE = "nowhere"
    UNKNOWN = "unknown"  # it cannot be verified which process it is
    ANOTHER = "another"  # it is not the one that failed
    UNREACHABLE = "unreachable"  # its computer was lost


class Pulse(Word):
    """The signs of life of a substitute's process."""

    HEARD = "heard"
    HUNG = "hung"  # it is stopped, or gives none for long


@dataclass(frozen=True)
class Started:
    """The reconfigurator is up; `preparing`: what substitutes are forked from comes up (Prepared).

    `records`: what a former one has written down. `running`: the substitutes, and the nodes that
    were started again, that run on. `leftovers`: other nodes named as a substitute that are dead;
    `strangers`: nodes whose names begin so, and of which nobody knows that. `subscribers` of topics
    as in GraphSeen.
    """

    time: float
    leftovers: Tuple[str, ...] = ()
    strangers: Tuple[str, ...] = ()
    records: Tuple[Record, ...] = ()
    running: Tuple[str, ...] = ()
    preparing: bool = False
    subscribers: Tuple[Tuple[str, Tuple[str, ...]], ...] = ()


@dataclass(frozen=True)
class Prepared:
    """The process from which substitutes are forked is up: they take less from now on."""

    time: float


@dataclass(frozen=True)
class ShuttingDown:
    """The reconfigurator is about to end."""

    time: float


@dataclass(frozen=True)
class LaunchEnding:
    """The launch that the robot belongs to is ending: from now on nodes stop on purpose."""

    time: float


@dataclass(frozen=True)
class MaintenanceSet:
    """Maintenance begins, or ends; while it is `on`, nothing is killed or started."""

    time: float
    on: bool


@dataclass(frozen=True)
class FailureSeen:
    """A monitor reports that `publisher` (empty if none was ever seen) of a service has failed.

    `service` may be empty: then topic and publisher tell it. `last_message`: the last good one,
    serialized; empty: not known.
    """

    time: float
    service: str
    topic: str
    publisher: str
    kind: Kind
    detail: str
    last_good: Optional[float] = None
    last_message: bytes = b""


@dataclass(frozen=True)
class HealthSeen:
    """This has changed in a monitor's table; `whole`: this is all of it.

    `removed`: topics and publishers. `anew`: the monitor has just started. `host`: the computer
    that it watches; empty: all others.
    """

    time: float
    rows: Tuple[PublisherHealth, ...]
    removed: Tuple[Tuple[str, str], ...] = ()
    whole: bool = False
    anew: bool = False
    host: str = ""


@dataclass(frozen=True)
class SomChanged:
    """The service-to-ontology mapping is another one now."""

    time: float
    som: Som


@dataclass(frozen=True)
class GraphSeen:
    """The master lists other subscribers of topics than before, or other duties of nodes.

    The duties of a node are what a kill costs beyond the SOM, in words.
    """

    time: float
    subscribers: Tuple[Tuple[str, Tuple[str, ...]], ...]
    duties: Tuple[Tuple[str, Tuple[str, ...]], ...] = ()


@dataclass(frozen=True)
class ModelsReloaded:
    """Ontology and SOM were read again."""

    time: float
    ontology: Ontology
    som: Som


@dataclass(frozen=True)
class NodeLearned:
    """It was looked which process a node is; `known`: that is verified.

    `protected`: why it is never killed unless the SOM says so; empty: it may be.
    """

    time: float
    node: str
    known: bool
    protected: str = ""


@dataclass(frozen=True)
class NodeCameUp:
    """A process has come up as one of the nodes of WatchNodes, or is about to."""

    time: float
    node: str


@dataclass(frozen=True)
class NodeFound:
    """It was looked where the process of a node runs that is to be killed.

    `detail`: why it is not touched. `starter`: who has started it, in words; empty: not known.
    `rate`: messages/s that it sends to those that are connected to it, 0 as well if it does not
    answer; None: nobody is connected, or it was not to be counted.
    """

    time: float
    node: str
    where: Where
    detail: str = ""
    starter: str = ""
    rate: Optional[float] = None


@dataclass(frozen=True)
class NodeAnswered:
    """A node that was asked to leave has answered: it is well enough to shut down in order."""

    time: float
    node: str


@dataclass(frozen=True)
class NodeLeft:
    """The process of a node has ended; elsewhere: it said that it leaves, and listens no more."""

    time: float
    node: str


@dataclass(frozen=True)
class NodeUnregistered:
    """A node that is gone had unregistered itself at the master: it was told to leave."""

    time: float
    node: str


@dataclass(frozen=True)
class ProcessUntouchable:
    """The process of a node cannot be ended; `detail`: why. Empty: it belongs to somebody else."""

    time: float
    node: str
    detail: str = ""


@dataclass(frozen=True)
class SubstituteStarted:
    """The process of a substitute was set to work; `found`: when the search had ended."""

    time: float
    node: str
    found: float


@dataclass(frozen=True)
class ProcessExited:
    """The process of a substitute ended, or never started."""

    time: float
    node: str
    detail: str


@dataclass(frozen=True)
class ProcessPulse:
    """The process of a substitute gives its first sign of life; or none any more."""

    time: float
    node: str
    pulse: Pulse


@dataclass(frozen=True)
class SubstituteRequested:
    """Somebody wants `service` substituted now; `last_message` as in FailureSeen."""

    time: float
    service: str
    last_message: bytes = b""


@dataclass(frozen=True)
class NodeRestarted:
    """A node was started again; `with_us`: who started it first has started us too."""

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
    """Those who started `node` first have ended: roslaunch, or a terminal."""

    time: float
    node: str


@dataclass(frozen=True)
class Released:
    """Somebody lets the nodes that `service` keeps out return."""

    time: float
    service: str


@dataclass(frozen=True)
class CalibrationsHeard:
    """The monitor tells how what may substitute services is calibrated.

    `removed`: services and programs that are calibrated no more.
    """

    time: float
    rows: Tuple[CalibrationRow, ...]
    removed: Tuple[Tuple[str, Program], ...] = ()


@dataclass(frozen=True)
class HostSeen:
    """The agent of a computer tells that it is there.

    `load`: how many of its `cores` are busy; `sent` and `received`: bytes/s on its network.
    """

    time: float
    host: str
    load: float
    cores: float
    sent: float = 0.0
    received: float = 0.0


@dataclass(frozen=True)
class HostLost:
    """The agent of a computer is not heard any more; `detail`: what was seen of that."""

    time: float
    host: str
    detail: str


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
    Prepared,
    ShuttingDown,
    LaunchEnding,
    MaintenanceSet,
    FailureSeen,
    HealthSeen,
    SomChanged,
    GraphSeen,
    ModelsReloaded,
    NodeLearned,
    NodeCameUp,
    NodeFound,
    NodeAnswered,
    NodeLeft,
    NodeUnregistered,
    ProcessUntouchable,
    SubstituteStarted,
    ProcessExited,
    ProcessPulse,
    SubstituteRequested,
    NodeRestarted,
    RestartFailed,
    StarterEnded,
    Released,
    CalibrationsHeard,
    HostSeen,
    HostLost,
    Idle,
    Tick,
]


@dataclass(frozen=True)
class LearnNode:
    """Find out which process a healthy publisher of a topic is; answered by NodeLearned."""

    node: str
    topic: str = ""


@dataclass(frozen=True)
class WatchNodes:
    """Tell from now on when one of these nodes, and no other, comes up (NodeCameUp)."""

    nodes: Tuple[str, ...]


@dataclass(frozen=True)
class AskMonitor:
    """Have the monitor of a computer tell its whole table once more (HealthSeen)."""

    host: str


@dataclass(frozen=True)
class FindNode:
    """Find out where the process of a node runs that is to be killed; answered by NodeFound.

    `successor`: if the process that was learned is dead, the one with its name now is meant.
    `topic`: what it must publish; empty: it is a substitute of ours. `listen`: for how many s it is
    counted on its own computer what it sends. `uri`: the address at which it must listen.
    """

    node: str
    successor: bool = True
    topic: str = ""
    listen: float = 0.0
    uri: str = ""


@dataclass(frozen=True)
class AskToLeave:
    """`rosnode kill`; answered by NodeAnswered, NodeLeft once it is gone, or ProcessUntouchable."""

    node: str


@dataclass(frozen=True)
class EndProcess:
    """`kill -9` the process of a node; answered by NodeLeft or ProcessUntouchable.

    `gently`: by SIGTERM, so that it can still clean up.
    """

    node: str
    gently: bool = False


@dataclass(frozen=True)
class ClearNode:
    """Clear what a node that is gone has left registered; NodeUnregistered if that is nothing."""

    node: str


@dataclass(frozen=True)
class StartSubstitute:
    """Start a substitute's process, muted until the table of substitutions says that it publishes.

    Without a program it waits until the table gives it one, `shared`: several. `host`: the computer
    to start it on; empty: the reconfigurator's own.
    """

    node: str
    program: Optional[Program]
    inputs: Tuple[Signal, ...] = ()
    outputs: Tuple[Signal, ...] = ()
    host: str = ""
    shared: bool = False


@dataclass(frozen=True)
class AssignSubstitute:
    """Have a running process see its program in the table; answered by SubstituteStarted."""

    node: str


@dataclass(frozen=True)
class StopSubstitute:
    """End a substitute's process."""

    node: str


@dataclass(frozen=True)
class RestartNode:
    """Start a node again as it was started; answered by NodeRestarted or RestartFailed."""

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
    """Show what has changed in the table of substitutions; they heed it.

    Rows without a node are plans that idle processes prepare for. `removed`: their keys.
    """

    rows: Tuple[Substitution, ...]
    removed: Tuple[str, ...] = ()


@dataclass(frozen=True)
class WriteDown:
    """Write down what was decided, before it is done; the next reconfigurator goes on from it.

    `removed`: the keys of the records that are gone.
    """

    records: Tuple[Record, ...]
    removed: Tuple[str, ...] = ()


@dataclass(frozen=True)
class ShowIncident:
    """Publish a step of an incident."""

    incident: Incident


@dataclass(frozen=True)
class ServiceState:
    """One row of the running SOM: who provides the service now, and whether it is available.

    `healthy`: all originals that do well; `verified`: those of them whose process is known;
    `consumers`: the nodes outside healing that subscribe to its topic.
    """

    service: Service
    node: str
    available: bool
    detail: str
    healthy: Tuple[str, ...] = ()
    verified: Tuple[str, ...] = ()
    consumers: Tuple[str, ...] = ()


@dataclass(frozen=True)
class ShowSom:
    """Show what has changed in the running SOM."""

    rows: Tuple[ServiceState, ...]
    removed: Tuple[str, ...] = ()


Command = Union[
    WriteDown,
    LearnNode,
    WatchNodes,
    AskMonitor,
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
