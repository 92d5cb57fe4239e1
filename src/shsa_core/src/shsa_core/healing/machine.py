"""The reconfigurator's decisions: events in, commands out (Section IV-C of the paper)."""
from dataclasses import replace
from typing import Collection, Dict, List, Optional, Set, Tuple

from shsa_core.codegen.generator import Program
from shsa_core.errors import ShsaError
from shsa_core.healing.events import (
    AssignSubstitute,
    Command,
    Event,
    FailureSeen,
    HealthSeen,
    KillNode,
    NodeKilled,
    ProcessExited,
    PublisherHealth,
    Released,
    RestartFailed,
    RestartNode,
    Say,
    ServiceState,
    ShowIncident,
    ShowSom,
    ShowSubstitutions,
    SomChanged,
    StartSubstitute,
    SubstituteRequested,
    SubstituteStarted,
    Substitution,
    Tick,
)
from shsa_core.healing.nodes import Nodes
from shsa_core.healing.plans import PlanTable, TopicPlan, plan_topic, safe_plan
from shsa_core.healing.pool import Pool
from shsa_core.healing.settings import Settings
from shsa_core.healing.topic import Healing
from shsa_core.model.ontology import Ontology
from shsa_core.model.policies import RESTART
from shsa_core.model.som import Service, Som

REQUESTED = "requested"
SUBSTITUTE_PREFIX = "/substitute_"


class Reconfigurator:
    """Heals every needed topic of a SOM.

    Args:
        ontology: the relations to search.
        som: the services; may change later by SomChanged.
        settings: times and limits.
        first_substitute: the number of the first substitute's name; names are never used twice.
    """

    def __init__(
        self,
        ontology: Ontology,
        som: Som,
        settings: Settings = Settings(),
        first_substitute: int = 1,
    ) -> None:
        self.settings = settings
        self._ontology = ontology
        self._som = som
        self._plans = PlanTable(ontology, som, settings.method)
        self._nodes = Nodes()
        self._healings: Dict[str, Healing] = {t: Healing(t, self) for t in som.topics()}
        self._incidents = 0
        self._next_substitute = first_substitute
        self._pool = Pool(som, settings, lambda: self._new_name("standby"))
        self._now = float("-inf")
        self._shown_table: Optional[Tuple[Substitution, ...]] = None
        self._shown_som: Optional[ShowSom] = None

    def handle(self, event: Event) -> List[Command]:
        """What is to be done about `event`."""
        self._now = event.time
        commands = self._dispatch(event)
        commands += self._pool.refill(event.time)
        self._plans.update(self.available())
        if not self._plans.stale:  # else the plans are not known for a moment
            self._pool.listen(self._warm_inputs())
        working = tuple(h.substitution for h in self._healings.values() if h.substitution)
        table = (*working, *self._pool.rows())
        if table != self._shown_table:
            self._shown_table = table
            # First: it decides who speaks.
            commands.insert(0, ShowSubstitutions(table))
        som = ShowSom(self._som, tuple(self._service_states()))
        if som != self._shown_som:
            self._shown_som = som
            commands.append(som)
        return commands

    @property
    def plans_ahead(self) -> bool:
        """Whether there are plans to make before they are needed."""
        return bool(self._plans.stale)

    def prepare(self) -> None:
        """Make one plan ahead, while there is nothing else to do."""
        self._plans.step()

    @property
    def deadline(self) -> Optional[float]:
        """When a Tick is due, in s; None: none is."""
        due = [h.deadline for h in self._healings.values() if h.deadline is not None]
        if self._pool.deadline is not None:
            due.append(self._pool.deadline)
        return min(due, default=None)

    @property
    def substitutes(self) -> Tuple[str, ...]:
        """The node names of the substitutes that run now."""
        return (*(h.node for h in self._healings.values() if h.node), *self._pool.nodes)

    def needed(self) -> Tuple[str, ...]:
        """The topics that are healed when they fail."""
        return tuple(dict.fromkeys(s.topic for s in self._som if s.needed))

    def available(self) -> Tuple[Service, ...]:
        """The services that are published by a healthy original, with the node that does."""
        states = self._service_states()
        return tuple(
            replace(service, node=state.node)
            for service, state in zip(self._som, states)
            if state.available
        )

    def explain(self, topic: str, without: Collection[str] = (), method: str = "") -> TopicPlan:
        """What would be done if the node that publishes `topic` failed. Acts on nothing.

        Raises NoSubstitute.
        """
        excluded = {*self._nodes.excluded, *without}
        excluded.update(row.publisher for row in self.originals(topic))
        excluded.add(self.provider(topic))
        excluded.discard("")
        return plan_topic(
            self._ontology,
            self._som,
            self.available(),
            topic,
            excluded=excluded,
            method=method or self.settings.method,
        )

    def _dispatch(self, event: Event) -> List[Command]:
        if isinstance(event, FailureSeen):
            return self._failed(event)
        if isinstance(event, HealthSeen):
            return self._health_seen(event)
        if isinstance(event, SomChanged):
            return self._som_changed(event)
        if isinstance(event, NodeKilled):
            return self._node_killed(event)
        if isinstance(event, SubstituteRequested):
            return self._requested(event)
        if isinstance(event, ProcessExited) and event.node in self._pool.nodes:
            return self._pool.died(event.time, event.node, event.detail)
        if isinstance(event, RestartFailed):
            self._nodes.end_restart(event.node)
        commands: List[Command] = []
        for healing in list(self._healings.values()):
            if isinstance(event, SubstituteStarted):
                commands += healing.started(event)
            elif isinstance(event, ProcessExited):
                commands += healing.exited(event.time, event.node, event.detail)
            elif isinstance(event, RestartFailed):
                commands += healing.restart_failed(event.time, event.node, event.detail)
            elif isinstance(event, Released) and healing.topic == event.topic:
                commands += healing.released(event.time)
            elif isinstance(event, Tick):
                commands += healing.tick(event.time)
        return commands

    def _failed(self, event: FailureSeen) -> List[Command]:
        healing = self._healings.get(event.topic)
        if healing is None or self._is_old_substitute(event.publisher, healing):
            return []
        if event.topic not in self.needed():
            return [Say("warn", f"{event.topic} failed: {event.detail}. Nobody needs it.")]
        self._nodes.note(event)
        return healing.failed(event)

    def _ready_plan(self, topic: str) -> Optional[TopicPlan]:
        try:
            return self._plans.lookup(topic)
        except ShsaError:
            return None

    def _warm_inputs(self) -> List[str]:
        """What the plans of the warm topics read."""
        plans = [self._ready_plan(topic) for topic in self._pool.topics]
        return [path for plan in plans if plan for path in plan.program.inputs]

    def _is_old_substitute(self, publisher: str, healing: Healing) -> bool:
        return publisher in self._nodes.substitutes and publisher != healing.node

    def _health_seen(self, event: HealthSeen) -> List[Command]:
        if not self._nodes.heed(event):
            return []
        commands: List[Command] = []
        for row in event.publishers:
            commands += self._missed_failure(event.time, row)
        return commands + self._world_changed(event.time)

    def _missed_failure(self, time: float, row: PublisherHealth) -> List[Command]:
        """The table tells of a failure whose trigger was never heard, as when we start late."""
        healing = self._healings.get(row.topic)
        if healing is None or healing.open or row.state != "failed":
            return []
        if row.topic not in self.needed() or row.publisher in self._nodes.excluded:
            return []
        if any(other.state == "healthy" for other in self.originals(row.topic)):
            return []
        return self._failed(
            FailureSeen(time, row.topic, row.publisher, row.kind, row.detail, row.last_good)
        )

    def _som_changed(self, event: SomChanged) -> List[Command]:
        self._som = event.som
        self._plans = PlanTable(self._ontology, event.som, self.settings.method)
        self._pool.serve(event.som)
        commands: List[Command] = []
        for topic in set(self._healings) - set(event.som.topics()):
            commands += self._healings.pop(topic).close(
                event.time, f"{topic} is no longer in the SOM."
            )
        for topic in event.som.topics():
            self._healings.setdefault(topic, Healing(topic, self))
        return commands + self._world_changed(event.time)

    def _node_killed(self, event: NodeKilled) -> List[Command]:
        self._nodes.end_kill(event.node, event.time)
        commands: List[Command] = []
        for healing in self._healings.values():
            commands += healing.killed(event)
        return commands

    def _requested(self, event: SubstituteRequested) -> List[Command]:
        healing = self._healings.get(event.topic)
        if healing is not None and healing.incident is not None:
            return [ShowIncident(healing.incident)]
        healthy = [row for row in self.originals(event.topic) if row.state == "healthy"]
        node = healthy[0].publisher if healthy else self.provider(event.topic)
        last_good = healthy[0].last_good if healthy else None
        detail = "somebody asked for a substitute"
        return self._failed(
            FailureSeen(event.time, event.topic, node, REQUESTED, detail, last_good)
        )

    def _world_changed(self, time: float) -> List[Command]:
        self._plans.update(self.available())
        commands: List[Command] = []
        for healing in self._healings.values():
            commands += healing.world_changed(time)
        return commands

    def _service_states(self) -> List[ServiceState]:
        excluded = self._nodes.excluded
        return [
            self._service_state(index, service, excluded) for index, service in enumerate(self._som)
        ]

    def _service_state(self, index: int, service: Service, excluded: Set[str]) -> ServiceState:
        rows = [r for r in self.originals(service.topic) if r.publisher not in excluded]
        healthy = [row for row in rows if row.state == "healthy"]
        if self._healings[service.topic].open:
            return ServiceState(index, service.node, False, "failed")
        if healthy:
            return ServiceState(index, healthy[0].publisher, True, "")
        detail = next((row.detail for row in rows if row.detail), "not published")
        return ServiceState(index, service.node, False, detail)

    def plan(self, topic: str, tried: Collection[TopicPlan]) -> TopicPlan:
        available = self.available()
        excluded = self._nodes.excluded
        ready = self._plans.lookup(topic, frozenset(available), excluded)
        if ready is not None and ready not in tried:
            return ready
        return plan_topic(
            self._ontology,
            self._som,
            available,
            topic,
            excluded=excluded,
            method=self.settings.method,
            tried=tried,
        )

    def usable(self, plan: TopicPlan) -> bool:
        return {s.path for s in plan.services} <= {s.path for s in self.available()}

    def originals(self, topic: str) -> Tuple[PublisherHealth, ...]:
        return self._nodes.originals(topic)

    def publisher(self, topic: str, node: str) -> Optional[PublisherHealth]:
        return self._nodes.health(topic, node)

    def provider(self, topic: str) -> str:
        services = self._som.of_topic(topic)
        return services[0].node if services else ""

    def properties(self, topic: str) -> Tuple[str, ...]:
        return tuple(s.property for s in self._som.of_topic(topic))

    def policy(self, topic: str) -> str:
        return self._som.policy(topic)

    def safe_plan(self, topic: str) -> Optional[TopicPlan]:
        return safe_plan(self._som, topic)

    def command(self, topic: str) -> Tuple[str, ...]:
        return self._som.command(topic)

    def kill(self, node: str, urgent: bool) -> List[Command]:
        return [KillNode(node, urgent)] if self._nodes.begin_kill(node) else []

    def restart(self, node: str) -> List[Command]:
        return [RestartNode(node)] if self._nodes.begin_restart(node) else []

    def dying(self, node: str) -> bool:
        return self._nodes.dying(node)

    def new_incident(self) -> int:
        self._incidents += 1
        return self._incidents

    def hot(self, topic: str) -> bool:
        services = self._som.of_topic(topic)
        return any(s.needed and s.standby == "hot" and s.policy != RESTART for s in services)

    def plan_ahead(self, topic: str) -> TopicPlan:
        return self._plans.lookup(topic, frozenset(self.available())) or self.explain(topic)

    def process(self, topic: str, program: Program) -> Tuple[str, Command]:
        node = self._pool.take(self._now, topic)
        if node is not None:
            return node, AssignSubstitute(node)
        node = self._new_name(topic.strip("/").replace("/", "_"))
        return node, StartSubstitute(node, program)

    def _new_name(self, of: str) -> str:
        """A node name that was never used before."""
        name = f"{SUBSTITUTE_PREFIX}{of}_{self._next_substitute}"
        self._next_substitute += 1
        self._nodes.substitutes.add(name)
        return name
