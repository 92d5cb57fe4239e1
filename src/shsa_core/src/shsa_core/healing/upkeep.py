"""What the reconfigurator knows of the robot, kept up by what happens and by what is decided."""
from typing import Callable, Dict, Iterable, List, Optional

from shsa_core.codegen.plans import Plan
from shsa_core.errors import ShsaError
from shsa_core.healing import events
from shsa_core.agenda import Agenda
from shsa_core.healing.availability import Availability
from shsa_core.healing.concern import Concern
from shsa_core.healing.events import Command
from shsa_core.healing.incident import State
from shsa_core.healing.kills import KillNode, Kills
from shsa_core.healing.nodes import Acquaintance, Nodes
from shsa_core.healing.planner import Planner
from shsa_core.healing.pool import Pool
from shsa_core.healing.settings import Settings
from shsa_core.healing.snapshot import Request, Snapshot
from shsa_core.healing.tables import SomTable, SubstitutionTable
from shsa_core.healing.topic import TopicHealing
from shsa_core.model.ontology import Ontology
from shsa_core.model.service import Service
from shsa_core.model.som import Som
from shsa_core.model.substitution import Substitution
from shsa_core.monitoring.events import PublisherHealth

Ask = Callable[[TopicHealing, Snapshot], List[Request]]
SUBSTITUTE_PREFIX = "substitute_"


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
    ) -> None:
        self.settings = settings
        self.prefix = namespace.rstrip("/") + "/" + SUBSTITUTE_PREFIX
        self._som = som
        self._time = float("-inf")
        self._nodes = Nodes()
        self._acquaintance = Acquaintance()
        self._kills = Kills(settings.kill_patience)
        self._availability = Availability(self._nodes, self._open)
        self._planner = Planner(ontology, som, settings, self._nodes, self._availability)
        self._pool = Pool(settings)
        self._healings: Dict[str, TopicHealing] = {}
        self._agenda: Agenda[str] = Agenda()
        self._concern = Concern()
        self._unsettled: Dict[str, bool] = {}  # services whose availability may have changed
        self._substitutions = SubstitutionTable()
        self._states = SomTable()
        self._incidents = 0
        self._next_substitute = 1
        for service in som:
            self._add(service)

    def _open(self, name: str) -> bool:
        healing = self._healings.get(name)
        return healing is not None and healing.state is not State.WELL

    def _add(self, service: Service) -> None:
        self._healings[service.name] = TopicHealing(service.name, self.settings)
        self._unsettle([service.name])
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
        self._substitutions.set(service.name, None)
        self._agenda.set(service.name, None)
        self._unsettle([service.name])
        return commands

    def _offer(self, service: Service) -> None:
        """Plan ahead for a service if it is needed, and let the pool serve it if it is warm."""
        if service.needed:
            self._planner.plans.serve(service)
        else:
            self._planner.plans.forget(service.name)
        if self._pool.serves(service):
            self._pool.serve(service, self._planner, None)
        else:
            self._pool.forget(service.name)
        self._substitutions.set(service.name, self._pool.plans.get(service.name))

    def _rows(self, service: Service) -> List[PublisherHealth]:
        """How the originals of a service do, with the row that says that nobody was ever seen."""
        nobody = self._nodes.health(service.topic).get("")
        rows = list(self._availability.originals(self._som, service))
        alone = len(self._som.of_topic(service.topic)) == 1
        return rows + [nobody] if nobody is not None and alone else rows

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
            for name in list(self._concern.stuck) if come else ():
                commands += self._ask(name, lambda healing, now: healing.changed(now, True))
        return commands

    def _refill(self) -> List[Command]:
        """Start the idle processes that are due."""
        commands: List[Command] = []
        due = self._pool.deadline
        while due is not None and self._time >= due:
            name = self._name("standby")
            commands += self._absorb(self._pool.start(self._time, name))
            self._substitutions.set(name, Substitution(name, "", (), "", ()))
            due = self._pool.deadline
        return commands

    def _ask(self, name: str, ask: Ask, service: Optional[Service] = None) -> List[Command]:
        """Have the healing of a service decide, and keep up what follows from its decision."""
        healing = self._healings.get(name)
        service = service or self._som.services.get(name)
        if healing is None or service is None:
            return []
        before, node, plan = healing.incident, healing.node, healing.substitute.plan
        commands = self._absorb(ask(healing, self._snapshot(service)))
        self._agenda.set(name, healing.deadline)
        incident = healing.incident
        if (incident, healing.node, healing.substitute.plan) != (before, node, plan):
            self._concern.follow(healing, before, node)
        if (before is None) != (incident is None):
            self._unsettle([name])
            self._incidents = max(self._incidents, incident.id if incident else 0)
        if node != healing.node:
            self._substitutions.set(node, None)
        self._show(service, healing)
        return commands

    def _snapshot(self, service: Service) -> Snapshot:
        return Snapshot(
            time=self._time,
            service=service,
            settings=self.settings,
            planner=self._planner,
            publishers=self._nodes.health(service.topic),
            originals=self._availability.originals(self._som, service),
            killing=self._kills.nodes,
            incident=self._incidents + 1,
            spare=self._pool.spare if self._pool.serves(service) else "",
            spare_started=self._pool.spare_started,
            fresh=self._name(service.topic.strip("/").replace("/", "_")),
        )

    def _absorb(self, requests: Iterable[Request]) -> List[Command]:
        """Carry out what concerns the reconfigurator itself; the rest are commands."""
        commands: List[Command] = []
        for request in requests:
            if isinstance(request, KillNode):
                commands += self._kills.begin(self._time, request)
                self._unsettle_node(request.node)
                continue
            if isinstance(request, events.RestartNode):
                if not self._nodes.begin_restart(request.node):
                    continue
            elif isinstance(request, events.StartSubstitute):
                self._nodes.substitutes.add(request.node)
                self._next_substitute += 1
            elif isinstance(request, events.AssignSubstitute) and request.node in self._pool.nodes:
                self._pool.take(self._time, request.node)
            commands.append(request)
        return commands

    def _show(self, service: Service, healing: TopicHealing) -> None:
        """The row of a service's substitute in the table."""
        plan = healing.substitute.plan
        if plan is None or not healing.node:
            return
        row = Substitution(
            healing.node,
            service.name,
            self._planner.inputs(plan),
            plan.program.code,
            self._planner.outputs(plan),
            plan.relations if isinstance(plan, Plan) else (),
            plan.quality if isinstance(plan, Plan) else 0.0,
            healing.publishes,
            healing.original,
        )
        self._substitutions.set(healing.node, row)

    def _unsettle(self, names: Iterable[str], another: bool = False) -> None:
        for name in names:
            self._unsettled[name] = another or self._unsettled.get(name, False)

    def _unsettle_node(self, node: str) -> None:
        for topic in self._nodes.topics(node):
            self._unsettle(self._concerned(topic, node))

    def _name(self, of: str) -> str:
        """A node name that was never used before."""
        return f"{self.prefix}{of}_{self._next_substitute}"

    def validate(self) -> None:
        """Raises ShsaError if an invariant is broken.

        These are: one publisher a service, no process without an owner.
        """
        owners: Dict[str, str] = {node: "the pool" for node in self._pool.nodes}
        for name, healing in self._healings.items():
            healing.validate()
            if healing.node and healing.node in owners:
                raise ShsaError(f"{healing.node} works for {name} and for {owners[healing.node]}")
            if healing.node:
                owners[healing.node] = name
            waits = healing.state is State.HEALING and healing.deadline is None
            incident = healing.incident
            if waits and incident and incident.faulty_node not in self._kills.nodes:
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
