"""A robot as it really is, beside what healing believes of it."""
import heapq
from dataclasses import dataclass, field
from random import Random
from typing import Any, Callable, Dict, FrozenSet, List, Set, Tuple

from core_robot import function
from shsa_core.healing import events
from shsa_core.healing.events import Where
from shsa_core.healing.machine import Reconfigurator
from shsa_core.healing.settings import Settings
from shsa_core.model.health import PublisherHealth, PublisherState
from shsa_core.model.kinds import Kind, Policy, Standby
from shsa_core.model.ontology import Ontology, Property
from shsa_core.model.service import Provision, Service
from shsa_core.model.som import Som
from shsa_core.model.substitution import Substitution

GOOD, WRONG, SILENT, GONE, MUTED = "good", "wrong", "silent", "gone", "muted"
DELAYS_S = {GOOD: 0.1, WRONG: 0.06, SILENT: 1.0, GONE: 0.01, MUTED: 0.0}
"""The longest time that the monitor takes to see it."""
KINDS = {WRONG: Kind.OUT_OF_RANGE, SILENT: Kind.SILENT, GONE: Kind.NODE_GONE}
SETTLED_S = 12.0


@dataclass
class Plant:
    """The world: nodes that are up, values of each topic's original, running substitutes."""

    som: Som
    up: Dict[str, bool]
    says: Dict[str, str]  # by service: what its original would say if its node were up
    rows: Dict[str, Substitution] = field(default_factory=dict)  # substitutes that run

    def original(self, service: Service) -> str:
        return self.says[service.name] if self.up[service.node] else GONE

    def substitute(self, node: str, seen: FrozenSet[str] = frozenset()) -> str:
        """Return the data of a substitute: good only while all of its inputs are good."""
        row = self.rows[node]
        if not row.publishing:
            return MUTED
        inputs = {self.topic(signal.topic, seen | {node}) for signal in row.inputs}
        return WRONG if WRONG in inputs else SILENT if inputs - {GOOD} else GOOD

    def topic(self, topic: str, seen: FrozenSet[str] = frozenset()) -> str:
        """Return what consumers hear: one wrong voice spoils a topic."""
        (service,) = self.som.of_topic(topic)
        voices = {self.original(service)}
        for node, row in self.rows.items():
            if row.service == service.name and node not in seen:
                voices.add(self.substitute(node, seen))
        return WRONG if WRONG in voices else GOOD if GOOD in voices else SILENT

    def good(self) -> Set[str]:
        """The needed services with good data."""
        return {each.name for each in self.som.needed() if self.topic(each.topic) == GOOD}

    def healthy(self, node: str) -> bool:
        """Return whether a node does all that it is for."""
        return self.up[node] and all(self.says[s.name] == GOOD for s in self.som if s.node == node)

    def frozen(self) -> "Plant":
        """The same robot from now on without any more healing."""
        return Plant(self.som, dict(self.up), dict(self.says), dict(self.rows))

    def fault(self, what: str, names: List[str]) -> None:
        """Something happens to a node (`die`, `start`) or to services (what they say)."""
        for name in names:
            if what in ("die", "start"):
                self.up[name] = what == "start"
            else:
                self.says[name] = what
        if what == "start":
            self.says.update({each.name: GOOD for each in self.som if each.node in names})


class HealedPlant:
    """A plant with a monitor and the healing core.

    Events come in any order that delays can make of them. `killed`: the nodes that healing ended,
    and whether each was healthy then.
    """

    def __init__(self, ontology: Ontology, som: Som, random: Random, **settings: Any) -> None:
        self.random = random
        self.now = 100.0
        self.plant = Plant(
            som, {each.node: True for each in som}, {each.name: GOOD for each in som}
        )
        self.core = Reconfigurator(ontology, som, Settings(**settings))
        self.som = som
        self.protected = {node for node in self.plant.up if random.random() < 0.1}
        self.killed: List[Tuple[str, bool]] = []
        self.asked: Set[str] = set()  # nodes whose substitution somebody asked for
        self._told: Dict[Tuple[str, str], PublisherHealth] = {}
        self._due: List[Tuple[float, int, Callable[[], None]]] = []
        self._count = 0
        for each in som:
            self._tell(each.topic, each.node, GOOD, 0.0)
        self.run(3.0)

    def episode(self, what: str, names: List[str]) -> None:
        """Something happens, and healing settles."""
        self.plant.fault(what, names)
        self.sense()
        self.run(SETTLED_S)

    def request(self, service: Service) -> None:
        """Somebody wants a substitute."""
        self.asked.add(service.node)
        self.hear(events.SubstituteRequested(self.now, service.name))
        self.run(SETTLED_S)

    def run(self, seconds: float) -> None:
        """Let time pass, with all that is due in it."""
        end = self.now + seconds
        while True:
            while self.core.plans_ahead:
                self.hear(events.Idle(self.now))
            tick = self.core.deadline
            at = self._due[0][0] if self._due else end
            if tick < min(at, end):
                self.now = max(self.now, tick)
                self.hear(events.Tick(self.now))
            elif at < end:
                self.now = max(self.now, at)
                heapq.heappop(self._due)[2]()
            else:
                self.now = end
                return

    def hear(self, event: events.Event) -> None:
        for command in self.core.handle(event):
            act = getattr(self, "_" + type(command).__name__, None)
            if act is not None:
                act(command)

    def sense(self) -> None:
        """The monitor will see what is not as it was told."""
        for topic, node, actual in self._actual():
            told = self._told.get((topic, node))
            if actual != self._state(told):
                delay = self.random.uniform(0.1, 1.0) * DELAYS_S[actual]
                self.later(delay, self._seer(topic, node, actual))

    def later(self, delay: float, work: Callable[[], None]) -> None:
        self._count += 1
        heapq.heappush(self._due, (self.now + delay, self._count, work))

    def _actual(self) -> List[Tuple[str, str, str]]:
        found = [(s.topic, s.node, self.plant.original(s)) for s in self.som]
        for node, row in self.plant.rows.items():
            if row.service:
                found.append((row.topics[0], node, self.plant.substitute(node)))
        return found

    @staticmethod
    def _state(told: Any) -> str:
        if told is None:
            return ""
        if told.state is PublisherState.HEALTHY:
            return GOOD
        return MUTED if told.kind is None else {kind: s for s, kind in KINDS.items()}[told.kind]

    def _seer(self, topic: str, node: str, actual: str) -> Callable[[], None]:
        def see() -> None:
            if (topic, node, actual) in self._actual():
                if actual != self._state(self._told.get((topic, node))):
                    self._tell(topic, node, actual, self.now)

        return see

    def _tell(self, topic: str, node: str, actual: str, since: float) -> None:
        before = self._told.get((topic, node))
        was_good = self._state(before) == GOOD
        if actual == GOOD:
            row = PublisherHealth(topic, node, PublisherState.HEALTHY, since, since, since)
        elif actual == MUTED:
            row = PublisherHealth(topic, node, PublisherState.UNKNOWN, since, None, None)
        else:
            kind = KINDS[actual]
            failed, detail = PublisherState.FAILED, actual + "."
            row = PublisherHealth(topic, node, failed, since, None, None, kind, detail)
            if was_good or actual == WRONG:
                self.hear(events.FailureSeen(since, "", topic, node, kind, detail))
        self._told[topic, node] = row
        self.hear(events.HealthSeen(self.now, (row,)))

    # What healing does

    def _end(self, node: str, uri: str) -> None:
        if self.plant.up.get(node):
            innocent = self.plant.healthy(node) and node not in self.asked
            self.killed.append((node, innocent))
            self.plant.up[node] = False
            self.sense()
        self.hear(events.NodeLeft(self.now, node, uri))

    def _LearnNode(self, command: events.LearnNode) -> None:
        why = "it is required" if command.node in self.protected else ""
        learned = events.NodeLearned(self.now, command.node, True, why)
        self.later(0.0, lambda: self.hear(learned))

    def _FindNode(self, command: events.FindNode) -> None:
        def answer() -> None:
            up = self.plant.up.get(command.node)
            where = Where.NOWHERE if up is None else Where.HERE if up else Where.DEAD
            self.hear(events.NodeFound(self.now, command.node, where, uri=command.uri))

        self.later(self.random.uniform(0.001, 0.01), answer)

    def _AskToLeave(self, command: events.AskToLeave) -> None:
        end = lambda: self._end(command.node, command.uri)
        self.later(self.random.uniform(0.001, 0.2), end)

    def _EndProcess(self, command: events.EndProcess) -> None:
        self.later(0.001, lambda: self._end(command.node, command.uri))

    def _RestartNode(self, command: events.RestartNode) -> None:
        def start() -> None:
            self.plant.fault("start", [command.node])
            self.sense()

        self.hear(events.NodeRestarted(self.now, command.node))
        self.later(0.5, start)

    def _ShowSubstitutions(self, command: events.ShowSubstitutions) -> None:
        def heed() -> None:
            for node in command.removed:
                row = self.plant.rows.pop(node, None)
                if row is not None and row.service:
                    self._told.pop((row.topics[0], node), None)
                    self.hear(events.HealthSeen(self.now, (), ((row.topics[0], node),)))
            self.plant.rows.update({row.node: row for row in command.rows if row.node})
            self.sense()

        self.later(0.0, heed)


NAMES = "abcdefgh"


def any_robot(random: Random) -> Tuple[Ontology, Som]:
    """A robot of up to eight services on up to five nodes, and up to ten relations."""
    names = NAMES[: random.randint(3, 8)]
    nodes = [f"/n{number}" for number in range(random.randint(2, 5))]
    functions = []
    for number in range(random.randint(2, 10)):
        output, *inputs = random.sample(names, random.randint(2, 3))
        text, quality = " + ".join(inputs), random.choice((0.9, 0.7, 0.5))
        functions.append(function(f"r{number}", output, text, quality))
    policies = [*[Policy.SUBSTITUTE] * 6, *Policy]
    services = []
    for number, name in enumerate(names):
        property_ = name if random.random() < 0.85 else random.choice(names)
        services.append(
            Service(
                name=name,
                topic="/" + name,
                type="std_msgs/Float64",
                node=nodes[number] if number < len(nodes) else random.choice(nodes),
                period=0.02,
                provides=(Provision(property_, "data"),),
                needed=random.random() < 0.6,
                standby=random.choice(list(Standby)),
                policy=random.choice(policies),
            )
        )
    ontology = Ontology({name: Property(name) for name in names}, {}, functions)
    return ontology, Som(services)
