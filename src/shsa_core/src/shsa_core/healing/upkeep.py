"""What the reconfigurator knows of the robot, kept up by what happens and by what is decided."""
from dataclasses import replace
from functools import partial
from typing import Callable, Dict, Iterable, List, Optional, Sequence, Set, Tuple

from shsa_core.codegen.plans import Plan
from shsa_core.errors import ShsaError
from shsa_core.healing import events
from shsa_core.agenda import Agenda
from shsa_core.healing.availability import Availability
from shsa_core.healing.awaited_kills import AwaitedKills
from shsa_core.healing.calibrations import Calibrations
from shsa_core.healing.concern import Concern
from shsa_core.healing.events import Command
from shsa_core.healing.hosts import Hosts
from shsa_core.healing.incident import State
from shsa_core.healing.kills import KillNode, Kills
from shsa_core.healing.naming import Names
from shsa_core.healing.nodes import Acquaintance, Nodes
from shsa_core.healing.planner import Planner
from shsa_core.healing.pool import Pool, Spare
from shsa_core.healing.records import HealingRecord, Records, service_key
from shsa_core.healing.settings import Settings
from shsa_core.healing.sharing import Shared, Sharing
from shsa_core.healing.snapshot import Request, Snapshot
from shsa_core.healing.stakes import Stakes
from shsa_core.healing.starts import Starts
from shsa_core.healing.strays import Strays
from shsa_core.healing.tables import SomTable, SubstitutionTable
from shsa_core.healing.topic import SUBSTITUTED, TopicHealing
from shsa_core.healing.whereabouts import Whereabouts
from shsa_core.model.kinds import Kind, OnPartition, Policy
from shsa_core.model.ontology import Ontology
from shsa_core.model.service import Service
from shsa_core.model.som import Som
from shsa_core.model.substitution import Substitution, row_key, shared_key
from shsa_core.monitoring.events import PublisherHealth, PublisherState

Ask = Callable[[TopicHealing, Snapshot], List[Request]]


class Upkeep:
    """The healing of every service, and what each must know of the rest.

    A healing is asked with a snapshot. What follows from its answer for the others is seen to
    here: which services come and go by it, whose substitute reads them, which rows are shown.
    """

    def __init__(
        self,
        ontology: Ontology,
        som: Som,
        settings: Settings,
        namespace: str,
        dry_run: bool,
        restarts: bool,
        host: str,
    ) -> None:
        self.settings = settings
        self.names = Names(namespace)
        self._namespace = namespace
        self._dry_run = dry_run
        self._restarts = restarts
        self._som = som = self._as_told(som)
        self._time = float("-inf")
        self._nodes = Nodes()
        self._acquaintance = Acquaintance()
        self._kills = Kills(settings.kill_patience)
        self._hosts = Hosts(settings, host)
        self._availability = Availability(self._nodes, self._open, lambda h: self._where.lost(h))
        self._calibrations = Calibrations(self._open)
        self._planner = self._planner_of(ontology)
        self._pool = Pool(settings)
        self._starts = Starts()
        self._sharing = Sharing(settings.hot_hosts)
        self._healings: Dict[str, TopicHealing] = {}
        self._agenda: Agenda[str] = Agenda()
        self._concern = Concern()
        self._stakes = Stakes(self.names, self._nodes, self._kills, self._concern, self._healings)
        self._unsettled: Dict[str, bool] = {}  # services whose availability may have changed
        self._substitutions = SubstitutionTable()
        self._states = SomTable()
        self._incidents = 0
        self._watched: Tuple[str, ...] = ()
        self._records = Records()
        self._strays = Strays(self._hosts, self._records)
        self._awaited = AwaitedKills(self._hosts)
        about = self._hosts, self._strays, self._pool, self._concern, self._healings
        self._where = Whereabouts(lambda: self._som, *about)
        self._ended: List[str] = []  # services whose incident has ended with the last event
        self._with_us: Dict[str, bool] = {}  # nodes that were started again
        self._idle_written: Set[str] = set()
        for service in som:
            self._add(service)

    @property
    def substitutes(self) -> Tuple[str, ...]:
        """The node names of the substitutes that run now."""
        return (*self._concern.by_process, *self._pool.nodes)

    def _share(self, service: Service, plan: Plan) -> Optional[Shared]:
        """The process that the hot substitute of a service shares; None: it has its own."""
        return self._sharing.place(service, plan, self.names.fresh("host"))

    def _as_told(self, som: Som) -> Som:
        """A SOM as it counts: in a dry run every policy is to advise; restarts may be refused."""
        if self._restarts and not self._dry_run:
            return som
        return som.with_services(replace(each, policy=self._policy(each)) for each in som)

    def _policy(self, service: Service) -> Policy:
        if self._dry_run:
            return Policy.ADVISE
        if not service.policy.restarts:
            return service.policy
        return Policy.SUBSTITUTE if service.policy.substitutes else Policy.ADVISE

    def _planner_of(self, ontology: Ontology) -> Planner:
        return Planner(
            ontology,
            self._som,
            self.settings,
            self._nodes,
            self._availability,
            self._kills,
            self._calibrations,
        )

    def _open(self, name: str) -> bool:
        healing = self._healings.get(name)
        return healing is not None and healing.state is not State.WELL

    def _add(self, service: Service) -> None:
        self._healings[service.name] = TopicHealing(service.name, self.settings)
        self._unsettle([service.name], another=True)
        self._offer(service)

    def _change(self, service: Service) -> List[Command]:
        self._unsettle([service.name], another=True)
        self._offer(service)
        if not service.needed:
            return self._ask(service.name, lambda healing, now: healing.close(now), service)
        return self._ask(service.name, lambda healing, now: healing.replan(now))

    def _remove(self, service: Service) -> List[Command]:
        commands = self._ask(service.name, lambda healing, now: healing.close(now), service)
        del self._healings[service.name]
        self._planner.plans.forget(service.name)
        self._pool.forget(service.name)
        self._calibrations.forget(service.name)
        self._substitutions.set(service.name, None)
        self._agenda.set(service.name, None)
        self._unsettle([service.name], another=True)
        return commands

    def _offer(self, service: Service) -> None:
        """Plan ahead for a service if it is needed, and let the pool serve it if it is warm."""
        if service.needed:
            self._planner.plans.serve(service)
        else:
            self._planner.plans.forget(service.name)
        if self._pool.serves(service):
            self._stand_by(service, None)
        else:
            self._pool.forget(service.name)
            self._substitutions.set(service.name, None)

    def _stand_by(self, service: Service, plan: Optional[Plan]) -> None:
        """Let the pool serve a warm service, on the computer that its plan is placed on."""
        host = self._where.stands_by(self._time, service, plan)
        self._pool.serve(service, self._planner, plan, host)
        self._substitutions.set(service.name, self._pool.plans[service.name])

    def _spare(self, service: Service, host: str) -> Spare:
        return self._pool.spare(host) if self._pool.serves(service) else Spare()

    def _rows(self, service: Service) -> List[PublisherHealth]:
        """How the originals of a service do, with the row that says that nobody was ever seen."""
        nobody = self._nodes.health(service.topic).get("")
        rows = list(self._availability.originals(self._som, service))
        alone = len(self._som.of_topic(service.topic)) == 1
        return rows + [nobody] if nobody is not None and alone else rows

    def _acquaint(self, node: str, row: Optional[PublisherHealth]) -> List[Command]:
        if row is None or (row.state is PublisherState.FAILED and row.kind is Kind.NODE_GONE):
            self._acquaintance.went(node)
        elif row.state is PublisherState.HEALTHY:
            # Only the nodes that the SOM names are learned: anybody registers other names.
            named = any(each.node == node for each in self._som.of_topic(row.topic))
            return self._acquaintance.came_up(node, row.topic) if named else []
        return []

    def _concerned(self, topic: str, publisher: str) -> List[str]:
        service = self._som.service_of(topic, publisher)
        return [service.name] if service else [each.name for each in self._som.of_topic(topic)]

    def _settle(self) -> List[Command]:
        """See which services come and go by what has happened, and tell those whom it concerns."""
        commands: List[Command] = []
        while self._unsettled:
            names, self._unsettled = self._unsettled, {}
            gone, come = self._availability.update(self._som, names)
            for name in names:
                self._states.set(name, self._availability.states.get(name))
            self._planner.plans.change(gone, come)
            others = [name for name, another in names.items() if another]
            for name in self._concern.readers([*others, *(service.name for service in gone)]):
                commands += self._ask(name, lambda healing, now: healing.changed(now))
            for name in [*self._concern.stuck, *self._concern.kept] if come else ():
                commands += self._ask(name, lambda healing, now: healing.changed(now, True))
        return commands

    def _start_waiting(self) -> List[Command]:
        """Prepare the hot services that waited, as far as there is room."""
        commands: List[Command] = []
        for name in self._starts.due(self._time):
            commands += self._ask(name, lambda healing, now: healing.replan(now))
        return commands

    def _refill(self) -> List[Command]:
        """Start the idle processes that are due."""
        commands: List[Command] = []
        for node in self._pool.surplus():
            commands += self._absorb(self._pool.drop(node))
            self._substitutions.set(node, None)
        if self._starts.held(self._time):
            return commands
        host = self._pool.due(self._time)
        while host is not None:
            name = self.names.fresh("standby")
            commands += self._absorb(self._pool.start(self._time, name, host))
            self._substitutions.set(name, Substitution(name, "", (), "", (), host=host))
            host = self._pool.due(self._time)
        return commands

    def _watch(self) -> List[Command]:
        """Be told when one of those comes up who are kept out."""
        watched = tuple(sorted(self._concern.kept_out))
        if watched == self._watched:
            return []
        self._watched = watched
        return [events.WatchNodes(watched)]

    def _ask_of(self, process: str, ask: Ask) -> List[Command]:
        """Have each service decide whose substitute runs in a process."""
        commands: List[Command] = []
        for name in self._concern.served(process):
            commands += self._ask(name, ask)
        return commands

    def _ask(self, name: str, ask: Ask, service: Optional[Service] = None) -> List[Command]:
        """Have the healing of a service decide, and keep up what follows from its decision."""
        healing = self._healings.get(name)
        service = service or self._som.services.get(name)
        if healing is None or service is None:
            return []
        before, node, plan = healing.incident, healing.node, healing.substitute.plan
        key = shared_key(node, name) if healing.substitute.shared else node
        now = self._snapshot(service)
        commands = self._absorb(ask(healing, now), name)
        self._agenda.set(name, healing.deadline)
        shown = [each.incident.id for each in commands if isinstance(each, events.ShowIncident)]
        self._incidents = max([self._incidents, *shown])
        incident = healing.incident
        if (incident, healing.node, healing.substitute.plan) != (before, node, plan):
            self._concern.follow(healing, before, node)
            self._note_process(service, healing, now.hot)
        if (before is None) != (incident is None):
            self._unsettle([name])
        if before is not None and incident is None:
            self._calibrations.healed(name)
        if node != healing.node:
            self._substitutions.set(key, None)
        row = self._show(service, healing)
        self._note_decision(healing, row, commands)
        return commands

    def _note_process(self, service: Service, healing: TopicHealing, hot: bool) -> None:
        """Note which process a hot substitute has, and whether it shares it."""
        shared = healing.substitute.shared
        self._sharing.follow(service, healing.node if hot or shared else "", shared)

    def _note_decision(
        self, healing: TopicHealing, row: Optional[Substitution], commands: Sequence[Command]
    ) -> None:
        """Write down how a service stands; that an incident has ended, until the next event."""
        record = healing.record(row)
        shown = [each.incident for each in commands if isinstance(each, events.ShowIncident)]
        if shown and shown[-1].state is State.ENDED:
            self._ended.append(healing.service)
            record = replace(record, incident=shown[-1])
        self._records.put(record)

    def _forget_ended(self) -> None:
        """What has ended with the event before is told by now, and logged."""
        names, self._ended = self._ended, []
        for name in names:
            record = self._records.get(service_key(name))
            if isinstance(record, HealingRecord):
                self._records.put(replace(record, incident=None, blame=None))
            if name not in self._healings:
                self._records.set(service_key(name), None)

    def _snapshot(self, service: Service) -> Snapshot:
        waiting = self._where.waiting(service)
        advised = replace(service, policy=Policy.ADVISE) if waiting else service
        return Snapshot(
            time=self._time,
            service=advised,
            settings=self.settings,
            planner=self._planner,
            publishers=self._nodes.health(service.topic),
            watched=self._nodes.watched(service.topic, self._where.unheard(service)),
            originals=self._availability.originals(self._som, service),
            killing=self._kills.nodes,
            incident=self._incidents + 1,
            place=partial(self._where.place, self._time, service),
            spare=partial(self._spare, service),
            fresh=self.names.fresh(service.topic.strip("/").replace("/", "_")),
            verdict=partial(self._stakes.verdict, self._planner, advised, waiting),
            awaited=partial(self._stakes.awaited, service),
            far=bool(self._where.host_of(service.node)),
            parted=self._where.parted(service),
            room=partial(self._starts.room, self._time, service.name),
            share=partial(self._share, service),
        )

    def _absorb(self, requests: Iterable[Request], of: str = "") -> List[Command]:
        """Carry out what concerns the reconfigurator itself; the rest are commands.

        `of`: the service whose healing wants it.
        """
        commands: List[Command] = []
        for request in requests:
            if isinstance(request, KillNode):
                host = self._where.host_of(request.node)
                if host and request.only_here and self._hosts.reachable(host):
                    self._awaited.add(self._time, request.node, host, True)
                    continue
                if not host:
                    request = replace(request, period=0.0)  # there is no link
                self._awaited.forget(request.node)
                commands += self._kills.begin(self._time, request)
                self._unsettle_node(request.node)
                continue
            if isinstance(request, events.RestartNode):
                if not self._nodes.begin_restart(request.node):
                    continue
            elif isinstance(request, events.StartSubstitute):
                running = (*self._concern.by_process, *self._pool.nodes)
                self._nodes.substitutes.add(request.node, running)
                self.names.use()
                self._starts.began(self._time, request.node)
            elif isinstance(request, events.StopSubstitute):
                if self._sharing.others(of, request.node):
                    continue
            elif isinstance(request, events.AssignSubstitute) and request.node in self._pool.nodes:
                self._pool.take(self._time, request.node)
            commands.append(request)
        return commands

    def _show(self, service: Service, healing: TopicHealing) -> Optional[Substitution]:
        """Show the row of a service's substitute in the table; None: it has none."""
        plan = healing.substitute.plan
        if plan is None or not healing.node:
            return None
        parted = self._where.parted(service)
        row = Substitution(
            healing.node,
            service.name,
            self._planner.inputs(plan),
            plan.program.code,
            self._planner.outputs(plan),
            plan.relations if isinstance(plan, Plan) else (),
            plan.quality if isinstance(plan, Plan) else 0.0,
            healing.publishes,
            "" if service.gated else healing.original,
            service.others,
            healing.last_message,
            healing.substitute.host,
            service.on_partition if parted else OnPartition.WAIT,
            parted and healing.yields,
            self._bridge(service, healing),
            gated=service.gated,
            shared=healing.substitute.shared,
        )
        self._substitutions.set(row_key(row), row)
        return row

    def _bridge(self, service: Service, healing: TopicHealing) -> float:
        """The silence in s after which a substitute that stands by fills in; 0: it does not.

        It does while the original may speak: while the service is well, until the original is
        killed, even if a bridge was heard by then, and from its return. Not on a shared topic,
        where somebody else is heard; nor from another computer, where what is late may be the link.
        """
        substitute = healing.substitute
        here = substitute.host == self._where.host_of(service.node)
        fits = here and service.policy.substitutes and isinstance(substitute.plan, Plan)
        waits = healing.state in SUBSTITUTED and not healing.publishes
        speaks = waits or healing.state in (State.WELL, State.RETURNING)
        if not speaks or not fits or is_shared(self._som, service):
            return 0.0
        return (service.bridges or 0.0) * (service.period or 0.0)

    def _unsettle(self, names: Iterable[str], another: bool = False) -> None:
        for name in names:
            self._unsettled[name] = another or self._unsettled.get(name, False)

    def _unsettle_node(self, node: str) -> None:
        for topic in self._nodes.topics(node):
            self._unsettle(self._concerned(topic, node))

    def validate(self) -> None:
        """Raises ShsaError if an invariant is broken.

        These are: one publisher a service, no process without an owner.
        """
        owners: Dict[str, str] = {node: "the pool" for node in self._pool.nodes}
        for name, healing in self._healings.items():
            healing.validate()
            shares = healing.substitute.shared and self._sharing.others(name, healing.node)
            if healing.node and healing.node in owners and not shares:
                raise ShsaError(f"{healing.node} works for {name} and for {owners[healing.node]}")
            if healing.node:
                owners[healing.node] = name
            waits = healing.state is State.HEALING and healing.deadline is None
            incident = healing.incident
            busy = incident and incident.faulty_node in self._kills.nodes
            if waits and incident and not busy and incident.faulty_node not in self._awaited:
                raise ShsaError(f"{name} is being healed, and nothing will ever happen")
            state = self._availability.states[name]
            if healing.state is not State.WELL and state.available:
                raise ShsaError(f"{name} is {healing.state} and available at the same time")
        for row in self._substitutions.rows():
            if row.node and row.node not in owners:
                raise ShsaError(f"{row.node} is in the table of substitutions, but has no owner")
            if row.publishing and self._healings[row.service].state is State.WELL:
                raise ShsaError(f"{row.node} publishes for {row.service}, which is well")


def is_shared(som: Som, service: Service) -> bool:
    """Whether a SOM has another service on the same topic."""
    return len(som.of_topic(service.topic)) > 1
