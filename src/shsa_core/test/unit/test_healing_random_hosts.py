"""Any story of a robot of several computers that come and go."""
from dataclasses import replace
from typing import Any, Dict, List, Set

from hypothesis import settings, strategies as st
from hypothesis.stateful import initialize, rule

from random_models import SETTINGS, ontologies, soms
from shsa_core.healing import events
from shsa_core.healing.incident import State
from shsa_core.healing.settings import Settings
from shsa_core.model.health import PublisherState
from shsa_core.model.kinds import Kind, OnPartition
from shsa_core.model.ontology import Ontology
from shsa_core.model.som import Som
from shsa_testing.thorough import many
from test_healing_random import AnyRobot

HOSTS = ("pi", "board")
CALM_S = 150
"""So many seconds of calm heal whatever can be healed."""


class AnyDistributedRobot(AnyRobot):
    """Computers that are cut off, are lost then, and come back; some have no room.

    When one is back, its agent ends what nobody wants there any more.
    """

    @initialize(
        ontology=ontologies(least=5),
        som=soms(HOSTS),
        chosen=st.sampled_from(SETTINGS),
        left=st.just(frozenset()),
    )
    def start(self, ontology: Ontology, som: Som, chosen: Settings, left: Set[str]) -> None:
        self.runs_on: Dict[str, str] = {}
        self.there: Set[str] = set()  # heard, and not lost since
        self.cut: Set[str] = set()
        self.begin(ontology, som, chosen, left)
        self.all_is_calm(3)
        while self.core.plans_ahead:
            self.hear(events.Idle(self.now))

    launch_ending = None  # type: ignore[assignment]  # nothing would be healed from then on

    def reached(self) -> Set[str]:
        return {n for n in self.running if self.runs_on.get(n, "") in {"", *self.there}}

    def die(self, survivors: str) -> None:
        self.there.clear()  # the next one has heard none of them yet
        super().die(survivors)

    def on_StartSubstitute(self, command: events.StartSubstitute) -> None:
        super().on_StartSubstitute(command)
        assert command.host in {"", *self.there}, "it is placed on a computer that is lost"
        self.runs_on[command.node] = command.host

    def on_ShowSubstitutions(self, command: events.ShowSubstitutions) -> None:
        for row in command.rows:
            service = self.som.services.get(row.service)
            if row.node and row.node not in self.shown and service is not None:
                assert row.host not in service.placement.forbid
        super().on_ShowSubstitutions(command)

    @rule(host=st.sampled_from(HOSTS), load=st.sampled_from((0.0, 0.05, 0.5, 3.99)))
    def host_seen(self, host: str, load: float) -> None:
        self.host_heard(host, load)

    def host_heard(self, host: str, load: float) -> None:
        known = host in self.there
        self.cut.discard(host)
        self.there.add(host)
        if not known:
            there = {node for node in self.running if self.runs_on.get(node) == host}
            self.running -= there - set(self.shown)
        self.hear(events.HostSeen(self.now, host, load, 4.0))
        if self.taken_up:
            assert self.reached() <= set(self.shown), "it does not know that it must end"

    @rule(seconds=st.sampled_from((1, 10)))
    def calm(self, seconds: int) -> None:
        """All computers are heard for a while, and time passes."""
        self.all_is_calm(seconds)

    def all_is_calm(self, seconds: int) -> None:
        for _ in range(seconds):
            self.now += 1.0
            for host in HOSTS:
                self.host_heard(host, 0.0)
            self.hear(events.Tick(self.now))

    @rule(data=st.data(), kind=st.sampled_from((Kind.SILENT, Kind.NODE_GONE)))
    def needed_fails(self, data: Any, kind: Kind) -> None:
        """A node fails that is to be healed, while the rest is well."""
        needed = [each for each in self.som if each.needed and each.policy.substitutes]
        if needed:
            failed = data.draw(st.sampled_from(needed))
            others = [each for each in self.som if each.node != failed.node]
            well = PublisherState.HEALTHY
            self.rows([(each.topic, each.node, well, 0.0) for each in others])
            self.accuse(failed.topic, failed.node)
            self.tell_failure(failed.name, failed.topic, failed.node, kind, 0.0)

    @rule(host=st.sampled_from(HOSTS))
    def host_cut(self, host: str) -> None:
        self.cut.add(host)

    @rule(host=st.sampled_from(HOSTS))
    def host_lost(self, host: str) -> None:
        self.cut.add(host)
        self.there.discard(host)
        self.hear(events.HostLost(self.now, host, "as told"))
        for row in self.working():
            if row.host == host:
                assert row.publishing and self.health[row.topics[0], row.node]

    @rule(host=st.sampled_from(HOSTS), other=st.sampled_from(HOSTS))
    def services_move(self, host: str, other: str) -> None:
        """The services of one computer are on another one."""
        moved = {"host": other, "on_partition": OnPartition.HEAL}
        changed = [replace(each, **moved) if each.host == host else each for each in self.som]
        self.som = self.som.with_services(changed)
        self.hear(events.SomChanged(self.now, self.som))

    def working(self) -> List[Any]:
        return [row for row in self.shown.values() if row.node and row.service]

    def teardown(self) -> None:
        """All computers are there, and everybody answers: what can be healed is."""
        if self.sound and not self.ending:
            self.lives_for = None
            for _ in range(CALM_S):
                self.all_is_calm(1)
                for node, uri in sorted(self.core.robot.health.dying.items()):
                    self.hear(events.NodeFound(self.now, node, events.Where.DEAD, uri=uri))
                self.first_messages()
            for name, healing in self.core.services.items():
                service = self.som.services[name]
                if service.needed and service.policy.substitutes:
                    assert healing.state is not State.HEALING
        super().teardown()


TestAnyDistributedRobot = AnyDistributedRobot.TestCase
TestAnyDistributedRobot.settings = settings(
    max_examples=many(40), stateful_step_count=40, deadline=None, derandomize=True
)
