"""Any story of a robot: what its consumers and nodes see, and the core's own invariants."""
from dataclasses import replace
from math import inf
from typing import Any, Dict, Optional, Set, Tuple

from hypothesis import settings, strategies as st
from hypothesis.stateful import initialize, precondition, rule

from observed_robot import ObservedRobot
from random_models import LAST_RESORTS, NAMES, NODES, TOPICS, SETTINGS, ontologies, soms
from shsa_core.codegen.plans import Plan, plan_service
from shsa_core.errors import ShsaError
from shsa_core.healing import events
from shsa_core.healing.kill import KILL_EVENTS
from shsa_core.healing.settings import Settings
from shsa_core.model.health import PublisherState
from shsa_core.model.kinds import Contain, Kind, Policy, Standby
from shsa_core.model.ontology import Ontology
from shsa_core.model.som import Som
from shsa_testing.thorough import many


class AnyRobot(ObservedRobot):
    """What may happen to a robot."""

    @initialize(
        ontology=ontologies(),
        som=soms(),
        chosen=st.sampled_from(SETTINGS),
        left=st.sets(st.sampled_from(("/substitute_a_7", "/substitute_standby_3"))),
    )
    def start(self, ontology: Ontology, som: Som, chosen: Settings, left: Set[str]) -> None:
        self.begin(ontology, som, chosen, left)

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

    @rule(data=st.data(), life=st.sampled_from((0, 1, 2, 3)))
    def another_life(self, data: Any, life: int) -> None:
        """Another process has the name of a node from now on."""
        self.lives[data.draw(st.sampled_from(self.nodes()))] = life

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
        killing = sorted(self.core.robot.health.dying.items())
        if killing:
            node, uri = data.draw(st.sampled_from(killing))
            self.hear(events.NodeFound(self.now, node, where, uri=uri))

    @rule(data=st.data(), answer=st.sampled_from(KILL_EVENTS[1:]))
    def answered(self, data: Any, answer: Any) -> None:
        killing = sorted(self.core.robot.health.dying.items())
        if killing:
            self.hear(answer(self.now, *data.draw(st.sampled_from(killing))))

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
