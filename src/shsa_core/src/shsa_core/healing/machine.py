"""The reconfigurator's decisions: events in, commands out (Section IV-C of the paper).

Three machines decide: `service` (what publishes a service), `node` (what becomes of a faulty node)
and `process` (which processes of substitutes run where). Here an event goes to those that it
concerns.
"""
from dataclasses import replace
from functools import partial
from math import inf
from typing import Any, Callable, Collection, Dict, List, Optional, Tuple, Type

from shsa_core import dispatch
from shsa_core.codegen.plans import Plan
from shsa_core.errors import ShsaError
from shsa_core.healing import events, hearing, succession
from shsa_core.healing.core import Core
from shsa_core.healing.events import Command, Event, FailureSeen, Log
from shsa_core.healing.incident import Incident, State, Trigger
from shsa_core.healing.kill import KILL_EVENTS
from shsa_core.healing.records import Counters
from shsa_core.healing.robot import Robot
from shsa_core.healing.settings import ANSWER_S, Settings
from shsa_core.model.error import Error
from shsa_core.model.kinds import Kind
from shsa_core.model.log import Level
from shsa_core.model.ontology import Ontology
from shsa_core.model.service import Service
from shsa_core.model.som import Som

HEALTH = (events.HealthSeen, events.FailureSeen)
ENDINGS = (events.ShuttingDown, events.LaunchEnding, events.StarterEnded)
"""Heeded although the robot's launch ends: nodes stop on purpose then."""
NOT_HELD = (events.Started, events.MaintenanceSet, *ENDINGS)
FORGOTTEN = (*HEALTH, events.Tick, events.Idle, events.CalibrationsHeard)  # told again
TELLING = (events.Log, events.ShowIncident, events.ShowSom)
"""Commands for people come after those that act: a line of the log takes as long as a takeover."""


class Reconfigurator:
    """Heals every needed service of a SOM.

    Args:
        ontology: the relations to search.
        som: the services; may change later by SomChanged.
        settings: times and limits.
        namespace: where healing runs: relative names are in it, and the substitutes' names.
        dry_run: advise, whatever the SOM says: nothing is killed or started.
        restarts: nodes may be started again; else their policy counts as the rest of it.
        host: the name in the SOM of the computer that we run on; empty: not known.
    """

    def __init__(
        self,
        ontology: Ontology,
        som: Som,
        settings: Settings = Settings(),
        namespace: str = "/",
        dry_run: bool = False,
        restarts: bool = True,
        host: str = "",
    ) -> None:
        self._over = False
        self._held: Dict[object, Event] = {}  # in maintenance
        self._held_until = -inf
        self._namespace = namespace
        self._given = som
        self.robot = robot = Robot(ontology, som, settings, namespace, host)
        robot.dry_run, robot.restarts = dry_run, restarts
        self.names = robot.names
        self._core = core = Core(robot)
        robot.som = robot.planner.som = robot.as_told(som)
        self.services = core.services
        self._watched: Tuple[str, ...] = ()
        self._nodes, self._processes = nodes, processes = core.nodes, core.processes
        for service in robot.som:
            self._add(service)
        self._handlers: Dict[Type[Event], Callable[[Any], List[Command]]] = dispatch.table(
            Event,
            {
                events.Started: self._started,
                events.Prepared: lambda event: processes.hold_starts(-inf),
                **dict.fromkeys((events.ShuttingDown, events.LaunchEnding), self._ends),
                events.MaintenanceSet: self._maintenance_set,
                events.FailureSeen: partial(hearing.failed, core),
                events.HealthSeen: partial(hearing.health_seen, core),
                events.SomChanged: self._som_changed,
                events.GraphSeen: self._graph_seen,
                events.NodeLearned: self._node_learned,
                events.NodeCameUp: lambda e: core.ask_accusers(e.node, lambda each: each.came_up()),
                **dict.fromkeys(KILL_EVENTS, nodes.heed),
                events.NodeUnregistered: self._node_unregistered,
                events.SubstituteStarted: lambda event: core.ask_all(
                    processes.served(event.node), lambda each: each.started(event.time)
                ),
                events.ProcessExited: self._process_exited,
                events.ProcessPulse: self._process_pulse,
                events.SubstituteRequested: self._requested,
                events.NodeRestarted: self._node_restarted,
                events.RestartFailed: lambda event: core.ask_accusers(
                    event.node, lambda each: each.restart_failed(event)
                ),
                events.StarterEnded: self._starter_ended,
                events.Released: lambda e: core.ask(e.service, lambda each: each.released()),
                events.CalibrationsHeard: self._calibrations_heard,
                events.HostSeen: partial(hearing.host_seen, core),
                events.HostLost: partial(hearing.host_lost, core),
                events.Idle: self._idle,
                events.Tick: self._tick,
            },
        )

    def handle(self, event: Event) -> List[Command]:
        """Return what is to be done about `event`."""
        robot, processes = self.robot, self._processes
        if self._over and not isinstance(event, ENDINGS):
            return []  # nobody would stop what is started now
        robot.time = max(robot.time, event.time)  # a failure is heard after it was seen
        self._core.forget_ended()
        commands: List[Command] = []
        for each in self._let_through(event) if robot.maintained else [event]:
            commands += self._handlers[type(each)](each)
        turns = processes.starts.due(robot.time)
        commands += self._core.ask_all(turns, lambda each: each.replan())
        commands += self._core.settle()
        if not self._over:
            commands += processes.refill(robot.time)
        machines = map(self.services.__getitem__, robot.indexes.healing)
        watched = tuple(sorted({each.incident.faulty_node for each in machines if each.refuses}))
        if watched != self._watched:
            self._watched = watched
            commands.append(events.WatchNodes(watched))
        robot.records.set("counters", Counters(robot.incidents, robot.names.next))
        # What is written down comes first; then the table, which decides who publishes.
        first: List[Command] = [*robot.records.change(), *processes.wanted.change()]
        said = [*first, *commands, *robot.availability.states.change()]
        return sorted(said, key=lambda each: isinstance(each, TELLING))

    @property
    def plans_ahead(self) -> bool:
        """Tell that there are plans to make before they are needed: Idle makes one."""
        return self.robot.planner.plans.stale and not (self._over or self.robot.maintained)

    @property
    def deadline(self) -> float:
        """Return when a Tick is due, in s; infinite: none is."""
        robot, core = self.robot, self._core
        if self._over or robot.maintained:
            return inf if self._over else self._held_until
        dues = self._processes.deadline, self._nodes.deadline, robot.health.due
        return min(*dues, core.agenda.next(), core.asked.next(), robot.computers.settling.next())

    def incident(self, service: str) -> Optional[Incident]:
        """Return the open incident of a service."""
        return self._core.incident(service)

    def errors(self, service: str) -> Tuple[Optional[Error], ...]:
        """Return the errors that are stated by now of what the substitute of a service gives."""
        machine = self.services.get(service)
        plan = machine.substitute.plan if machine else None
        return self.robot.planner.errors(plan) if plan and plan.computes else ()

    def find(self, name: str) -> Service:
        """Return the service of a name, a topic or a property. Raises ModelError."""
        return self.robot.som.find(name, self._namespace)

    def explain(self, name: str, without: Collection[str] = (), method: str = "") -> Plan:
        """Return what would be done if the node of a service failed. Raises ShsaError."""
        excluded = [self.robot.som.known_name(each, self._namespace) for each in without]
        service = self.find(name)
        excluded += self.robot.planned_without(service)
        plan = self.robot.planner.explain(service, excluded, method)
        return replace(plan, errors=self.robot.planner.errors(plan))

    # Services come and go.

    def _started(self, event: events.Started) -> List[Command]:
        """Begin; what is needed is known first: processes that stand by for it are taken up."""
        robot = self.robot
        robot.note_subscribers(event.subscribers)
        robot.health.duties.update(event.duties)
        robot.som = robot.planner.som = robot.as_told(self._given)
        for service in robot.som:
            self._offer(service)
        return succession.started(self._core, event)

    def _graph_seen(self, event: events.GraphSeen) -> List[Command]:
        robot = self.robot
        robot.note_subscribers(event.subscribers)
        for topic, _ in event.subscribers:
            self._core.unsettle([service.name for service in robot.som.of_topic(topic)])
        commands: List[Command] = []
        for node, duties in event.duties:
            robot.health.duties[node] = duties
            commands += self._core.ask_accusers(node, lambda each: each.replan())
        if robot.som == robot.as_told(self._given):
            return commands
        return commands + self._som_changed(events.SomChanged(event.time, self._given))

    def _add(self, service: Service) -> None:
        self._core.add(service)
        self._offer(service)

    def _remove(self, name: str) -> List[Command]:
        commands = self._core.ask(name, lambda each: each.fire(Trigger.WITHDRAWN))
        del self.services[name], self._processes.substitutes[name]
        self.robot.planner.plans.forget(name)
        self.robot.calibrations.forget(name)
        self._processes.no_stand_by(name)
        self._core.agenda.set(name, None)
        self._core.unsettle([name])
        return commands

    def _offer(self, service: Service) -> None:
        """Plan ahead for a service if it is needed, and let the pool serve it if it is warm."""
        self.robot.planner.plans.serve(service)
        self._processes.stand_by(service, None)

    def _som_changed(self, event: events.SomChanged) -> List[Command]:
        robot = self.robot
        if event.ontology is not None:
            robot.planner.load(event.ontology, robot.som)
        self._given = event.som
        old, som = robot.som, robot.as_told(event.som)
        commands: List[Command] = []
        both = [*old, *som]
        topics = {e.topic for e in both if old.services.get(e.name) != som.services.get(e.name)}
        for before in old:
            now = som.services.get(before.name)
            if now is None or now.topic != before.topic:
                commands += self._remove(before.name)
        robot.som = robot.planner.som = som
        follow = lambda each: each.replan() if each.spec.needed else each.fire(Trigger.WITHDRAWN)
        for service in som:
            if service.name not in self.services:
                self._add(service)
            elif service.topic in topics:
                self._core.unsettle([service.name])
                self._offer(service)
                commands += self._core.ask(service.name, follow)
        commands += self._core.settle()  # what is read may be another topic, or there no more
        readers = robot.indexes.readers(each.name for each in both if each.topic in topics)
        asked = dict.fromkeys((*robot.indexes.kept, *readers))
        commands += self._core.ask_all(asked, lambda each: each.changed() + each.replan())
        if old.hosts or som.hosts:
            commands += hearing.rehost(self._core)
        return commands + hearing.look_again(self._core)

    # The rest of the events.

    def _ends(self, event: Event) -> List[Command]:
        self._over = True
        self._processes.starts.waiting.clear()
        if isinstance(event, events.LaunchEnding):
            return []
        for key in [key for key in self.robot.records.rows if key != "counters"]:
            self.robot.records.set(key, None)
        return [events.StopNode(node) for node in self._processes.nodes]

    def _maintenance_set(self, event: events.MaintenanceSet) -> List[Command]:
        """Kill and start nothing, or do so again once the monitors had a moment to tell."""
        if event.on is (self._held_until == inf):
            return []
        self._held_until = inf if event.on else event.time + ANSWER_S
        if event.on:
            self._maintain(True)
            return [Log(Level.WARN, "Maintenance: nothing is killed or started.")]
        asked = map(events.AskMonitor, ("", *self.robot.som.hosts))
        return [Log(Level.INFO, "The maintenance is over."), *asked]

    def _maintain(self, on: bool) -> None:
        self.robot.maintained = on
        self._processes.hold_starts(inf if on else -inf)
        self._core.ask_all(self._processes.substituted, lambda each: [])

    def _let_through(self, event: Event) -> List[Event]:
        """Return what is heeded now, in maintenance; hold the rest."""
        if self.robot.time >= self._held_until:
            self._maintain(False)
            held, self._held = self._held, {}
            return [*held.values(), event]
        if isinstance(event, NOT_HELD) or (self._held_until < inf and isinstance(event, HEALTH)):
            return [event]
        if not isinstance(event, FORGOTTEN):  # of a computer the newest word counts
            self._held[getattr(event, "host", len(self._held))] = event
        return []

    def _node_learned(self, event: events.NodeLearned) -> List[Command]:
        self.robot.identities.learned(event)
        if event.known and event.starts:  # somebody has started it anew
            self.robot.abandoned.discard(event.node)
        self._core.unsettle_node(event.node)
        return []

    def _node_unregistered(self, event: events.NodeUnregistered) -> List[Command]:
        self._nodes.left_in_order(event.node)
        return self._core.ask_accusers(event.node, lambda each: each.step())

    def _node_restarted(self, event: events.NodeRestarted) -> List[Command]:
        if event.node not in self.robot.health.substitutes:  # none of ours is ever started again
            self.robot.restarted.add(event.node)
        return []

    def _starter_ended(self, event: events.StarterEnded) -> List[Command]:
        ours = event.node in self.robot.restarted
        self.robot.restarted.discard(event.node)
        self.robot.abandoned.add(event.node)
        self.robot.health.startable.discard(event.node)
        return [events.StopNode(event.node)] if ours else []

    def _process_exited(self, event: events.ProcessExited) -> List[Command]:
        what = "died" if event.started else "was not started"
        return self._process_failed(event.node, f"its process {what} ({event.detail})")

    def _process_pulse(self, event: events.ProcessPulse) -> List[Command]:
        if event.heard:
            return self._processes.heard(event.node)
        return self._process_failed(event.node, "its process gives no sign of life")

    def _process_failed(self, node: str, why: str) -> List[Command]:
        served = self._processes.served(node)
        commands = self._processes.failed(node, why)
        return commands + self._core.ask_all(served, lambda each: each.substitute_failed(why))

    def _requested(self, event: events.SubstituteRequested) -> List[Command]:
        incident = self._core.incident(event.service)
        service = self.robot.som.services.get(event.service)
        if incident is not None:
            return [events.ShowIncident(incident)]
        if service is None:
            return []
        well = next((row for row in self.services[service.name].originals if row.is_well), None)
        node, last_good = (well.publisher, well.last_good) if well else (service.node, None)
        what = service.name, service.topic, node, Kind.REQUESTED, "somebody asked for a substitute"
        failure = FailureSeen(event.time, *what, last_good, event.last_message)
        return hearing.failed(self._core, failure)

    def _calibrations_heard(self, event: events.CalibrationsHeard) -> List[Command]:
        """Note what the substitutes start with; one that computes already, as hot, follows."""
        known, services = self.robot.calibrations, self.services
        healing = self.robot.indexes.healing
        for name, program in event.removed:
            if name not in healing:
                known.leave(name, program)
        counts = [row.service for row in event.rows if known.add(row, row.service in healing)]
        self.robot.planner.replan()
        names = [n for n in dict.fromkeys(counts) if n in services and services[n].node]
        outgrown = lambda each: each.fire(Trigger.OUTGROWN) if each.state is State.HEALED else []
        return self._core.ask_all(names, outgrown)

    def _idle(self, event: events.Idle) -> List[Command]:
        """Make one plan ahead; what follows it follows the new one."""
        plans = self.robot.planner.plans
        name = plans.step()
        if name is None:
            return []
        self._processes.stand_by(self.robot.som.services[name], plans.plan(name))
        return self._core.ask(name, lambda each: each.replan())

    def _tick(self, event: events.Tick) -> List[Command]:
        commands = self._nodes.tick()
        if self.robot.computers.settling.pop_due(event.time):
            # What stands by goes where it belongs.
            commands += hearing.rehost(self._core)
        commands += hearing.tick(self._core, event.time)
        due = self._core.agenda.pop_due(event.time)
        return commands + self._core.ask_all(due, lambda each: each.tick())

    def validate(self) -> None:
        """Raise ShsaError if an invariant of a machine, or between them, is broken."""
        robot, processes = self.robot, self._processes
        owners: Dict[str, str] = {node: "the pool" for node in processes.pool.processes}
        for name, machine in self.services.items():
            machine.validate()
            node, incident, state = machine.node, machine.incident, machine.state
            shares = machine.substitute.shared and len(processes.served(node)) > 1
            if node and node in owners and not shares:
                raise ShsaError(f"{node} works for {name} and for {owners[node]}")
            if node:
                owners[node] = name
            nodes, faulty = self._nodes, incident.faulty_node
            if state is State.HEALING and not machine.timers:
                if not (nodes.awaited(faulty) or nodes.kills.under_way(faulty)):
                    raise ShsaError(f"{name} is being healed, and nothing will ever happen")
            if state is not State.WELL and robot.availability.states.rows[name].available:
                raise ShsaError(f"{name} is {state} and available at the same time")
            host = machine.substitute.host
            if node and robot.computers.lost(host) and not machine.publishes:
                raise ShsaError(f"{node} is idle for {name} on {host}, which is lost")
        processes.validate(owners)
        self._nodes.validate()
        for row in processes.wanted.rows.values():
            if row.publishing and self.services[row.service].state is State.WELL:
                raise ShsaError(f"{row.node} publishes for {row.service}, which is well")
