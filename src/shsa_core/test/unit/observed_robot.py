"""A reconfigurator whose every command is checked, for machines that tell it any story."""
from typing import Dict, List, Optional, Set, Tuple

from hypothesis.stateful import RuleBasedStateMachine

from random_models import NODES
from shsa_core.healing import events
from shsa_core.healing.incident import SUBSTITUTED, Incident, State
from shsa_core.healing.machine import Reconfigurator
from shsa_core.healing.records import Record, ServiceRecord
from shsa_core.healing.service import ServiceMachine
from shsa_core.healing.settings import ANSWER_S, Settings
from shsa_core.journal.codec import Codec
from shsa_core.model.health import PublisherHealth, PublisherState
from shsa_core.model.kinds import Kind, OnPartition
from shsa_core.model.ontology import Ontology
from shsa_core.model.som import Som
from shsa_core.model.substitution import Substitution
from shsa_core.planning.pool import IdleProcess

PUBLISHED = (State.HEALING, State.HEALED, State.SAFE)


class ObservedRobot(RuleBasedStateMachine):
    """An observer beside the reconfigurator, of what it was told and what it said."""

    sound = False  # no event was refused
    taken_up = False  # the reconfigurator has started

    def begin(self, ontology: Ontology, som: Som, chosen: Settings, left: Set[str]) -> None:
        self.core = Reconfigurator(ontology, som, chosen)
        self.ontology, self.som, self.settings = ontology, som, chosen
        self.written: Dict[str, Record] = {}
        self.lives_for: Optional[int] = None  # commands that are carried out yet
        self.now = 100.0
        self.health: Dict[Tuple[str, str], PublisherHealth] = {}
        self.lives: Dict[str, int] = {}  # of each node; 0: of which nobody can tell
        self.failed: Set[Tuple[str, str]] = set()  # topic and node, told since it was healthy
        self.accused: Set[str] = set()  # nodes that the event at hand gives evidence against
        self.shown: Dict[str, Substitution] = {}
        self.states: Dict[str, events.ServiceState] = {}
        self.incidents: Dict[str, Incident] = {}
        self.closed: Set[str] = set()
        self.named: Set[str] = set()  # substitutes that were written down
        self.used: Set[str] = set(left)
        self.running: Set[str] = set()
        self.restarted: Set[str] = set()  # nodes that end with those who started them first
        self.ending = False
        self.orphans = left
        self.hear(events.Started(self.now, tuple(sorted(left))))
        self.rows([(each.topic, each.node, PublisherState.HEALTHY, 1.0) for each in som])

    # What it says

    def hear(self, event: events.Event) -> None:
        """Hand over an event, and check every command and what holds after it."""
        self.sound = False
        if isinstance(event, events.NodeRestarted):
            self.restarted.add(event.node)
        for command in self.core.handle(event):
            if self.lives_for is not None and not isinstance(command, events.WriteDown):
                self.lives_for -= 1
                if self.lives_for < 0:
                    self.die("all")
                    return
            check = getattr(self, "on_" + type(command).__name__, None)
            if check is not None:
                check(command)
        self.accused = set()
        self.taken_up = self.taken_up or isinstance(event, events.Started)
        self.core.validate()
        if not self.ending:  # then nothing is followed any more
            self.check_tables()
            self.check_publishing()
        if isinstance(event, events.Tick):
            due = self.core.deadline
            assert due > self.now, "a tick that has done nothing"
        self.sound = True

    def die(self, survivors: str) -> None:
        """The reconfigurator is killed, and the next one takes up what it has written down."""
        self.lives_for = None
        if survivors != "all":
            self.running = {node for node in self.running if survivors == "some" and "a" in node}
        codec = Codec(Record)
        records = tuple(codec.decode(codec.encode(each), "", "") for each in self.written.values())
        before, self.shown, self.states = dict(self.incidents), {}, {}
        self.taken_up = False
        self.core = Reconfigurator(self.ontology, self.som, self.settings)
        self.incidents, self.written = {}, {}
        self.orphans = self.orphans | {incident.faulty_node for incident in before.values()}
        self.hear(events.Started(self.now, (), (), records, tuple(sorted(self.running))))
        if self.ending:
            self.hear(events.LaunchEnding(self.now))
        for name, incident in () if self.ending else before.items():  # nothing else was followed
            after = self.incidents.get(name)
            assert after is not None and after.id == incident.id or name in self.closed
            self.closed.discard(name)

    def on_WriteDown(self, command: events.WriteDown) -> None:
        self.written.update({each.key: each for each in command.records})
        written = [each for each in command.records if isinstance(each, ServiceRecord)]
        self.named |= {each.substitution.node for each in written if each.substitution}
        self.named |= {each.node for each in command.records if isinstance(each, IdleProcess)}
        for key in command.removed:
            del self.written[key]

    def on_StartSubstitute(self, command: events.StartSubstitute) -> None:
        assert command.node not in self.used, "a name is used twice"
        self.used.add(command.node)
        self.running.add(command.node)

    def on_StopNode(self, command: events.StopNode) -> None:
        assert command.node in self.used | self.named | self.restarted
        self.running.discard(command.node)

    def on_FindNode(self, command: events.FindNode) -> None:
        open_ = {incident.faulty_node for incident in self.incidents.values()}
        told = {node for _, node in self.failed}
        assert command.node in self.accused | told | open_ | self.orphans, "it is innocent"

    def on_RestartNode(self, command: events.RestartNode) -> None:
        blaming = [each for each in self.incidents.values() if each.faulty_node == command.node]
        services = [self.som.services[each.service] for each in blaming]
        assert any(s.policy.restarts and s.node == command.node for s in services)

    def on_RunCommand(self, command: events.RunCommand) -> None:
        assert command.words == self.som.services[command.service].last_resort.command != ()

    def on_ShowSubstitutions(self, command: events.ShowSubstitutions) -> None:
        for key in command.removed:
            del self.shown[key]
        self.shown.update({row.node or row.service: row for row in command.rows})

    def on_ShowSom(self, command: events.ShowSom) -> None:
        for key in command.removed:
            del self.states[key]
        self.states.update({row.service.name: row for row in command.rows})

    def on_ShowIncident(self, command: events.ShowIncident) -> None:
        incident = command.incident
        self.incidents[incident.service] = incident
        if incident.state is State.ENDED:
            del self.incidents[incident.service]
            self.closed.add(incident.service)

    # What always holds

    def check_tables(self) -> None:
        """Check that what was told in changes is how things stand, looked at anew."""
        core = self.core
        availability, planner, pool = (
            core.robot.availability,
            core.robot.planner,
            core._processes.pool,
        )
        assert self.states == {
            each.name: availability.state(core.robot.som, each, core._core.missing(each.name))
            for each in core.robot.som
        }
        turns = {name: self.shown[name].bridge for name in pool.processes}
        rows = {
            name: Substitution(name, "", (), "", (), host=idle.host, bridge=turns[name])
            for name, idle in pool.processes.items()
        }
        here = [turns[name] for name, idle in pool.processes.items() if not idle.host]
        assert sum(turns.values()) == sum({turn for turn in here if turn >= ANSWER_S})
        rows.update({name: core._processes.wanted.rows[name] for name in pool.hosts})
        for name, healing in core.services.items():
            assert self.incidents.get(name) == core.incident(name)
            plan = healing.substitute.plan
            if plan is not None:
                service = core.robot.som.services[name]
                own = core.robot.health.row((service.topic, service.node))
                elsewhere = service.host and core.robot.computers.name(service.host)
                parted = bool(healing.substitute.host or elsewhere)
                waits = healing.state in SUBSTITUTED and not healing.publishes
                speaks = waits or healing.state in (State.WELL, State.RETURNING)
                alone = len(core.robot.som.of_topic(service.topic)) == 1
                beside = healing.substitute.host == core.robot.host_of(service.node)
                bridges = speaks and alone and beside and plan.computes
                bridges = bridges and service.policy.substitutes
                silent = healing.yields and not core.robot.maintained
                awaited = silent and healing.incident.faulty_node == service.node
                named = awaited or (own is not None and not own.has_failed)
                rows[healing.node] = Substitution(
                    healing.node,
                    name,
                    planner.signals(plan.inputs),
                    plan.program.code,
                    planner.outputs(plan),
                    plan.relations,
                    plan.quality,
                    healing.publishes,
                    self._original(healing),
                    host=healing.substitute.host,
                    on_partition=service.on_partition if parted else OnPartition.WAIT,
                    yields=healing.yields,
                    provider=service.node if named else "",
                    bridge=(service.bridges or 0.0) * (service.period or 0.0) if bridges else 0.0,
                )
        assert self.shown == rows
        assert set(core._processes.nodes) <= self.running
        if self.taken_up:
            assert self.reached() <= {node for node in self.shown if node in self.used}

    def _original(self, healing: ServiceMachine) -> str:
        node = healing.incident.faulty_node
        gone = healing.incident.killed is not None or healing.accusation.kind is Kind.NODE_GONE
        row = self.core.robot.health.row((healing.spec.topic, node))
        unfit = row is not None and row.detail and not (row.is_well or row.has_failed)
        return node if gone and not unfit else ""

    def reached(self) -> Set[str]:
        """The processes that run where they can be told to end."""
        return self.running

    def check_publishing(self) -> None:
        publish = [row for row in self.shown.values() if row.publishing]
        assert len({row.service for row in publish}) == len(publish), "two for one service"
        for row in publish:
            incident = self.incidents.get(row.service)
            assert incident is not None and incident.state in PUBLISHED
            assert row.node == incident.substitute

    # What happens

    def rows(self, told: List[Tuple[str, str, PublisherState, float]], whole: bool = False) -> None:
        """The monitor tells of publishers: topic, node, state, and for how long so."""
        changed = []
        for topic, node, state, age in told:
            kind = Kind.SILENT if state is PublisherState.FAILED else None
            since = self.now - age
            life = self.lives.get(node, 1)
            uri = f"http://here:{life}/" if life else ""
            told_of = topic, node, state, since, since, since, kind, "as told"
            row = PublisherHealth(*told_of, uri=uri)
            self.health[topic, node] = row
            changed.append(row)
            if kind is not None:
                self.accuse(topic, node)
            else:
                self.failed.discard((topic, node))
        sent = tuple(self.health.values()) if whole else tuple(changed)
        if whole:
            self.failed &= set(self.health)
            for row in sent:
                if row.state is PublisherState.FAILED:
                    self.accuse(row.topic, row.publisher)
        self.hear(events.HealthSeen(self.now, sent, whole=whole))

    def accuse(self, topic: str, node: str) -> None:
        nodes = [node] if node else [each.node for each in self.som.of_topic(topic)]
        self.failed.update((topic, each) for each in nodes)

    def nodes(self) -> List[str]:
        return [*NODES, "", *sorted(self.used)]
