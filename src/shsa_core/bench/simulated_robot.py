"""A robot of any size around the pure reconfigurator, without ROS.

Its monitor and its graph answer at once.
"""
import gc
import sys
from collections import deque
from time import thread_time
from types import FrameType
from typing import Any, Callable, Deque, Dict, List, Optional, Tuple

from shsa_core.healing import events
from shsa_core.healing.machine import Reconfigurator
from shsa_core.healing.settings import Settings
from shsa_core.language.expression import parse_law
from shsa_core.model.health import PublisherHealth, PublisherState
from shsa_core.model.kinds import Kind, Standby
from shsa_core.model.ontology import Ontology, Property, TransferFunction
from shsa_core.model.service import Provision, Service
from shsa_core.model.som import Som

MOST_PLANS = 100_000


def models(size: int, standby: Standby, topics_a_node: int = 1) -> Tuple[Ontology, Som]:
    """Make a ring: each property follows from either neighbour, every service is needed."""
    names = [f"p{number}" for number in range(size)]
    functions = []
    for number, name in enumerate(names):
        for relation, other, quality in (("next", number + 1, 0.9), ("previous", number - 1, 0.8)):
            law = parse_law(f"2*{names[other % size]}")
            functions.append(
                TransferFunction(
                    f"{relation}_{number}", name, law.names, law, quality, text=law.text
                )
            )
    services = [
        Service(
            name=name,
            topic=f"/sensors/{name}",
            type="std_msgs/Float64",
            node=f"/node_{number // topics_a_node}",
            period=0.02,
            provides=(Provision(name, "data", range=(-100.0, 100.0)),),
            needed=True,
            standby=standby,
        )
        for number, name in enumerate(names)
    ]
    return Ontology({name: Property(name) for name in names}, {}, functions), Som(services)


class Robot:
    """A reconfigurator, with a monitor and a graph that answer at once."""

    def __init__(
        self,
        size: int,
        standby: Standby,
        topics_a_node: int = 1,
        settings: Settings = Settings(pool=2),
    ) -> None:
        self.time = 100.0
        self.said: List[events.Command] = []
        self._rows: Dict[Tuple[str, str], PublisherHealth] = {}
        self._topics: Dict[str, str] = {}  # where a substitute publishes
        self._waiting: Deque[events.Event] = deque()
        self._answers: Dict[type, Callable[[Any], Optional[events.Event]]] = {
            events.LearnNode: lambda c: events.NodeLearned(self.time, c.node, True),
            events.FindNode: lambda c: events.NodeFound(
                self.time, c.node, events.Where.DEAD, uri=c.uri
            ),
            events.AskToLeave: lambda c: events.NodeLeft(self.time, c.node, c.uri),
            events.EndProcess: lambda c: events.NodeLeft(self.time, c.node, c.uri),
            events.StartSubstitute: self._started,
            events.ShowSubstitutions: self._shown,
        }
        ontology, self.som = models(size, standby, topics_a_node)
        self._of_node: Dict[str, List[Service]] = {}
        for service in self.som:
            self._of_node.setdefault(service.node, []).append(service)
        self.setup = {"ontology": ontology, "som": self.som, "settings": settings}
        start = thread_time()
        self.core = Reconfigurator(**self.setup)  # type: ignore[arg-type]
        self.startup = thread_time() - start
        rows = [
            PublisherHealth(s.topic, s.node, PublisherState.HEALTHY, 1.0, 1.0, 1.0)
            for s in self.som
        ]
        self.startup += self.send(events.Started(self.time))
        self.startup += self.send(events.HealthSeen(self.time, tuple(rows), whole=True))
        self.startup += self.settle() + sum(self.plans())

    def handle(self, event: events.Event) -> float:
        """One event; the processor time that it takes in s."""
        start = thread_time()
        commands = self.core.handle(event)
        taken = thread_time() - start
        self.said += commands
        for command in commands:
            answer = self._answers.get(type(command), lambda c: None)(command)
            if answer is not None:
                self._waiting.append(answer)
            if isinstance(command, events.StartSubstitute):
                self._waiting.append(events.ProcessPulse(self.time, command.node, True))
        return taken

    def send(self, event: events.Event) -> float:
        """Return an event, and the answers to all that follows from it; the processor time in s."""
        taken = self.handle(event)
        while self._waiting:
            taken += self.handle(self._waiting.popleft())
        return taken

    def settle(self) -> float:
        """Let time pass until nothing is due within a minute."""
        taken, end = 0.0, self.time + 60.0
        while self.core.deadline < end:
            self.time = max(self.time, self.core.deadline)
            taken += self.send(events.Tick(self.time))
        return taken

    def plans(self) -> List[float]:
        """Make every plan that is to be made ahead; the processor time of each in s."""
        taken: List[float] = []
        while self.core.plans_ahead:
            taken.append(self.send(events.Idle(self.time)))
            assert len(taken) < MOST_PLANS, "there is no end to plans"
        return taken

    def row(self, topic: str, node: str, state: PublisherState) -> PublisherHealth:
        """Return a row of health as of now."""
        last = self.time if state is PublisherState.HEALTHY else self.time - 0.02
        kind = Kind.NODE_GONE if state is PublisherState.FAILED else None
        first = self.time if state is PublisherState.HEALTHY else None
        return PublisherHealth(topic, node, state, self.time, first, last, kind)

    def _started(self, command: Any) -> events.Event:
        return events.SubstituteStarted(self.time, command.node)

    def _shown(self, change: events.ShowSubstitutions) -> Optional[events.Event]:
        """Have the substitutes do as the table says, and the monitor see that."""
        rows: List[PublisherHealth] = []
        for row in change.rows:
            if row.node and row.outputs:
                self._topics[row.node] = row.outputs[0].topic
                state = PublisherState.HEALTHY if row.publishing else PublisherState.UNKNOWN
                rows.append(self.row(row.outputs[0].topic, row.node, state))
        removed = tuple((self._topics.pop(n), n) for n in change.removed if n in self._topics)
        if not rows and not removed:
            return None
        return events.HealthSeen(self.time, tuple(rows), removed)

    def fail(self, node: str) -> Tuple[float, float]:
        """Kill a node and have its services taken over.

        Returns the processor time in s of the first event, and of all until the substitutes are
        seen publishing.
        """
        taken: List[float] = []
        for service in self._of_node[node]:
            failure = events.FailureSeen(
                self.time,
                service.name,
                service.topic,
                node,
                Kind.NODE_GONE,
                "the connection was lost",
                self.time - 0.02,
            )
            taken.append(self.handle(failure))
        taken.append(self.send(self._seen(node, PublisherState.FAILED)))
        for service in self._of_node[node]:
            incident = self.core.incident(service.name)
            assert incident is not None and incident.state == "healed", incident
        return taken[0], sum(taken)

    def come_back(self, node: str) -> None:
        """The node is started again, and its substitutes leave."""
        self.send(self._seen(node, PublisherState.HEALTHY))
        self.settle()
        self.plans()
        for service in self._of_node[node]:
            assert self.core.incident(service.name) is None, self.core.incident(service.name)
        self.core.validate()

    def _seen(self, node: str, state: PublisherState) -> events.HealthSeen:
        rows = [self.row(service.topic, node, state) for service in self._of_node[node]]
        return events.HealthSeen(self.time, tuple(rows))


def lines_of(work: Callable[[], object]) -> int:
    """Count the lines of Python that some work executes: the same on any computer."""
    count = 0

    def trace(frame: FrameType, event: str, argument: Any) -> Any:
        nonlocal count
        count += event == "line"
        return trace

    before, collecting = sys.gettrace(), gc.isenabled()
    gc.disable()  # others may have hung Python of their own on a collection
    sys.settrace(trace)
    try:
        work()
    finally:
        sys.settrace(before)  # as that of a coverage run
        if collecting:
            gc.enable()
    return count
