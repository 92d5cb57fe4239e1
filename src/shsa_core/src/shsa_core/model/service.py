"""A service: one topic of one node, and what it provides (Section III of the paper)."""
import dataclasses
from dataclasses import dataclass
from typing import ClassVar, Optional, Tuple, Union

from shsa_core.model.checks import Check, Checks, default_checks
from shsa_core.model.error import Error
from shsa_core.model.field import to_path
from shsa_core.model.kinds import Contain, OnPartition, Others, Policy, Standby

USUAL_BRIDGE = 2.5
"""Periods: beside four busy processes, healthy streams had gaps of 2.9 at most, idle of 2."""


@dataclass(frozen=True)
class Provision:
    """One value of a service: the property, and the field of the message that holds it.

    The keys of the SOM (`files/keys.py`), and `unreadable`: why it cannot be read on this computer,
    or empty; `unknown_with`: the part of the message that can be marked as unknown where this value
    is, or empty; `where`: file and line, or parameter.
    """

    property: str
    field: str
    range: Optional[Tuple[float, float]] = None
    quality: float = 1.0
    checks: Tuple[Check, ...] = default_checks(of_values=True)
    error: Optional[Error] = None
    fault_tolerant_error: Optional[float] = None
    unreadable: str = ""
    calibrate: bool = True
    usual: Optional[Tuple[float, float]] = None
    unknown_with: str = dataclasses.field(default="", compare=False, repr=False)
    where: str = dataclasses.field(default="", compare=False, repr=False)


@dataclass(frozen=True)
class Placement:
    """Hosts by name: where a substitute rather runs, best first, and where it never does."""

    prefer: Tuple[str, ...] = ()
    forbid: Tuple[str, ...] = ()


@dataclass(frozen=True)
class LastResort:
    """Publish `values`, by property, and run `command` when nothing can substitute.

    With neither, the topic is silent.
    """

    values: Tuple[Tuple[str, float], ...] = ()
    command: Tuple[str, ...] = ()


@dataclass(frozen=True)
class AdaptiveDeadline:
    """A deadline that is learned from healthy gaps; `false_alarms`: at most so many an hour."""

    false_alarms: float

    def __str__(self) -> str:
        return f"{{false_alarms: {self.false_alarms:g}}}"


@dataclass(frozen=True)
class Service:
    """One topic of one node, by the keys of the SOM (`files/keys.py`).

    With a gate, `topic` is where the node publishes and `beyond_gate` what consumers hear; empty:
    there is no gate. None stands for what is not said. `unwritable`: why its messages cannot be
    written on this computer, so that nothing can take it over, or empty; `upstream`: what its
    values are computed from by however many steps (the SOM sees to that); `weakened`: what live
    parameters allow beyond its file, in words; `fastest`: the file's period where that is shorter;
    `where`: file and line, or parameter.
    """

    name: str
    topic: str
    type: str
    node: str
    period: Optional[float]
    provides: Tuple[Provision, ...]
    deadline: Union[float, AdaptiveDeadline, None] = None
    needed: Optional[bool] = None
    standby: Standby = Standby.COLD
    policy: Policy = Policy.SUBSTITUTE
    checks: Checks = Checks()
    last_resort: LastResort = LastResort()
    contain: Optional[Contain] = None
    others: Others = Others.UNKNOWN
    latched: bool = False
    unwritable: str = ""
    fails_with: Tuple[str, ...] = ()
    fault_tolerant_time: Optional[float] = None
    derived_from: Tuple[str, ...] = ()
    prefer: Tuple[str, ...] = ()
    avoid: Tuple[str, ...] = ()
    cost: int = 1
    beyond_gate: str = ""
    host: str = ""
    placement: Placement = Placement()
    on_partition: OnPartition = OnPartition.HEAL
    bridge: Optional[float] = None
    weakened: str = ""
    fastest: Optional[float] = None
    upstream: Tuple[str, ...] = dataclasses.field(default=(), repr=False)
    where: str = dataclasses.field(default="", compare=False, repr=False)
    sources: Tuple["Source", ...] = dataclasses.field(init=False, compare=False, repr=False)

    def __post_init__(self) -> None:
        sources = tuple(Source(self, provision) for provision in self.provides)
        object.__setattr__(self, "sources", sources)

    def __hash__(self) -> int:
        return hash(self.name)

    @property
    def gated(self) -> bool:
        """A gate stands between its node and its consumers."""
        return bool(self.beyond_gate)

    @property
    def heard(self) -> str:
        """The topic that its consumers hear; its node publishes on `topic`."""
        return self.beyond_gate or self.topic

    @property
    def topics(self) -> Tuple[str, ...]:
        """Both, each once."""
        return tuple(dict.fromkeys((self.topic, self.heard)))

    @property
    def properties(self) -> Tuple[str, ...]:
        """The properties that it provides."""
        return tuple(provision.property for provision in self.provides)

    @property
    def readable(self) -> Tuple["Source", ...]:
        """Those of its values that can be read on this computer."""
        return tuple(source for source in self.sources if not source.provision.unreadable)

    @property
    def shared(self) -> Tuple[str, ...]:
        """The causes that it shares with other services: the last one is its computer."""
        if not self.host or self.host in self.fails_with:
            return self.fails_with
        return (*self.fails_with, self.host)

    @property
    def causes(self) -> Tuple[str, ...]:
        """Whatever it fails with: its node, and what it shares with other services."""
        return tuple(dict.fromkeys((self.node, *self.shared)))

    @property
    def wrong_with(self) -> Tuple[str, ...]:
        """The causes of wrong values: not its computer, with which they are lost at most."""
        return tuple(dict.fromkeys((self.node, *self.fails_with)))

    @property
    def avoided(self) -> Tuple[Tuple[str, ...], ...]:
        """The causes that its substitute does without: if that cannot be, the next; then none.

        First all that it shares, then all but its computer; each with the nodes to `avoid`.
        """
        shared = (self.shared, self.fails_with, ())
        tries = [each for causes in shared for each in ((*causes, *self.avoid), causes)]
        return tuple(dict.fromkeys(each for each in tries if each))

    @property
    def event_driven(self) -> bool:
        """It publishes when something happens, and not periodically."""
        return self.period is None

    @property
    def bridges(self) -> Optional[float]:
        """The periods after which a substitute that stands by fills in; None: never."""
        if self.period is None or self.gated:
            return None
        usual = USUAL_BRIDGE if self.standby is Standby.HOT else 0.0
        return (usual if self.bridge is None else self.bridge) or None

    def source(self, property: str) -> Optional["Source"]:
        """Return the value that provides `property`; None if none does."""
        return next((s for s in self.sources if s.property == property), None)


@dataclass(frozen=True)
class Source:
    """One value of one service: where a property can be read, or written again."""

    service: Service = dataclasses.field(repr=False)
    provision: Provision

    def __hash__(self) -> int:
        return hash((self.service.name, self.provision.property))

    @property
    def quality(self) -> float:
        """In (0, 1]."""
        return self.provision.quality

    @property
    def topic(self) -> str:
        """The topic that it is read from."""
        return self.service.heard

    @property
    def node(self) -> str:
        """The node that publishes it."""
        return self.service.node

    @property
    def names(self) -> Tuple[str, ...]:
        """The names it can be left out by: its service, topic, node and common causes.

        And the services that it is computed from: where one is lost, its own loss would come back.
        """
        of = self.service
        return of.name, *of.topics, of.node, *of.shared, *of.upstream

    @property
    def path(self) -> str:
        """Topic and field as `rostopic echo` takes them: `/odom/twist/twist/linear/x`."""
        return signal_path(self.service.heard, self.provision.field)

    @property
    def output(self) -> str:
        """Topic and field where a substitute writes it: where its node does."""
        return signal_path(self.service.topic, self.provision.field)

    @property  # the last one: from here on the class has a `property` of its own
    def property(self) -> str:
        """The property that it provides."""
        return self.provision.property


@dataclass(frozen=True)
class Signal:
    """A value that a substitute reads or writes.

    `period` in s, None: event-driven; `deadline`: s after which a value is stale, None: it never
    is. `node`: whose messages count, where several services share the topic; empty: anybody's.
    `error`: how far a value that is written is from the truth; None: not known.
    `latched`: who subscribes late gets the newest message. What is written is `gain` * computed +
    `offset`, in the unit of the value.
    """

    topic: str
    field: str
    type: str
    node: str
    period: Optional[float]
    deadline: Optional[float]
    error: Optional[Error] = None
    latched: bool = False
    gain: float = 1.0
    offset: float = 0.0

    @property
    def path(self) -> str:
        """Topic and field as `rostopic echo` takes them: `/odom/twist/twist/linear/x`."""
        return signal_path(self.topic, self.field)


@dataclass(frozen=True)
class Deadlines:
    """The silence that a service is allowed, if it has no deadline of its own.

    That is PERIODS, but at least `minimum` s: a healthy stream of a 10 ms period has gaps of 53 ms
    on a loaded machine.
    """

    minimum: float = 0.25

    PERIODS: ClassVar[float] = 5.0
    ADAPTIVE: ClassVar[float] = 4.0
    """A deadline that is learned is so many times that of others at most."""

    def of(self, service: Service) -> Optional[float]:
        """Return the silence in s until a service has failed, and values are stale; None: never.

        One whose deadline is learned has the usual one until enough is known.
        """
        if service.period is None:
            return None
        if service.deadline is None or isinstance(service.deadline, AdaptiveDeadline):
            return max(self.PERIODS * service.period, self.minimum)
        return service.deadline * service.period

    def longest(self, service: Service) -> Optional[float]:
        """Return the longest silence in s until it has failed, whatever is learned; None: any."""
        usual = self.of(service)
        learned = isinstance(service.deadline, AdaptiveDeadline)
        return self.ADAPTIVE * usual if learned and usual is not None else usual


def signal_path(topic: str, field: str) -> str:
    """Return topic and field as one of the three strings has them, and `rostopic echo`."""
    return topic + "/" + to_path(field)


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
