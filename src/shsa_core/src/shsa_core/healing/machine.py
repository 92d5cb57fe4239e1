"""The reconfigurator's decisions: events in, commands out (Section IV-C of the paper).

An event is handled by those that it concerns: the services that it is about, and those whose
substitutes read what it changes. What is known of the rest stays as it is, so that a decision costs
the same on a large robot.
"""
from typing import Any, Callable, Collection, Dict, Iterable, List, Optional, Tuple, Type

from shsa_core import dispatch
from shsa_core.codegen.plans import Plan
from shsa_core.errors import ModelError
from shsa_core.healing import events
from shsa_core.healing.events import Command, Event, FailureSeen, Level, Log
from shsa_core.healing.incident import Incident
from shsa_core.healing.kills import KillNode, NodeKilled
from shsa_core.healing.planner import Planner
from shsa_core.healing.settings import Settings
from shsa_core.healing.upkeep import Upkeep, is_shared
from shsa_core.model.kinds import Kind
from shsa_core.model.ontology import Ontology
from shsa_core.model.service import Service
from shsa_core.model.som import Som
from shsa_core.monitoring.events import PublisherHealth, PublisherState

ORPHAN_KILLS = 5
"""Tries to end a substitute that was left behind: a busy machine may not find it in time."""
TELLING = (events.Log, events.ShowIncident, events.ShowSom)
"""What only tells people comes after what acts: a line of the log takes as long as a takeover."""


class Reconfigurator(Upkeep):
    """Heals every needed service of a SOM.

    Args:
        ontology: the relations to search.
        som: the services; may change later by SomChanged.
        settings: times and limits.
        namespace: that of the substitutes' names, which are never used twice.
    """

    def __init__(
        self,
        ontology: Ontology,
        som: Som,
        settings: Settings = Settings(),
        namespace: str = "/",
    ) -> None:
        super().__init__(ontology, som, settings, namespace)
        self._ending = False
        self._with_us: Dict[str, bool] = {}  # nodes that were started again
        self._orphans: Dict[str, int] = {}  # what was left behind, and how often to try yet
        self._handlers: Dict[Type[Event], Callable[[Any], List[Command]]] = dispatch.table(
            Event,
            {
                events.Started: self._started,
                events.ShuttingDown: self._shutting_down,
                events.LaunchEnding: self._launch_ending,
                events.FailureSeen: self._failure_seen,
                events.HealthSeen: self._health_seen,
                events.SomChanged: self._som_changed,
                events.ModelsReloaded: self._models_reloaded,
                events.NodeLearned: self._node_learned,
                events.NodeFound: self._node_found,
                events.NodeLeft: self._node_left,
                events.ProcessUntouchable: self._process_untouchable,
                events.SubstituteStarted: self._substitute_started,
                events.ProcessExited: self._process_exited,
                events.SubstituteRequested: self._requested,
                events.NodeRestarted: self._node_restarted,
                events.RestartFailed: self._restart_failed,
                events.StarterEnded: self._starter_ended,
                events.Released: self._released,
                events.Idle: self._idle,
                events.Tick: self._tick,
            },
        )

    def handle(self, event: Event) -> List[Command]:
        """What is to be done about `event`."""
        self._time = max(self._time, event.time)  # a failure is heard after it was seen
        commands = self._handlers[type(event)](event)
        commands += self._settle()
        commands += self._refill()
        shown = self._substitutions.change()
        if shown is not None:
            commands.insert(0, shown)  # first: it decides who publishes
        states = self._states.change()
        if states is not None:
            commands.append(states)
        return sorted(commands, key=lambda command: isinstance(command, TELLING))

    @property
    def plans_ahead(self) -> bool:
        """Whether there are plans to make before they are needed: Idle makes one."""
        return self._planner.plans.stale

    @property
    def deadline(self) -> Optional[float]:
        """When a Tick is due, in s; None: none is."""
        dues = (
            self._agenda.next(),
            self._pool.deadline,
            self._kills.deadline,
            self._acquaintance.deadline,
        )
        return min((due for due in dues if due is not None), default=None)

    @property
    def substitutes(self) -> Tuple[str, ...]:
        """The node names of the substitutes that run now."""
        return (*self._concern.by_process, *self._pool.nodes)

    def needed(self) -> Tuple[Service, ...]:
        """The services that are healed when they fail."""
        return self._som.needed()

    def find(self, name: str) -> Service:
        """The service of a name, a topic or a property; a needed one first.

        Raises ModelError if there is none.
        """
        som = self._som
        found = [som.services[name]] if name in som.services else list(som.of_topic(name))
        found += [source.service for source in som.of_property(name)]
        if not found:
            known = ", ".join(f"{each.name} ({each.topic})" for each in som)
            raise ModelError(name, f"the SOM has no such service or topic; it has {known}")
        return min(found, key=lambda service: not service.needed)

    def explain(self, name: str, without: Collection[str] = (), method: str = "") -> Plan:
        """What would be done if the node of a service failed. Acts on nothing. Raises ShsaError."""
        return self._planner.explain(self.find(name), without, method)

    def incident(self, service: str) -> Optional[Incident]:
        """The open incident of a service."""
        healing = self._healings.get(service)
        return healing.incident if healing else None

    def _started(self, event: events.Started) -> List[Command]:
        """Stop what a former reconfigurator has left behind; its names are not used again."""
        tails = [node.rsplit("_", 1)[-1] for node in event.leftovers]
        numbers = [int(tail) for tail in tails if tail.isdigit()]
        self._next_substitute = max([self._next_substitute, *(1 + n for n in numbers)])
        commands: List[Command] = []
        for node in event.leftovers:
            commands.append(Log(Level.WARN, f"Stopping orphaned substitute {node}."))
            self._orphans[node] = ORPHAN_KILLS
            commands += self._kill_orphan(node)
        return commands

    def _kill_orphan(self, node: str) -> List[Command]:
        self._orphans[node] -= 1
        return self._absorb([KillNode(node, urgent=True)])

    def _shutting_down(self, event: events.ShuttingDown) -> List[Command]:
        """End every substitute, and the nodes that whoever ends us has started first."""
        ended: List[Command] = [events.StopSubstitute(node) for node in self.substitutes]
        return ended + [events.StopNode(node) for node, ours in self._with_us.items() if ours]

    def _launch_ending(self, event: events.LaunchEnding) -> List[Command]:
        """What stops on purpose is not healed."""
        self._ending = True
        return []

    def _failure_seen(self, event: FailureSeen) -> List[Command]:
        if self._ending:
            return []
        service = self._service_of(event)
        if service is None or self._is_old_substitute(event.publisher, service.name):
            return []
        if not service.needed:
            why = event.detail.rstrip(".")
            text = f"{event.topic} failed: {why}. It is not marked `needed`, ignored."
            return [Log(Level.WARN, text)]
        self._nodes.note(event)
        self._unsettle([service.name])
        return self._ask(service.name, lambda healing, now: healing.failed(now, event))

    def _service_of(self, event: FailureSeen) -> Optional[Service]:
        if event.service:
            return self._som.services.get(event.service)
        if event.publisher in self._concern.by_process:
            return self._som.services.get(self._concern.by_process[event.publisher])
        return self._som.service_of(event.topic, event.publisher)

    def _is_old_substitute(self, publisher: str, service: str) -> bool:
        known = publisher in self._nodes.substitutes
        return known and self._concern.by_process.get(publisher) != service

    def _health_seen(self, event: events.HealthSeen) -> List[Command]:
        commands: List[Command] = []
        concerned: Dict[str, None] = {}
        for topic, publisher in self._nodes.heed(event):
            row = self._nodes.health(topic).get(publisher)
            if publisher in self._concern.by_process:
                concerned[self._concern.by_process[publisher]] = None
            elif publisher not in self._nodes.substitutes:
                services = self._concerned(topic, publisher)
                concerned.update(dict.fromkeys(services))
                self._unsettle(services)
                commands += self._acquaint(event.time, publisher, row)
        for name in concerned:
            commands += self._missed_failure(event.time, name)
            commands += self._ask(name, lambda healing, now: healing.changed(now))
        return commands

    def _acquaint(self, time: float, node: str, row: Optional[PublisherHealth]) -> List[Command]:
        if row is None or (row.state is PublisherState.FAILED and row.kind is Kind.NODE_GONE):
            self._acquaintance.went(node)
        elif row.state is PublisherState.HEALTHY:
            return self._acquaintance.came_up(time, node)
        return []

    def _missed_failure(self, time: float, name: str) -> List[Command]:
        """The table tells of a failure whose trigger was never heard, as when we start late."""
        service = self._som.services.get(name)
        if self._ending or service is None or not service.needed or self._open(name):
            return []
        rows = self._rows(service)
        if any(row.state is PublisherState.HEALTHY for row in rows):
            return []
        for row in rows:
            excluded = row.publisher in self._nodes.excluded or row.publisher in self._kills.nodes
            if row.state is PublisherState.FAILED and not excluded:
                kind = row.kind or Kind.OTHER
                failure = FailureSeen(
                    time, name, row.topic, row.publisher, kind, row.detail, row.last_good
                )
                return self._failure_seen(failure)
        return []

    def _som_changed(self, event: events.SomChanged) -> List[Command]:
        old, self._som = self._som, event.som
        self._planner.som = event.som
        commands: List[Command] = []
        for name in [name for name in old.services if name not in event.som.services]:
            commands += self._remove(old.services[name])
        for service in event.som:
            before = old.services.get(service.name)
            if before is None:
                self._add(service)
            elif before.topic != service.topic:
                commands += self._remove(before)
                self._add(service)
            elif before != service or is_shared(old, service) != is_shared(event.som, service):
                commands += self._change(service)
        return commands

    def _models_reloaded(self, event: events.ModelsReloaded) -> List[Command]:
        """Plans follow the new models; what runs goes on."""
        planner = Planner(event.ontology, self._som, self.settings, self._nodes, self._availability)
        planner.plans.change((), self._availability.services.values())
        self._planner = planner
        return self._som_changed(events.SomChanged(event.time, event.som))

    def _node_learned(self, event: events.NodeLearned) -> List[Command]:
        self._acquaintance.learned(event)
        return []

    def _node_found(self, event: events.NodeFound) -> List[Command]:
        commands, over = self._kills.found(event)
        return commands + self._killed([over] if over else [])

    def _node_left(self, event: events.NodeLeft) -> List[Command]:
        commands, over = self._kills.left(event)
        return self._killed([over] if over else []) + commands

    def _process_untouchable(self, event: events.ProcessUntouchable) -> List[Command]:
        over = self._kills.untouchable(event)
        return self._killed([over] if over else [])

    def _killed(self, kills: Iterable[NodeKilled]) -> List[Command]:
        commands: List[Command] = []
        for kill in kills:
            self._nodes.killed(kill.node, kill.time)
            self._acquaintance.went(kill.node)
            if kill.node not in self._nodes.excluded:  # it is back already, as another process
                commands += self._acquaintance.came_up(self._time, kill.node)
            self._with_us.pop(kill.node, None)
            self._unsettle_node(kill.node)
            if kill.certain:
                self._orphans.pop(kill.node, None)
            elif self._orphans.get(kill.node):
                commands += self._kill_orphan(kill.node)
            for name in self._concern.blaming(kill.node):
                commands += self._ask(name, lambda healing, now: healing.killed(now, kill))
                commands += self._ask(name, lambda healing, now: healing.changed(now))
        return commands

    def _substitute_started(self, event: events.SubstituteStarted) -> List[Command]:
        name = self._concern.by_process.get(event.node, "")
        return self._ask(name, lambda healing, now: healing.started(event))

    def _process_exited(self, event: events.ProcessExited) -> List[Command]:
        if event.node in self._pool.nodes:
            commands = self._pool.died(event.time, event.node, event.detail)
            self._substitutions.set(event.node, None)
            return commands
        name = self._concern.by_process.get(event.node, "")
        return self._ask(name, lambda healing, now: healing.exited(now, event.detail))

    def _requested(self, event: events.SubstituteRequested) -> List[Command]:
        incident = self.incident(event.service)
        if incident is not None:
            return [events.ShowIncident(incident)]
        service = self._som.services.get(event.service)
        if service is None:
            return []
        originals = self._availability.originals(self._som, service)
        healthy = [row for row in originals if row.state is PublisherState.HEALTHY]
        node = healthy[0].publisher if healthy else service.node
        last_good = healthy[0].last_good if healthy else None
        why = "somebody asked for a substitute"
        failure = FailureSeen(
            event.time, service.name, service.topic, node, Kind.REQUESTED, why, last_good
        )
        return self._failure_seen(failure)

    def _node_restarted(self, event: events.NodeRestarted) -> List[Command]:
        self._with_us[event.node] = event.with_us
        return []

    def _restart_failed(self, event: events.RestartFailed) -> List[Command]:
        self._nodes.end_restart(event.node)
        commands: List[Command] = []
        for name in self._concern.blaming(event.node):
            commands += self._ask(
                name, lambda healing, now: healing.restart_failed(now, event.node, event.detail)
            )
        return commands

    def _starter_ended(self, event: events.StarterEnded) -> List[Command]:
        """A node that was started again lives no longer than whoever started it first."""
        return [] if self._with_us.pop(event.node, None) is None else [events.StopNode(event.node)]

    def _released(self, event: events.Released) -> List[Command]:
        return self._ask(event.service, lambda healing, now: healing.released(now))

    def _idle(self, event: events.Idle) -> List[Command]:
        """Make one plan ahead; who follows it follows the new one."""
        name = self._planner.plans.step()
        if name is None:
            return []
        service = self._som.services[name]
        if self._pool.serves(service):
            self._pool.serve(service, self._planner, self._planner.plans.plan(name))
            self._substitutions.set(name, self._pool.plans[name])
        return self._ask(name, lambda healing, now: healing.replan(now))

    def _tick(self, event: events.Tick) -> List[Command]:
        commands, over = self._kills.tick(event.time)
        commands += self._killed(over)
        commands += self._acquaintance.tick(event.time)
        for name in self._agenda.pop_due(event.time):
            commands += self._ask(name, lambda healing, now: healing.tick(now))
        return commands
