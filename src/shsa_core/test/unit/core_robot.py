"""A reconfigurator between a table that the test writes and the commands that it gives."""
from dataclasses import replace
from typing import Any, Dict, List, Optional, Sequence, Set, Tuple, Type, TypeVar, Union

from shsa_core.healing import events
from shsa_core.healing.incident import Incident
from shsa_core.healing.kill import KILL_EVENTS
from shsa_core.healing.machine import Reconfigurator
from shsa_core.healing.records import Record
from shsa_core.healing.settings import Settings
from shsa_core.language.expression import parse_law
from shsa_core.model.health import PublisherHealth, PublisherState
from shsa_core.model.kinds import Kind
from shsa_core.model.ontology import Ontology, Property, TransferFunction
from shsa_core.model.service import Provision, Service
from shsa_core.model.som import Som
from shsa_core.model.substitution import Program, Substitution, row_key

A, B, C = "/a_node", "/b_node", "/c_node"
C_ = TypeVar("C_")


def function(relation: str, output: str, text: str, quality: float) -> TransferFunction:
    expression = parse_law(text)
    return TransferFunction(relation, output, expression.names, expression, quality, text=text)


def service(name: str, node: str, needed: bool = False, topic: str = "", **more: Any) -> Service:
    """A service of the property `name`, and of the same name."""
    provides = (Provision(name, "data"),)
    topic = topic or "/" + name
    return Service(name, topic, "std_msgs/Float64", node, 0.02, provides, needed=needed, **more)


ONTOLOGY = Ontology(
    properties={name: Property(name) for name in "abc"},
    constants={},
    functions=[function("good", "a", "b + 1", 0.9), function("poor", "a", "2 * c", 0.5)],
)
SOM = Som([service("a", A, needed=True), service("b", B), service("c", C)])
SHARED = Som([service("a", A, needed=True), service("d", A, needed=True), service("b", B)])
WITH_D = Ontology(
    properties={name: Property(name) for name in "abcd"},
    constants={},
    functions=[*ONTOLOGY.functions],
)
BOTH = replace(WITH_D, functions=[*ONTOLOGY.functions, function("d_by_b", "d", "b", 0.9)])


def changed(som: Som, name: str, **changes: Any) -> Som:
    """Return a SOM in which the service of that name is different."""
    return som.with_services(replace(e, **changes) if e.name == name else e for e in som)


class Robot:
    """A reconfigurator with a monitor's table that the test writes.

    Its invariants hold after every event.
    """

    def __init__(
        self,
        som: Som = SOM,
        ontology: Ontology = ONTOLOGY,
        host: str = "",
        learned: bool = True,
        **settings: Union[int, float],
    ) -> None:
        values: Dict[str, Any] = {"hold_off": 2.0, "pool": 1, **settings}
        self.core = Reconfigurator(ontology, som, Settings(**values), host=host)
        self.som = som
        self.rows: Dict[Tuple[str, str], PublisherHealth] = {}
        self.said: List[events.Command] = []
        self.written: Dict[str, Record] = {}
        self.gone: Set[str] = set()
        self.shown: Dict[str, Substitution] = {}
        for each in som:
            self.row(each.topic, each.node, "healthy", 0.0)
        self.table(1.0)
        self.core.robot.health.startable.update(each.node for each in som if learned)
        self.idle(1.0)

    def row(
        self,
        topic: str,
        node: str,
        state: str,
        since: float,
        first: Optional[float] = None,
        **more: Any,
    ) -> None:
        """The monitor's row of a publisher, with `more` fields, as the address of its life."""
        row = PublisherHealth(topic, node, PublisherState(state), since, first, since)
        self.rows[topic, node] = replace(row, **more)

    def table(self, time: float) -> List[events.Command]:
        """The monitor sends its whole table."""
        return self.handle(events.HealthSeen(time, tuple(self.rows.values()), whole=True))

    def idle(self, time: float) -> List[events.Command]:
        """There is time to make every plan that is stale."""
        commands: List[events.Command] = []
        while self.core.plans_ahead:
            commands += self.handle(events.Idle(time))
        return commands

    def failure(
        self, topic: str, node: str, time: float, kind: str, detail: str, last_good: Optional[float]
    ) -> List[events.Command]:
        """The monitor reports a failure."""
        (self.gone.add if kind == "node_gone" else self.gone.discard)(node)
        return self.handle(events.FailureSeen(time, "", topic, node, Kind(kind), detail, last_good))

    def fail(
        self, topic: str, node: str, time: float, kind: str = "node_gone", runs: bool = False
    ) -> List[events.Command]:
        """A publisher fails, and is not in the next table; one that is gone may still run."""
        self.rows.pop((topic, node), None)
        commands = self.failure(topic, node, time, kind, "it died.", time - 0.02)
        if runs:
            self.gone.discard(node)
        return commands

    def killed(self, time: float, node: str, certain: bool = True) -> List[events.Command]:
        """The kill of a node is over; one that was gone had died, unless it still runs."""
        if certain:
            where = events.Where.DEAD if node in self.gone else events.Where.HERE
            commands = self.handle(events.NodeFound(time, node, where, rate=0.0))
            return commands + self.handle(events.NodeLeft(time, node))
        commands = self.handle(events.NodeFound(time, node, events.Where.STOPPED))
        return commands + self.handle(events.ProcessUntouchable(time, node))

    def handle(self, event: events.Event) -> List[events.Command]:
        """An event, and what the reconfigurator wants done, once that is written down.

        An answer of a kill is about the life that is killed, unless it names another.
        """
        if isinstance(event, KILL_EVENTS) and not event.uri:
            event = replace(event, uri=self.core.robot.health.dying.get(event.node, ""))
        commands = self.core.handle(event)
        self.core.validate()
        first = commands[0] if commands else None
        if isinstance(first, events.WriteDown):
            self.written.update({each.key: each for each in first.records})
            for key in first.removed:
                del self.written[key]
            del commands[0]
        assert not has(commands, events.WriteDown), "it comes first"
        self.said += commands
        for command in commands:
            if isinstance(command, events.ShowSubstitutions):
                for key in command.removed:
                    self.shown.pop(key)
                self.shown.update({row_key(row): row for row in command.rows})
        return commands

    def connects(self, time: float, topic: str, node: str) -> None:
        """The monitor is connected to a process that has published nothing yet."""
        self.row(topic, node, "unknown", time)
        self.table(time)

    def back(self, time: float) -> List[events.Command]:
        """The original of /a publishes again."""
        self.row("/a", A, "healthy", time)
        return self.table(time)

    def heard(self, node: str, time: float) -> List[events.Command]:
        """The first message of a substitute of /a arrives."""
        self.row("/a", node, "healthy", time, first=time)
        return self.table(time)

    def working(self) -> List[Substitution]:
        """The rows of the substitutes that have a program."""
        return [row for row in self.shown.values() if row.node and not row.idle]

    def idle_rows(self) -> List[Substitution]:
        """The rows of the idle processes."""
        return [row for row in self.shown.values() if row.node and row.idle]

    def heal(self, time: float, topic: str = "/a", node: str = A) -> str:
        """A node fails, is killed, and its substitute publishes."""
        start = only(self.fail(topic, node, time), events.StartSubstitute)
        self.killed(time + 0.01, node)
        self.handle(events.SubstituteStarted(time + 0.02, start.node))
        self.row(topic, start.node, "healthy", time + 0.5, first=time + 0.5)
        self.table(time + 0.51)
        return start.node


def only(commands: Sequence[events.Command], kind: Type[C_]) -> C_:
    found = [command for command in commands if isinstance(command, kind)]
    assert len(found) == 1, commands
    return found[0]


def program_of(commands: Sequence[events.Command]) -> Program:
    """The program of the only substitute that is started."""
    program = only(commands, events.StartSubstitute).program
    assert program is not None
    return program


def assigned(commands: Sequence[events.Command]) -> str:
    """The only process that ran already and is given a program by the table."""
    started = {each.node for each in commands if isinstance(each, events.StartSubstitute)}
    tables = [each for each in commands if isinstance(each, events.ShowSubstitutions)]
    nodes = {row.node for table in tables for row in table.rows if row.node and row.code}
    nodes -= started
    (node,) = nodes
    return node


def has(commands: Sequence[events.Command], kind: type) -> bool:
    return any(isinstance(command, kind) for command in commands)


def last_incident(commands: Sequence[events.Command]) -> Incident:
    return [c.incident for c in commands if isinstance(c, events.ShowIncident)][-1]


def publishing(robot: Robot) -> Tuple[bool, ...]:
    """Return whether each substitute that has a program publishes."""
    return tuple(row.publishing for row in robot.working())


def reads(robot: Robot, node: str) -> Tuple[str, ...]:
    """Return the inputs of a substitute."""
    return tuple(signal.path for signal in robot.shown[node].inputs)
