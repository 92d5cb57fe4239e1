"""Watched topics, their services and their publishers."""
import re
from dataclasses import dataclass, field
from math import inf
from typing import Callable, Dict, List, Optional, Sequence, Set, Tuple

from shsa_core.derivations.agreement import Suspicion
from shsa_core.model.checks import Check, Checks
from shsa_core.model.health import Key, PublisherHealth, PublisherState
from shsa_core.model.kinds import Kind
from shsa_core.model.samples import IntruderSample
from shsa_core.model.service import AdaptiveDeadline, Deadlines, Service
from shsa_core.model.substitution import CHANGEOVER_S
from shsa_core.monitoring.events import Message
from shsa_core.monitoring.evidence import Evidence, Learned
from shsa_core.monitoring.learned import LearnedDeadline
from shsa_core.monitoring.settings import MISSED_PERIODS, SLOW_PACE

NOBODY = ""
"""The name of the publisher that should be there, while there is none."""
_ANY = Service("", "", "", "", None, (), checks=Checks(each=()))
NUMBER = re.compile(r"(?<!\w)-?\d[\d.e+-]*")


@dataclass(eq=False)
class WatchedService:
    """One service of a topic. Times in s."""

    service: Service
    deadline: float  # the silence that is allowed; inf: any
    due: float  # when it is missed; inf: it came, or it was told that it did not
    formerly: Tuple[str, float] = ("", 0.0)  # well under a former monitor, and when that was told
    came: bool = False  # a message, or somebody connected if it is event-driven
    learned: Learned = field(default_factory=dict)  # of its node's values
    gaps: Optional[LearnedDeadline] = None  # between its messages; None: its deadline is fixed
    heard: bool = False  # a message that could be read
    bridged: int = 0  # so often did a muted substitute fill in for it

    def come(self, publisher: str) -> None:
        """Await nobody any more, but for one that did well under a former monitor."""
        self.came = True
        if self.formerly[0] in ("", publisher):
            self.due, self.formerly = inf, ("", 0.0)

    def judge_by(self, service: Service, deadlines: Deadlines) -> None:
        """Judge by these numbers from now on."""
        self.service, self.deadline = service, deadlines.of(service) or inf
        adaptive, before = service.deadline, self.gaps
        self.gaps = None
        if service.period is not None and isinstance(adaptive, AdaptiveDeadline):
            limits = self.deadline, deadlines.longest(service) or inf
            self.gaps = LearnedDeadline(service.period, adaptive.false_alarms, *limits, before)

    @property
    def allowed(self) -> float:
        """The silence in s that its node is allowed; inf: any."""
        return self.deadline if self.gaps is None else self.gaps.allowed


@dataclass(eq=False)
class Publisher:
    """One life of one publisher of one topic, and all that is held against it. Times in s."""

    topic: "WatchedTopic" = field(repr=False)
    name: str
    since: float
    watched: WatchedService  # `topic.unknown`: nobody can tell, its connection alone is watched
    evidence: Evidence = field(init=False)
    connected: bool = True
    state: PublisherState = PublisherState.UNKNOWN
    kind: Optional[Kind] = None
    detail: str = ""
    first_message: Optional[float] = None
    last_heard: Optional[float] = None
    last_good: Optional[float] = None
    messages: int = 0
    values: Optional[Tuple[Optional[float], ...]] = None  # of the newest message
    silent_since: Optional[float] = None  # its last message, or that it is heard again after one
    excused_until: float = -inf  # by then its silence has an alibi
    reconnects_until: float = -inf  # by then a lost connection is given anew; -inf: none was
    steady: bool = False  # a message came within its deadline once
    intruding_since: float = inf
    suspicions: Dict[str, Suspicion] = field(default_factory=dict)  # by property
    logged: Set[str] = field(default_factory=set)  # what people were told of it
    uri: str = ""  # of its process
    retired: bool = False  # it is a substitute that the table names no more
    filled_in: float = -inf  # when it bridged last, as a muted substitute

    def __post_init__(self) -> None:
        self.evidence = self._new_evidence()

    @property
    def key(self) -> Key:
        """Its topic and its name."""
        return self.topic.name, self.name

    @property
    def service(self) -> Service:
        """The service that it provides; one without a name: nobody can tell."""
        return self.watched.service

    @property
    def allowed(self) -> float:
        """The silence in s that is allowed; inf: any."""
        return self.learned.allowed if self.learned else self.watched.deadline

    @property
    def learned(self) -> Optional[LearnedDeadline]:
        """The knowledge of its gaps, if it is the node of a service whose deadline is learned."""
        return self.watched.gaps if self.service.node == self.name else None

    @property
    def deadline(self) -> float:
        """The moment at which silence becomes a failure; inf: it does not."""
        if self.silent_since is None or self.state is PublisherState.FAILED:
            return inf
        return max(self.silent_since + self.allowed, self.excused_until)

    @property
    def is_healthy(self) -> bool:
        return self.state is PublisherState.HEALTHY

    def interrupt(self, until: float) -> None:
        """Lose its connection, which is given anew by then; once until its next message."""
        if self.last_heard is not None and self.reconnects_until == -inf:
            self.reconnects_until = until

    def resume(self, time: float) -> None:
        """Be connected again, and silent from then on."""
        if time < self.reconnects_until:
            self.silent_since = self.reconnects_until = time
            self.excused_until = -inf

    def provide(self, watched: WatchedService) -> None:
        """Provide a service from now on: what was seen does not count for one that has changed."""
        self.watched, before = watched, self.evidence
        if self.service != before.service:
            self.begin_anew()
            if self.service.name == before.service.name:
                self.evidence.take_messages(before)

    def speaks(self, time: float) -> bool:
        """Tell if its newest message is of now: that of one that hangs, or an old event, is not."""
        lately = CHANGEOVER_S + MISSED_PERIODS * (self.service.period or 0.0)
        return time - (self.last_heard or -inf) <= lately

    @property
    def is_slow(self) -> bool:
        """True if its messages come too seldom, or nearly so."""
        return self.kind is Kind.RATE_LOW or self.evidence.rate.is_below(SLOW_PACE)

    @property
    def was_logged(self) -> bool:
        """True if people were told what it is noted for, but for its numbers."""
        return without_numbers(self.detail) in self.logged

    def begin_anew(self) -> None:
        """Forget the evidence; but what was held up during a silence is as old as it is."""
        before = self.evidence
        self.evidence = self._new_evidence()
        self.evidence.take_habits(before)
        self.suspicions.clear()

    def _new_evidence(self) -> Evidence:
        own = self.name == self.service.node
        return Evidence(self.service, self.watched.learned if own else None)

    def become(
        self, time: float, state: PublisherState, kind: Optional[Kind] = None, detail: str = ""
    ) -> None:
        """Enter a state."""
        self.state, self.since, self.kind, self.detail = state, time, kind, detail
        self.excused_until = -inf

    def note_message(self, message: Message) -> None:
        """Count a message."""
        time, self.values = message.time, message.values
        self.messages += 1
        if self.last_heard is not None and time - self.last_heard <= self.allowed:
            self.steady = True
        self.last_heard = self.silent_since = time
        self.excused_until = self.reconnects_until = -inf
        if self.first_message is None:
            self.first_message = time

    def row(self, ours: Callable[[float], float]) -> PublisherHealth:
        """Return its row in the table, with `ours` of its moments."""
        moments = self.first_message, self.last_good
        first_message, last_good = (None if each is None else ours(each) for each in moments)
        whose = self.topic.name, self.name, self.state, ours(self.since)
        row = (*whose, first_message, last_good, self.kind, self.detail)
        return PublisherHealth(*row, self.service.name, uri=self.uri)


@dataclass(eq=False)
class WatchedTopic:
    """One watched topic: its services by name, and its publishers; while there are none, NOBODY."""

    name: str
    subscribed: bool = False  # who publishes it can be heard
    heard_from: float = inf  # when that began, in s
    there: Set[str] = field(default_factory=set)  # who was met as it began
    services: Dict[str, WatchedService] = field(default_factory=dict)
    publishers: Dict[str, Publisher] = field(default_factory=dict)
    nodes: Dict[str, WatchedService] = field(default_factory=dict)
    unknown: WatchedService = field(default_factory=lambda: WatchedService(_ANY, inf, inf))
    intruder_checks: Tuple[Check, ...] = ()

    def serve(
        self, services: Sequence[Service], deadlines: Deadlines, due: float
    ) -> List[WatchedService]:
        """Carry these services from now on; return those that are new."""
        old, self.services = self.services, {}
        for service in services:
            watched = old.get(service.name)
            if watched is None or watched.service.event_driven is not service.event_driven:
                watched = WatchedService(service, inf, due)
            watched.judge_by(service, deadlines)
            self.services[service.name] = watched
        self.nodes = {watched.service.node: watched for watched in self.services.values()}
        self.intruder_checks = tuple(
            check for s in services for check in s.checks.each if check.sample is IntruderSample
        )
        return [each for name, each in self.services.items() if each is not old.get(name)]

    def service_of(self, publisher: str, substituted: str) -> WatchedService:
        """Return the service of a publisher: its own, that `substituted`, or the only one."""
        alone = next(iter(self.services.values())) if len(self.services) == 1 else self.unknown
        return self.nodes.get(publisher) or self.services.get(substituted) or alone

    def healthy(self) -> List[Publisher]:
        """Return the healthy publishers."""
        return [p for p in self.publishers.values() if p.state is PublisherState.HEALTHY]

    def feeding(self, time: float) -> List[Publisher]:
        """Return those whose messages are read; the last one of the dead is, if none is healthy."""
        alone = not self.healthy()
        return [p for p in self.publishers.values() if alone or p.is_healthy or p.speaks(time)]


def without_numbers(text: str) -> str:
    """Return a text without its numbers; those that are part of a name stay."""
    return NUMBER.sub("", text)
