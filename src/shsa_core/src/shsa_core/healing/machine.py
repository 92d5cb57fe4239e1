"""The reconfigurator's decisions: events in, commands out (Section IV-C of the paper).

Three machines decide: `service` (what publishes a service), `node` (what becomes of a faulty node)
and `process` (which processes of substitutes run where). Here an event goes to those that it
concerns, and what follows from their answers is kept up. What is known of the rest stays as it is,
so that a decision costs the same on a large robot.
"""
from dataclasses import replace
from functools import partial
from operator import attrgetter
from typing import Any, Callable, Collection, Dict, Iterable, List, Optional, Tuple, Type

from shsa_core import dispatch
from shsa_core.agenda import Agenda
from shsa_core.codegen.plans import Plan
from shsa_core.errors import ModelError, ShsaError
from shsa_core.healing import events, hearing, reach, succession
from shsa_core.healing.events import Command, Event, FailureSeen
from shsa_core.healing.incident import WELL, Incident, State
from shsa_core.healing.node import NODE_EVENTS, RestartVain, Said
from shsa_core.healing.process import is_warm
from shsa_core.healing.records import Counters, RestartedNode, ServiceRecord, Table
from shsa_core.healing.repair import STUCK, SUBSTITUTED
from shsa_core.healing.robot import Robot
from shsa_core.healing.service import ServiceMachine
from shsa_core.healing.settings import Settings
from shsa_core.healing.containment import Computed
from shsa_core.model.kinds import Kind, Policy
from shsa_core.model.names import full_name
from shsa_core.model.ontology import Ontology
from shsa_core.model.service import Service
from shsa_core.model.som import Som
from shsa_core.model.substitution import row_key
from shsa_core.monitoring.events import PublisherState

TELLING = (events.Log, events.ShowIncident, events.ShowSom)
"""Commands for people come after those that act: a line of the log takes as long as a takeover."""

Ask = Callable[[ServiceMachine], List[Command]]


class Reconfigurator:
    """Heals every needed service of a SOM.

    Args:
        ontology: the relations to search.
        som: the services; may change later by SomChanged.
        settings: times and limits.
        namespace: where healing runs: relative names are in it, and so are the substitutes' names,
            which are never used twice.
        dry_run: advise, whatever the SOM says: nothing is killed or started.
        restarts: whether nodes may be started again; else their policy counts as the rest of it.
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
        self.settings = settings
        self.ending = self._over = False
        self._namespace = namespace
        self._dry_run = dry_run
        self._restarts = restarts
        self.robot = robot = Robot(ontology, self._as_told(som), settings, namespace, host)
        self.names = robot.names
        self.services: Dict[str, ServiceMachine] = {}
        self.asked: Agenda[str] = Agenda()  # computers whose monitor owes its table
        self._agenda: Agenda[str] = Agenda()
        self._unsettled: Dict[str, bool] = {}  # services whose availability may have changed
        self._states: Table[events.ServiceState, events.ShowSom] = Table(events.ShowSom)
        self._watched: Tuple[str, ...] = ()
        self._ended: List[str] = []  # services whose incident has ended with the last event
        self._nodes, self._processes = nodes, _ = robot.nodes, robot.processes
        for service in robot.som:
            self._add(service)
        self._handlers: Dict[Type[Event], Callable[[Any], List[Command]]] = dispatch.table(
            Event,
            {
                events.Started: partial(succession.started, self),
                events.Prepared: self._prepared,
                events.ShuttingDown: self._shutting_down,
                events.LaunchEnding: self._launch_ending,
                events.FailureSeen: partial(hearing.failure_seen, self),
                events.HealthSeen: partial(hearing.health_seen, self),
                events.SomChanged: self._som_changed,
                events.ModelsReloaded: self._models_reloaded,
                events.NodeLearned: self._node_learned,
                events.NodeCameUp: self._node_came_up,
                events.NodeFound: lambda event: self.deliver(nodes.heed(event)),
                events.NodeLeft: lambda event: self.deliver(nodes.heed(event)),
                events.ProcessUntouchable: lambda event: self.deliver(nodes.heed(event)),
                events.NodeUnregistered: lambda event: self.deliver(nodes.left_in_order(event)),
                events.SubstituteStarted: self._substitute_started,
                events.ProcessExited: self._process_exited,
                events.ProcessSilent: self._process_silent,
                events.ProcessHeard: self._process_heard,
                events.ProcessHung: self._process_hung,
                events.SubstituteRequested: self._requested,
                events.NodeRestarted: self._node_restarted,
                events.RestartFailed: lambda e: self.deliver(
                    [RestartVain(e.time, e.node, e.detail)]
                ),
                events.StarterEnded: self._starter_ended,
                events.Released: lambda e: self.ask(e.service, lambda each: each.released()),
                events.CalibrationsHeard: self._calibrations_heard,
                events.HostSeen: partial(reach.host_seen, self),
                events.HostLost: partial(reach.host_lost, self),
                events.Idle: self._idle,
                events.Tick: self._tick,
            },
        )

    def handle(self, event: Event) -> List[Command]:
        """Return what is to be done about `event`."""
        robot, processes = self.robot, self._processes
        if self._over:
            return []  # nobody would stop what is started now
        robot.time = max(robot.time, event.time)  # a failure is heard after it was seen
        self._forget_ended()
        commands = self._handlers[type(event)](event)
        if processes.starts.waiting:
            turns = processes.starts.due(robot.time)
            commands += self.ask_all(turns, lambda each: each.replan())
        commands += self.settle()
        if not self._over:
            commands += processes.refill(robot.time)
        watched = tuple(sorted({*robot.indexes.refused.values()}))
        if watched != self._watched:
            self._watched = watched
            commands.append(events.WatchNodes(watched))
        robot.records.set("counters", Counters(robot.incidents, robot.names.next))
        # What is written down comes first; then the table, which decides who publishes.
        first: List[Command] = [*robot.records.change(), *processes.wanted.change()]
        acting: List[Command] = []
        telling: List[Command] = []
        for command in (*first, *commands, *self._states.change()):
            (telling if isinstance(command, TELLING) else acting).append(command)
        return acting + telling

    @property
    def plans_ahead(self) -> bool:
        """Tell that there are plans to make before they are needed: Idle makes one."""
        return self.robot.planner.plans.stale

    @property
    def deadline(self) -> Optional[float]:
        """Return when a Tick is due, in s; None: none is."""
        robot = self.robot
        dues = (
            self._agenda.next(),
            self._processes.deadline,
            self._nodes.deadline,
            self.asked.next(),
            robot.health.due,
            robot.computers.deadline,
        )
        return min((due for due in dues if due is not None), default=None)

    @property
    def substitutes(self) -> Tuple[str, ...]:
        """Return the node names of the substitutes that run now."""
        return self._processes.nodes

    def needed(self) -> Tuple[Service, ...]:
        """Return the services that are healed when they fail."""
        return self.robot.som.needed()

    def find(self, name: str) -> Service:
        """Return the service of a name, a topic or a property; a needed one first.

        A relative topic is one in our namespace. Raises ModelError if there is none.
        """
        som = self.robot.som
        topic = full_name(name, self._namespace)
        found = [som.services[name]] if name in som.services else list(som.of_topic(topic))
        found += [source.service for source in som.of_property(name)]
        if not found:
            known = ", ".join(f"{each.name} ({each.topic})" for each in som)
            raise ModelError(name, f"the SOM has no such service or topic; it has {known}")
        return min(found, key=lambda service: not service.needed)

    def explain(self, name: str, without: Collection[str] = (), method: str = "") -> Plan:
        """Return what would be done if the node of a service failed. Raises ShsaError."""
        excluded = [self.robot.som.known_name(each, self._namespace) for each in without]
        plan = self.robot.planner.explain(self.find(name), excluded, method)
        return replace(plan, errors=self.robot.planner.errors(plan))

    def incident(self, service: str) -> Optional[Incident]:
        """Return the open incident of a service."""
        machine = self.services.get(service)
        return machine.incident if machine and machine.incident is not WELL else None

    # Asking services, and keeping up what follows.

    def ask(self, name: str, ask: Ask, removed: Optional[Service] = None) -> List[Command]:
        """Have a service decide, and keep up what follows; `removed`: what it was in the SOM."""
        machine, robot = self.services.get(name), self.robot
        service = removed or robot.som.services.get(name)
        if machine is None or service is None:
            return []
        machine.spec = service
        if service.host and removed is None:
            machine.spec = robot.spec(name) or service
        before = machine.incident
        decided = before, machine.substitute.node, machine.substitute.plan
        commands = ask(machine)
        incident, substitute = machine.incident, machine.substitute
        row, due, refuses = machine.row(), machine.deadline, machine.refuses
        record = machine.record(row)
        if (incident, substitute.node, substitute.plan) != decided:
            self._follow(machine, refuses)
        self._agenda.set(name, due)
        if row is not None:
            self._processes.wanted.set(row_key(row), row)
        shown: Optional[Incident] = None
        for each in commands:
            shown = each.incident if isinstance(each, events.ShowIncident) else shown
        if shown is not None and incident is WELL:
            record = replace(record, incident=shown)  # until it is told, and logged
            self._ended.append(name)
            robot.calibrations.healed(name)
        empty = record == ServiceRecord(name)
        robot.records.set(f"service {name}", None if empty else record)
        if (before is WELL) != (incident is WELL):
            self.unsettle([name])
        return commands

    def _follow(self, machine: ServiceMachine, refuses: bool) -> None:
        """Keep up the indexes of a service that has decided."""
        name, indexes = machine.spec.name, self.robot.indexes
        incident, plan = machine.incident, machine.substitute.plan
        reads = plan.inputs if isinstance(plan, Plan) else ()
        indexes.follow(name, tuple(dict.fromkeys([source.service.name for source in reads])))
        if incident is WELL:
            return
        if incident.state in STUCK:
            indexes.stuck[name] = None
        if incident.state is State.KEPT or incident.kept:
            indexes.kept[name] = None
        if incident.state in SUBSTITUTED:
            indexes.computed[name] = Computed(incident.faulty_node, machine.substitute.tried)
        if refuses:
            indexes.refused[name] = incident.faulty_node

    def ask_all(self, names: Iterable[str], ask: Ask) -> List[Command]:
        """Have some services decide."""
        commands: List[Command] = []
        for name in list(names):
            commands += self.ask(name, ask)
        return commands

    def deliver(self, said: Iterable[Said]) -> List[Command]:
        """Carry what became of nodes to the services that accuse them; the rest are commands."""
        commands: List[Command] = []
        for each in said:
            if not isinstance(each, NODE_EVENTS):
                commands.append(each)  # type: ignore[arg-type]
                continue
            event = each
            self.unsettle_node(event.node)
            accusers = self._nodes.accusers(event.node)
            commands += self.ask_all(accusers, lambda service: service.heed(event))
        return commands

    def settle(self) -> List[Command]:
        """See which services come and go by what has happened, and tell those whom it concerns."""
        commands: List[Command] = []
        robot, indexes = self.robot, self.robot.indexes
        while self._unsettled:
            names, self._unsettled = self._unsettled, {}
            looked = [(name, another, self._missing(name)) for name, another in names.items()]
            others = [name for name, another in names.items() if another]
            gone, come = robot.availability.update(robot.som, looked)
            for name in names:
                self._states.set(name, robot.availability.states.get(name))
            robot.planner.plans.change(gone, come)
            for name in indexes.readers((*others, *map(attrgetter("name"), gone))):
                commands += self.ask(name, lambda each: each.changed())
            if come:
                waiting = [*indexes.stuck, *indexes.kept]
                commands += self.ask_all(waiting, lambda each: each.changed(service_came=True))
        return commands

    def _missing(self, name: str) -> str:
        """Return why a service is not available whoever is well; empty: it may be."""
        machine, service = self.services.get(name), self.robot.som.services.get(name)
        if machine is not None and machine.incident is not WELL:
            return "failed"
        if service is None or not service.host or not service.event_driven:
            return ""
        lost = self.robot.lost(service.host)  # no silence tells of one that is due at no time
        return f"{service.host} is lost: {lost}" if lost else ""

    def unsettle(self, names: Iterable[str], another: bool = False) -> None:
        """Look again whether some services are available; `another`: they are other ones now."""
        for name in names:
            self._unsettled[name] = another or self._unsettled.get(name, False)

    def unsettle_node(self, node: str) -> None:
        """Look again at the services that a node publishes."""
        for topic in self.robot.health.topics.get(node, ()):
            self.unsettle(self.concerned(topic, node))

    def concerned(self, topic: str, publisher: str) -> List[str]:
        """Return the services that a publisher of a topic may be of."""
        som = self.robot.som
        service = som.service_of(topic, publisher)
        return [service.name] if service else [each.name for each in som.of_topic(topic)]

    def _forget_ended(self) -> None:
        """Forget the incidents that have ended with the event before: they are logged by now."""
        names, self._ended = self._ended, []
        for name in names:
            key = ServiceRecord(name).key
            record = self.robot.records.rows.get(key)
            if isinstance(record, ServiceRecord) and record.incident is not None:
                if record.incident.state is State.ENDED:
                    record = replace(record, incident=None)
                empty = record == ServiceRecord(name)
                self.robot.records.set(key, None if empty else record)

    # Services come and go.

    def _as_told(self, som: Som) -> Som:
        """Return a SOM as it counts: it may have to advise only, or to restart nothing."""
        if not self.acts(som):
            return som.with_services(replace(each, policy=Policy.ADVISE) for each in som)
        if self._restarts:
            return som
        return som.with_services(replace(each, policy=_without_restart(each)) for each in som)

    def acts(self, som: Som) -> bool:
        """Tell that something may be killed or started: the SOM says so, and it is no dry run."""
        return som.act and not self._dry_run

    def _add(self, service: Service) -> None:
        self.services[service.name] = ServiceMachine(service, self.robot)
        self.unsettle([service.name], another=True)
        self._offer(service)

    def _change(self, service: Service) -> List[Command]:
        self.unsettle([service.name], another=True)
        self._offer(service)
        if not service.needed:
            return self.ask(service.name, lambda each: each.close())
        return self.ask(service.name, lambda each: each.replan())

    def _remove(self, service: Service) -> List[Command]:
        name = service.name
        commands = self.ask(name, lambda each: each.close(), service)
        del self.services[name]
        self.robot.planner.plans.forget(name)
        self.robot.calibrations.forget(name)
        self._processes.no_stand_by(name)
        self._agenda.set(name, None)
        self.unsettle([name], another=True)
        return commands

    def _offer(self, service: Service) -> None:
        """Plan ahead for a service if it is needed, and let the pool serve it if it is warm."""
        plans = self.robot.planner.plans
        if service.needed:
            plans.serve(service)
        else:
            plans.forget(service.name)
        if is_warm(service):
            self.robot.stand_by(service, None)
        else:
            self._processes.no_stand_by(service.name)

    def _som_changed(self, event: events.SomChanged) -> List[Command]:
        robot = self.robot
        old, robot.som = robot.som, self._as_told(event.som)
        robot.planner.som = som = robot.som
        commands: List[Command] = []
        for name in [name for name in old.services if name not in som.services]:
            commands += self._remove(old.services[name])
        for service in som:
            before = old.services.get(service.name)
            if before is not None and before.topic != service.topic:
                commands += self._remove(before)
                before = None
            if before is None:
                self._add(service)
                continue
            beside = len(old.of_topic(service.topic)) > 1, len(som.of_topic(service.topic)) > 1
            if before != service or beside[0] is not beside[1]:
                commands += self._change(service)
        commands += self.ask_all(robot.indexes.kept, lambda each: each.reconsider())
        if old.hosts or som.hosts:
            commands += reach.rehost(self)
        return commands + hearing.look_again(self)

    def _models_reloaded(self, event: events.ModelsReloaded) -> List[Command]:
        """Let plans follow the new models; what runs goes on."""
        self.robot.planner.load(event.ontology, self.robot.som)
        return self._som_changed(events.SomChanged(event.time, event.som))

    # The rest of the events.

    def _prepared(self, event: events.Prepared) -> List[Command]:
        self._processes.starts.release()
        return []

    def _shutting_down(self, event: events.ShuttingDown) -> List[Command]:
        """End every substitute, and the nodes that whoever ends us has started first."""
        self._over = True
        for key in [key for key in self.robot.records.rows if key != "counters"]:
            self.robot.records.set(key, None)
        self._processes.starts.forget()
        ended: List[Command] = [events.StopSubstitute(node) for node in self.substitutes]
        return ended + [events.StopNode(n) for n, ours in self._nodes.restarted.items() if ours]

    def _launch_ending(self, event: events.LaunchEnding) -> List[Command]:
        """Heal nothing from now on: what stops does so on purpose."""
        self.ending = True
        self._processes.starts.forget()
        return []

    def _node_learned(self, event: events.NodeLearned) -> List[Command]:
        self._nodes.learned(event)
        self.unsettle_node(event.node)
        return []

    def _node_came_up(self, event: events.NodeCameUp) -> List[Command]:
        return self.ask_all(self._nodes.accusers(event.node), lambda each: each.came_up())

    def _node_restarted(self, event: events.NodeRestarted) -> List[Command]:
        if event.node not in self.robot.health.substitutes:  # none of ours is ever started again
            self._nodes.restarted[event.node] = event.with_us
            record = RestartedNode(event.node, event.with_us)
            self.robot.records.set(record.key, record)
        return []

    def _starter_ended(self, event: events.StarterEnded) -> List[Command]:
        """End a node that was started again with whoever started it first."""
        ours = self._nodes.forget_restarted(event.node)
        return [events.StopNode(event.node)] if ours else []

    def _substitute_started(self, event: events.SubstituteStarted) -> List[Command]:
        return self.ask_all(self._processes.served(event.node), lambda each: each.started(event))

    def _process_exited(self, event: events.ProcessExited) -> List[Command]:
        served, commands = self._processes.exited(event)
        return commands + self.ask_all(served, lambda each: each.exited(event.detail))

    def _process_silent(self, event: events.ProcessSilent) -> List[Command]:
        self._processes.silent(event.node)
        return self.ask_all(self._processes.served(event.node), lambda each: each.process_silent())

    def _process_heard(self, event: events.ProcessHeard) -> List[Command]:
        self._processes.heard(event.node)
        return []

    def _process_hung(self, event: events.ProcessHung) -> List[Command]:
        served, commands = self._processes.served(event.node), self._processes.hung(event.node)
        return commands + self.ask_all(served, lambda each: each.process_hung())

    def _requested(self, event: events.SubstituteRequested) -> List[Command]:
        incident, service = self.incident(event.service), self.robot.som.services.get(event.service)
        if incident is not None:
            return [events.ShowIncident(incident)]
        if service is None:
            return []
        originals = self.robot.health.originals(self.robot.som, service)
        healthy = [row for row in originals if row.state is PublisherState.HEALTHY]
        node = healthy[0].publisher if healthy else service.node
        last_good = healthy[0].last_good if healthy else None
        what = service.name, service.topic, node, Kind.REQUESTED, "somebody asked for a substitute"
        failure = FailureSeen(event.time, *what, last_good, event.last_message)
        return hearing.failed(self, failure)

    def _calibrations_heard(self, event: events.CalibrationsHeard) -> List[Command]:
        """Note what the substitutes start with; one that computes already, as hot, follows."""
        known, services = self.robot.calibrations, self.services
        for name, program in event.removed:
            if self.incident(name) is None:
                known.leave(name, program)
        healing = {row.service: self.incident(row.service) is not None for row in event.rows}
        counts = [row.service for row in event.rows if known.add(row, healing[row.service])]
        names = [n for n in dict.fromkeys(counts) if n in services and services[n].node]
        return self.ask_all(names, lambda each: [])

    def _idle(self, event: events.Idle) -> List[Command]:
        """Make one plan ahead; what follows it follows the new one."""
        plans = self.robot.planner.plans
        name = plans.step()
        if name is None:
            return []
        service = self.robot.som.services[name]
        if is_warm(service):
            self.robot.stand_by(service, plans.plan(name))
        return self.ask(name, lambda each: each.replan())

    def _tick(self, event: events.Tick) -> List[Command]:
        commands = self.deliver(self._nodes.tick())
        if self.robot.computers.settled(event.time):  # what stands by goes where it belongs
            commands += reach.rehost(self)
        commands += hearing.tick(self, event.time)
        return commands + self.ask_all(self._agenda.pop_due(event.time), lambda each: each.tick())

    def validate(self) -> None:
        """Raise ShsaError if an invariant is broken.

        These are those of each machine, one publisher a service, one owner a process, none that
        stands by where it cannot be told, and something that will happen next in each incident.
        """
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
            waits = state is State.HEALING and machine.deadline is None
            if waits and not self._nodes.busy(incident.faulty_node):
                raise ShsaError(f"{name} is being healed, and nothing will ever happen")
            if state is not State.WELL and robot.availability.states[name].available:
                raise ShsaError(f"{name} is {state} and available at the same time")
            host = machine.substitute.host
            if node and robot.computers.lost(host) and not machine.publishes:
                raise ShsaError(f"{node} stands by for {name} on {host}, which is lost")
        processes.validate(owners)
        self._nodes.validate()
        for row in processes.wanted.rows.values():
            if row.publishing and self.services[row.service].state is State.WELL:
                raise ShsaError(f"{row.node} publishes for {row.service}, which is well")


def _without_restart(service: Service) -> Policy:
    if not service.policy.restarts:
        return service.policy
    return Policy.SUBSTITUTE if service.policy.substitutes else Policy.ADVISE
