"""Any story of a robot: what its consumers and nodes see, and the core's own invariants."""
from dataclasses import replace
from math import inf
from typing import Any, Dict, List, Optional, Set, Tuple

from hypothesis import settings, strategies as st
from hypothesis.stateful import RuleBasedStateMachine, initialize, precondition, rule

from random_models import LAST_RESORTS, NAMES, NODES, TOPICS, SETTINGS, ontologies, soms
from shsa_core.codegen.plans import Plan, plan_service
from shsa_core.errors import ShsaError
from shsa_core.healing import events
from shsa_core.healing.incident import SUBSTITUTED, Incident, State
from shsa_core.healing.kill import KILL_EVENTS
from shsa_core.healing.machine import Reconfigurator
from shsa_core.healing.records import Record, ServiceRecord
from shsa_core.healing.settings import ANSWER_S, Settings
from shsa_core.journal.codec import Codec
from shsa_core.model.health import PublisherHealth, PublisherState
from shsa_core.model.kinds import Contain, Kind, OnPartition, Policy, Standby
from shsa_core.model.ontology import Ontology
from shsa_core.model.som import Som
from shsa_core.model.substitution import Substitution
from shsa_core.planning.pool import IdleProcess
from shsa_testing.thorough import many

PUBLISHED = (State.HEALING, State.HEALED, State.SAFE)


class AnyRobot(RuleBasedStateMachine):
    """An observer beside the reconfigurator, of what it was told and what it said."""

    sound = False  # no event was refused
    taken_up = False  # the reconfigurator has started

    @initialize(
        ontology=ontologies(),
        som=soms(),
        chosen=st.sampled_from(SETTINGS),
        left=st.sets(st.sampled_from(("/substitute_a_7", "/substitute_standby_3"))),
    )
    def start(self, ontology: Ontology, som: Som, chosen: Settings, left: Set[str]) -> None:
        self.begin(ontology, som, chosen, left)

    def begin(self, ontology: Ontology, som: Som, chosen: Settings, left: Set[str]) -> None:
        self.core = Reconfigurator(ontology, som, chosen)
        self.ontology, self.som, self.settings = ontology, som, chosen
        self.written: Dict[str, Record] = {}
        self.lives_for: Optional[int] = None  # commands that are carried out yet
        self.now = 100.0
        self.health: Dict[Tuple[str, str], PublisherHealth] = {}
        self.failed: Set[Tuple[str, str]] = set()  # topic and node, told since it was healthy
        self.accused: Set[str] = set()  # nodes that the event at hand gives evidence against
        self.shown: Dict[str, Substitution] = {}
        self.states: Dict[str, events.ServiceState] = {}
        self.incidents: Dict[str, Incident] = {}
        self.closed: Set[str] = set()
        self.named: Set[str] = set()  # substitutes that were written down
        self.used: Set[str] = set(left)
        self.running: Set[str] = set()
        self.ending = False
        self.orphans = left
        self.hear(events.Started(self.now, tuple(sorted(left))))
        self.rows([(each.topic, each.node, PublisherState.HEALTHY, 1.0) for each in som])

    # What it says

    def hear(self, event: events.Event) -> None:
        """Hand over an event, and check every command and what holds after it."""
        self.sound = False
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
        assert command.node in self.used | self.named
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
                elsewhere = service.host and core.robot.computers.name(service.host)
                parted = bool(healing.substitute.host or elsewhere)
                waits = healing.state in SUBSTITUTED and not healing.publishes
                speaks = waits or healing.state in (State.WELL, State.RETURNING)
                alone = len(core.robot.som.of_topic(service.topic)) == 1
                beside = healing.substitute.host == core.robot.host_of(service.node)
                bridges = speaks and alone and beside and plan.computes
                bridges = bridges and service.policy.substitutes
                rows[healing.node] = Substitution(
                    healing.node,
                    name,
                    planner.signals(plan.inputs),
                    plan.program.code,
                    planner.outputs(plan),
                    plan.relations,
                    plan.quality,
                    healing.publishes,
                    healing.incident.faulty_node if healing.incident.killed else "",
                    host=healing.substitute.host,
                    on_partition=service.on_partition if parted else OnPartition.WAIT,
                    yields=healing.yields,
                    bridge=(service.bridges or 0.0) * (service.period or 0.0) if bridges else 0.0,
                )
        assert self.shown == rows
        assert set(core._processes.nodes) <= self.running
        if self.taken_up:
            assert self.reached() <= {node for node in self.shown if node in self.used}

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
            row = PublisherHealth(topic, node, state, since, since, since, kind, "as told")
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

    @rule(
        topic=st.sampled_from(TOPICS),
        data=st.data(),
        state=st.sampled_from(list(PublisherState)),
        age=st.sampled_from((0.0, 0.1, 5.0)),
        whole=st.booleans(),
    )
    def any_row(
        self, topic: str, data: Any, state: PublisherState, age: float, whole: bool
    ) -> None:
        node = data.draw(st.sampled_from(self.nodes()))
        self.rows([(topic, node, state, age)], whole)

    @rule(data=st.data(), state=st.sampled_from((PublisherState.HEALTHY, PublisherState.FAILED)))
    def original(self, data: Any, state: PublisherState) -> None:
        if self.som.services:
            service = data.draw(st.sampled_from(list(self.som)))
            self.rows([(service.topic, service.node, state, 0.0)])

    @rule(data=st.data())
    def node_is_back(self, data: Any) -> None:
        node = data.draw(st.sampled_from(NODES))
        mine = [each for each in self.som if each.node == node]
        self.rows([(each.topic, node, PublisherState.HEALTHY, 0.0) for each in mine])

    @rule()
    def first_messages(self) -> None:
        """Every substitute that is to publish does."""
        working = [row for row in self.shown.values() if row.publishing]
        self.rows([(row.topics[0], row.node, PublisherState.HEALTHY, 0.0) for row in working])

    @rule(data=st.data())
    def gone_row(self, data: Any) -> None:
        topic = data.draw(st.sampled_from(TOPICS))
        node = data.draw(st.sampled_from(self.nodes()))
        self.health.pop((topic, node), None)
        self.failed.discard((topic, node))
        self.hear(events.HealthSeen(self.now, (), ((topic, node),)))

    @rule(
        data=st.data(),
        kind=st.sampled_from((Kind.SILENT, Kind.NODE_GONE, Kind.OUT_OF_RANGE)),
        late=st.sampled_from((0.0, 0.0, 0.3)),
        named=st.booleans(),
    )
    def failure(self, data: Any, kind: Kind, late: float, named: bool) -> None:
        if not self.som.services:
            return
        service = data.draw(st.sampled_from(list(self.som)))
        node = data.draw(st.sampled_from([service.node, service.node, *self.nodes()]))
        self.accuse(service.topic, node)
        name = service.name if named else ""
        self.tell_failure(name, service.topic, node, kind, late)

    def tell_failure(self, name: str, topic: str, node: str, kind: Kind, late: float) -> None:
        time = self.now - late
        self.accused.add(node)
        self.hear(events.FailureSeen(time, name, topic, node, kind, "as told.", time - 0.1))

    @rule(
        data=st.data(),
        kind=st.sampled_from((Kind.SILENT, Kind.NODE_GONE, Kind.STUCK, Kind.RATE_LOW)),
    )
    def substitute_fails(self, data: Any, kind: Kind) -> None:
        working = [row for row in self.shown.values() if row.node and row.service]
        if working:
            row = data.draw(st.sampled_from(working))
            self.tell_failure(row.service, row.topics[0], row.node, kind, 0.0)

    @rule(data=st.data(), where=st.sampled_from(list(events.Where)))
    def found(self, data: Any, where: events.Where) -> None:
        """An answer to FindNode, and what follows at once."""
        killing = sorted(self.core.robot.health.dying)
        if killing:
            node = data.draw(st.sampled_from(killing))
            self.hear(events.NodeFound(self.now, node, where))

    @rule(data=st.data(), answer=st.sampled_from(KILL_EVENTS[1:]))
    def answered(self, data: Any, answer: Any) -> None:
        killing = sorted(self.core.robot.health.dying)
        if killing:
            self.hear(answer(self.now, data.draw(st.sampled_from(killing))))

    @rule(data=st.data(), known=st.booleans())
    def late_or_lost(self, data: Any, known: bool) -> None:
        """An answer that may be late, or to a question that nobody asked."""
        node, now = data.draw(st.sampled_from(self.nodes())), self.now
        event = data.draw(
            st.sampled_from(
                (
                    events.NodeLearned(now, node, known),
                    events.NodeLearned(now, node, known, "as told"),
                    events.GraphSeen(now, (), ((node, ("takes /x",) if known else ()),)),
                    events.NodeFound(now, node, events.Where.DEAD),
                    events.NodeLeft(now, node),
                    events.ProcessUntouchable(now, node),
                    events.NodeRestarted(now, node),
                    events.RestartFailed(now, node, "as told"),
                    events.StarterEnded(now, node),
                    events.SubstituteStarted(now, node),
                )
            )
        )
        self.hear(event)

    @rule(data=st.data())
    def exited(self, data: Any) -> None:
        node = data.draw(st.sampled_from(self.nodes()))
        self.running.discard(node)
        self.hear(events.ProcessExited(self.now, node, "as told"))

    @rule(name=st.sampled_from((*NAMES, "unknown")))
    def requested(self, name: str) -> None:
        service = self.som.services.get(name)
        if service is not None:
            self.accused |= {node for topic, node in self.health if topic == service.topic}
            self.accused.add(service.node)
        self.hear(events.SubstituteRequested(self.now, name))

    @rule(survivors=st.sampled_from(("all", "some", "none")))
    def dies(self, survivors: str) -> None:
        self.die(survivors)

    @rule(commands=st.integers(0, 4))
    def dies_at_the_next_event(self, commands: int) -> None:
        self.lives_for = commands

    @rule(name=st.sampled_from((*NAMES, "unknown")))
    def released(self, name: str) -> None:
        self.hear(events.Released(self.now, name))

    @rule(som=soms())
    def another_som(self, som: Som) -> None:
        """One service more, or another one."""
        services = {each.name: each for each in (*self.som, next(iter(som)))}
        found = {(each.topic, each.node): each for each in services.values()}
        self.som = self.som.with_services(found.values())
        self.hear(events.SomChanged(self.now, self.som))

    @rule(
        data=st.data(),
        changes=st.sampled_from(
            (
                {"period": 0.5},
                {"needed": False},
                {"needed": None},
                {"node": "/o"},
                *({"standby": standby} for standby in Standby),
                *({"policy": policy} for policy in Policy),
                *({"last_resort": last} for last in LAST_RESORTS),
                *({"contain": contain} for contain in (None, *Contain)),
            )
        ),
    )
    def little_change(self, data: Any, changes: Dict[str, Any]) -> None:
        """One service is a little different."""
        changed = data.draw(st.sampled_from(list(self.som)))
        new = [replace(each, **changes) if each is changed else each for each in self.som]
        found = {(each.topic, each.node): each for each in new}
        self.som = self.som.with_services(found.values())
        self.hear(events.SomChanged(self.now, self.som))

    @rule(topic=st.sampled_from(TOPICS), nodes=st.sampled_from(((), ("/consumer",), ("/monitor",))))
    def subscribers(self, topic: str, nodes: Tuple[str, ...]) -> None:
        self.hear(events.GraphSeen(self.now, ((topic, nodes),)))

    @rule(ontology=ontologies())
    def reload(self, ontology: Ontology) -> None:
        self.ontology = ontology
        self.hear(events.SomChanged(self.now, self.som, ontology))

    @rule()
    def idle(self) -> None:
        self.hear(events.Idle(self.now))

    @precondition(lambda self: not self.ending)
    @rule()
    def long_idle(self) -> None:
        """All plans are made: each is as good as one that is searched for now."""
        while self.core.plans_ahead:
            self.hear(events.Idle(self.now))
        plans, method = self.core.robot.planner.plans, self.core.robot.settings.method
        for service in self.core.robot.som.needed():
            made, name = plans.plan(service.name), service.name
            found: Optional[Plan] = None
            try:
                avoided = plans.to_avoid(name)
                found = plan_service(self.ontology, service, plans.sources, avoided, method)
            except ShsaError:
                pass
            assert (made and made.quality) == (found and found.quality)

    @rule(passed=st.sampled_from((0.0, 0.05, 0.5, 3.0, 100.0)))
    def tick(self, passed: float) -> None:
        self.now += passed
        self.hear(events.Tick(self.now))

    @rule()
    def tick_when_due(self) -> None:
        due = self.core.deadline
        if due < inf:
            self.now = max(self.now, due)
            self.hear(events.Tick(self.now))

    @rule(passed=st.sampled_from((0.01, 0.3)))
    def time_passes(self, passed: float) -> None:
        self.now += passed

    @precondition(lambda self: not self.ending)
    @rule(sure=st.sampled_from((True, False, False, False)))
    def launch_ending(self, sure: bool) -> None:
        if sure:
            self.ending = True
            self.hear(events.LaunchEnding(self.now))

    def teardown(self) -> None:
        if self.sound:
            commands = self.core.handle(events.ShuttingDown(self.now))
            stopped = {each.node for each in commands if isinstance(each, events.StopNode)}
            assert stopped >= self.reached(), "a process is left behind"
            assert not [each for each in commands if isinstance(each, events.StartSubstitute)]
            assert self.core.handle(events.Tick(self.now + 1000.0)) == []


TestAnyRobot = AnyRobot.TestCase
TestAnyRobot.settings = settings(
    max_examples=many(400), stateful_step_count=60, deadline=None, derandomize=True
)
