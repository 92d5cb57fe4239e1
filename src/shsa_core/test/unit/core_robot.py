"""A reconfigurator between a monitor's table that the test writes and the commands that it gives."""
from typing import Any, Dict, List, Optional, Sequence, Tuple, Type, TypeVar, Union

from shsa_core.healing import events
from shsa_core.healing.incident import Incident
from shsa_core.healing.machine import Reconfigurator
from shsa_core.healing.settings import Settings
from shsa_core.language.expression import parse_expression
from shsa_core.model.ontology import Ontology, Property
from shsa_core.model.relation import TransferFunction
from shsa_core.model.som import Service, Som

A, B, C = "/a_node", "/b_node", "/c_node"
C_ = TypeVar("C_")


def function(relation: str, output: str, text: str, quality: float) -> TransferFunction:
    expression = parse_expression(text)
    return TransferFunction(relation, output, expression.names, expression, quality, text=text)


def service(name: str, node: str, needed: bool = False, topic: str = "") -> Service:
    return Service(name, topic or "/" + name, "data", "std_msgs/Float64", node, 0.02, needed=needed)


ONTOLOGY = Ontology(
    properties={name: Property(name) for name in "abc"},
    constants={},
    functions=[function("good", "a", "b + 1", 0.9), function("poor", "a", "2 * c", 0.5)],
)
SOM = Som([service("a", A, needed=True), service("b", B), service("c", C)])


class Robot:
    """A reconfigurator with a monitor's table that the test writes."""

    def __init__(
        self, som: Som = SOM, ontology: Ontology = ONTOLOGY, **settings: Union[int, float]
    ) -> None:
        values: Dict[str, Any] = {"hold_off": 2.0, "start_timeout": 5.0, "pool": 1, **settings}
        self.core = Reconfigurator(ontology, som, Settings(**values))
        self.rows = {}
        self.said: List[events.Command] = []
        for each in som:
            self.row(each.topic, each.node, "healthy", 0.0)
        self.table(1.0)

    def row(
        self, topic: str, node: str, state: str, since: float, first: Optional[float] = None
    ) -> None:
        self.rows[topic, node] = events.PublisherHealth(topic, node, state, since, first, since)

    def table(self, time: float) -> List[events.Command]:
        return self.handle(events.HealthSeen(time, time, tuple(self.rows.values())))

    def fail(self, topic: str, node: str, time: float, kind: str = "node_gone") -> list:
        self.rows.pop((topic, node), None)
        return self.handle(events.FailureSeen(time, topic, node, kind, "it died.", time - 0.02))

    def handle(self, event: events.Event) -> List[events.Command]:
        commands = self.core.handle(event)
        self.said += commands
        return commands

    def heal(self, time: float) -> str:
        """A fails, is killed, and its substitute speaks."""
        start = only(self.fail("/a", A, time), events.StartSubstitute)
        self.handle(events.NodeKilled(time + 0.01, A, True))
        self.handle(events.SubstituteStarted(time + 0.02, start.node, time + 0.001))
        self.row("/a", start.node, "healthy", time + 0.5, first=time + 0.5)
        self.table(time + 0.51)
        return start.node


def only(commands: Sequence[events.Command], kind: Type[C_]) -> C_:
    found = [command for command in commands if isinstance(command, kind)]
    assert len(found) == 1, commands
    return found[0]


def has(commands: Sequence[events.Command], kind: type) -> bool:
    return any(isinstance(command, kind) for command in commands)


def last_incident(commands: Sequence[events.Command]) -> Incident:
    return [c.incident for c in commands if isinstance(c, events.ShowIncident)][-1]


def speaking(robot: Robot) -> Tuple[bool, ...]:
    tables = [c for c in robot.said if isinstance(c, events.ShowSubstitutions)]
    return tuple(row.speaking for row in tables[-1].substitutions)
