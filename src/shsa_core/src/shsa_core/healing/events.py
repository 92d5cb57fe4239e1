"""The reconfigurator's events (it hears them) and commands (it wants them done).

Times in s on one clock.
"""
from dataclasses import dataclass
from typing import Optional, Tuple, Union

from shsa_core.healing.incident import Incident
from shsa_core.healing.records import Record
from shsa_core.model.calibration import CalibrationRow
from shsa_core.model.health import PublisherHealth
from shsa_core.model.kinds import Kind, Word
from shsa_core.model.log import Log
from shsa_core.model.ontology import Ontology
from shsa_core.model.service import ServiceState, Signal
from shsa_core.model.som import Som
from shsa_core.model.substitution import Program, Substitution


class Where(Word):
    """The place where the process of a node runs, as far as can be told."""

    HERE = "here"
    STOPPED = "stopped"
    DEAD = "dead"
    ELSEWHERE = "elsewhere"
    NOWHERE = "nowhere"
    UNKNOWN = "unknown"  # it cannot be verified which process it is
    ANOTHER = "another"  # it is not the one that failed
    PROTECTED = "protected"  # it is ended only where the SOM says so
    UNREACHABLE = "unreachable"  # its computer was lost


@dataclass(frozen=True)
class Event:
    """Something has happened: one of the classes below that no other is made of."""

    time: float


@dataclass(frozen=True)
class NodeEvent(Event):
    """Something has happened to a node."""

    node: str


@dataclass(frozen=True)
class Started(Event):
    """The reconfigurator is up; `preparing`: what substitutes are forked from comes up (Prepared).

    `records`: what a former one has written down. `running`: the substitutes and nodes started
    again that run on. `leftovers`: other nodes named as a substitute that are dead; `strangers`:
    those of which nobody knows that. `subscribers`, `duties`: as in GraphSeen, as far as is known.
    """

    leftovers: Tuple[str, ...] = ()
    strangers: Tuple[str, ...] = ()
    records: Tuple[Record, ...] = ()
    running: Tuple[str, ...] = ()
    preparing: bool = False
    subscribers: Tuple[Tuple[str, Tuple[str, ...]], ...] = ()
    duties: Tuple[Tuple[str, Tuple[str, ...]], ...] = ()


class Prepared(Event):
    """The process from which substitutes are forked is up: they take less from now on."""


class ShuttingDown(Event):
    """The reconfigurator is about to end."""


class LaunchEnding(Event):
    """The launch that the robot belongs to is ending: from now on nodes stop on purpose."""


@dataclass(frozen=True)
class MaintenanceSet(Event):
    """Maintenance begins, or ends; while it is `on`, nothing is killed or started."""

    on: bool


@dataclass(frozen=True)
class FailureSeen(Event):
    """A monitor reports that `publisher` (empty if none was ever seen) of a service has failed.

    `service` may be empty: then topic and publisher tell it. `last_message`: the last good one,
    serialized; empty: not known.
    """

    service: str
    topic: str
    publisher: str
    kind: Kind
    detail: str
    last_good: Optional[float] = None
    last_message: bytes = b""

    @property
    def good_until(self) -> float:
        """Return when the last good message came, or the failure, if none is known."""
        return self.time if self.last_good is None else self.last_good


@dataclass(frozen=True)
class HealthSeen(Event):
    """This has changed in a monitor's table; `whole`: this is all of it.

    `removed`: topics and publishers. `began`: when the monitor did, by its own clock; 0: that is
    not told. `host`: the computer that it watches; empty: all others.
    """

    rows: Tuple[PublisherHealth, ...]
    removed: Tuple[Tuple[str, str], ...] = ()
    whole: bool = False
    began: int = 0
    host: str = ""


@dataclass(frozen=True)
class SomChanged(Event):
    """The service-to-ontology mapping is another one now; `ontology`: it was read again as well."""

    som: Som
    ontology: Optional[Ontology] = None


@dataclass(frozen=True)
class GraphSeen(Event):
    """The master lists other subscribers of topics than before, or other duties of nodes.

    The duties of a node are what a kill costs beyond the SOM, in words.
    """

    subscribers: Tuple[Tuple[str, Tuple[str, ...]], ...]
    duties: Tuple[Tuple[str, Tuple[str, ...]], ...] = ()


@dataclass(frozen=True)
class NodeLearned(NodeEvent):
    """It was looked which process a node is; `known`: that is verified.

    `protected`: as in Charge. `starts`: healing can start it again.
    """

    known: bool
    protected: str = ""
    starts: bool = True


class NodeCameUp(NodeEvent):
    """A process has come up as one of the nodes of WatchNodes."""


@dataclass(frozen=True)
class NodeFound(NodeEvent):
    """It was looked where the process of a node runs that is to be killed.

    `detail`: why it is not touched. `starter`: who has started it, in words; empty: not known.
    `rate`: messages/s that it sends to those that are connected to it, 0 as well if it does not
    answer; None: nobody is connected, or it was not to be counted. `uri`: as it was asked.
    """

    where: Where
    detail: str = ""
    starter: str = ""
    rate: Optional[float] = None
    uri: str = ""


@dataclass(frozen=True)
class LifeEvent(NodeEvent):
    """Something has happened to the life of a node that is killed; `uri`: as it was asked."""

    uri: str = ""


class NodeAnswered(LifeEvent):
    """A node that was asked to leave has answered: it is well enough to shut down in order."""


class NodeLeft(LifeEvent):
    """The process of a node has ended; elsewhere: it said that it leaves, and listens no more."""


class NodeUnregistered(NodeEvent):
    """A node that is gone had unregistered itself at the master: it was told to leave."""


@dataclass(frozen=True)
class ProcessUntouchable(LifeEvent):
    """The process of a node cannot be ended; `detail`: why. Empty: it belongs to somebody else."""

    detail: str = ""


class SubstituteStarted(NodeEvent):
    """The process of a substitute was started."""


@dataclass(frozen=True)
class ProcessExited(NodeEvent):
    """The process of a substitute ended, or was never `started`."""

    detail: str
    started: bool = True


@dataclass(frozen=True)
class ProcessPulse(NodeEvent):
    """The process of a substitute is `heard` for the first time; or no more, as it hangs."""

    heard: bool


@dataclass(frozen=True)
class SubstituteRequested(Event):
    """Somebody wants `service` substituted now; `last_message` as in FailureSeen."""

    service: str
    last_message: bytes = b""


class NodeRestarted(NodeEvent):
    """A node was started again."""


@dataclass(frozen=True)
class RestartFailed(NodeEvent):
    """The faulty node could not be started again."""

    detail: str


class StarterEnded(NodeEvent):
    """Those who started `node` first have ended, or end with us: roslaunch, or a terminal."""


@dataclass(frozen=True)
class Released(Event):
    """Somebody lets the nodes that `service` keeps out return."""

    service: str


@dataclass(frozen=True)
class CalibrationsHeard(Event):
    """The monitor tells how what may substitute services is calibrated.

    `removed`: services and programs that are calibrated no more.
    """

    rows: Tuple[CalibrationRow, ...]
    removed: Tuple[Tuple[str, Program], ...] = ()


@dataclass(frozen=True)
class HostSeen(Event):
    """The agent of a computer tells that it is there.

    `load`: how many of its `cores` are busy; `sent` and `received`: bytes/s on its network.
    """

    host: str
    load: float
    cores: float
    sent: float = 0.0
    received: float = 0.0


@dataclass(frozen=True)
class HostLost(Event):
    """The agent of a computer is not heard any more; `detail`: what was seen of that."""

    host: str
    detail: str


class Idle(Event):
    """There is nothing else to do: one plan can be made ahead."""


class Tick(Event):
    """Time passes."""


@dataclass(frozen=True)
class Act:
    """Something is to be done: one of the classes below that no other is made of."""


@dataclass(frozen=True)
class NodeCommand(Act):
    """Something is to be done with a node."""

    node: str


@dataclass(frozen=True)
class LearnNode(NodeCommand):
    """Find out which process a healthy publisher of a topic is; answered by NodeLearned."""

    topic: str = ""


@dataclass(frozen=True)
class WatchNodes(Act):
    """Tell from now on when one of these nodes, and no other, comes up (NodeCameUp)."""

    nodes: Tuple[str, ...]


@dataclass(frozen=True)
class AskMonitor(Act):
    """Have the monitor of a computer tell its whole table once more (HealthSeen)."""

    host: str


@dataclass(frozen=True)
class FindNode(NodeCommand):
    """Find out where the process of a node runs that is to be killed; answered by NodeFound.

    `successor`: if the process that was learned is dead, the one with its name now is meant.
    `topic`: what it must publish; empty: it is a substitute of ours. `listen`: for how many s it is
    counted on its own computer what it sends. `uri`: the address at which it must listen. `spares`:
    who was never learned is looked at first, and is another one if it is protected.
    """

    successor: bool = True
    topic: str = ""
    listen: float = 0.0
    uri: str = ""
    spares: bool = True


@dataclass(frozen=True)
class AskToLeave(NodeCommand):
    """`rosnode kill`; answered by NodeAnswered, NodeLeft once it is gone, or ProcessUntouchable."""

    uri: str = ""


@dataclass(frozen=True)
class EndProcess(NodeCommand):
    """`kill -9` the process of a node; answered by NodeLeft or ProcessUntouchable.

    `gently`: by SIGTERM, so that it can still clean up.
    """

    uri: str = ""
    gently: bool = False


class ClearNode(NodeCommand):
    """Clear what a node that is gone has left registered; NodeUnregistered if that is nothing."""


@dataclass(frozen=True)
class StartSubstitute(NodeCommand):
    """Start a substitute's process, muted until the table of substitutions says that it publishes.

    Without a program it waits until the table gives it one, `shared`: several. `host`: the computer
    to start it on; empty: the reconfigurator's own.
    """

    program: Optional[Program]
    inputs: Tuple[Signal, ...] = ()
    outputs: Tuple[Signal, ...] = ()
    host: str = ""
    shared: bool = False


class RestartNode(NodeCommand):
    """Start a node again as it was started; answered by NodeRestarted or RestartFailed."""


class StopNode(NodeCommand):
    """End the process of a substitute, or a node that was started again."""


@dataclass(frozen=True)
class RunCommand(Act):
    """Run the command of a service that nothing can substitute: a program and its arguments."""

    service: str
    words: Tuple[str, ...]


@dataclass(frozen=True)
class ShowSubstitutions(Act):
    """Show what has changed in the table of substitutions; they heed it.

    Rows without a node are plans that idle processes prepare for. `removed`: their keys.
    """

    rows: Tuple[Substitution, ...]
    removed: Tuple[str, ...] = ()


@dataclass(frozen=True)
class WriteDown(Act):
    """Write down what was decided, before it is done; the next reconfigurator goes on from it.

    `removed`: the keys of the records that are gone.
    """

    records: Tuple[Record, ...]
    removed: Tuple[str, ...] = ()


@dataclass(frozen=True)
class ShowIncident(Act):
    """Publish a step of an incident."""

    incident: Incident


@dataclass(frozen=True)
class ShowSom(Act):
    """Show what has changed in the running SOM."""

    rows: Tuple[ServiceState, ...]
    removed: Tuple[str, ...] = ()


Command = Union[Act, Log]
