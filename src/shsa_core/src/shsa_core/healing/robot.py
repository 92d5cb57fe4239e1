"""The rooms that the machines of the reconfigurator share: its knowledge of the robot."""
from dataclasses import replace
from math import inf
from typing import Dict, FrozenSet, Iterable, Iterator, List, Optional, Set, Tuple

from shsa_core.agenda import Agenda
from shsa_core.codegen.plans import Plan
from shsa_core.healing.events import Command, LearnNode, NodeLearned
from shsa_core.healing.events import ShowSubstitutions, WriteDown
from shsa_core.healing.health import Availability, Health
from shsa_core.healing.incident import STUCK, Incident, State
from shsa_core.healing.records import Record
from shsa_core.healing.settings import Settings
from shsa_core.model.kinds import OnPartition, Policy
from shsa_core.model.names import Names
from shsa_core.model.ontology import Ontology
from shsa_core.model.service import Service
from shsa_core.model.som import Som
from shsa_core.model.substitution import Substitution
from shsa_core.planning.placement import Computers
from shsa_core.planning.planner import Planner
from shsa_core.table import Table


class Indexes:
    """Services by what they read and wait for, kept up as they decide.

    `healing`: those with an incident, and the plans that were tried in vain. `partly`: those that
    nothing gives all values of.
    """

    def __init__(self) -> None:
        self.healing: Dict[str, Tuple[Incident, FrozenSet[Plan]]] = {}
        self.partly: Dict[str, None] = {}
        self._reads: Dict[str, Dict[str, None]] = {}
        self._readers: Dict[str, Set[str]] = {}

    @property
    def stuck(self) -> List[str]:
        """Return the services that nothing can heal now, or not with all values."""
        states = {name: incident.state for name, (incident, _) in self.healing.items()}
        return [*self.partly, *(name for name, state in states.items() if state in STUCK)]

    @property
    def kept(self) -> List[str]:
        """Return the services whose faulty node is kept."""
        healing = self.healing.items()
        return [n for n, (each, _) in healing if each.kept or each.state is State.KEPT]

    def readers(self, services: Iterable[str]) -> List[str]:
        """Return the services whose substitute reads one of some services."""
        return sorted({name for each in services for name in self._readers.get(each, ())})

    def follow(
        self, incident: Incident, name: str, plan: Optional[Plan], tried: FrozenSet[Plan]
    ) -> None:
        """Note how a service has decided, and what its substitute reads now."""
        self.healing.pop(name, None)
        self.partly.pop(name, None)
        sources = plan.inputs if plan else ()
        for read in self._reads.get(name, ()):
            self._readers[read].discard(name)
        self._reads[name] = {each.service.name: None for each in sources}
        for read in self._reads[name]:
            self._readers.setdefault(read, set()).add(name)
        if incident.state is not State.WELL:
            self.healing[name] = incident, tried
        if plan and plan.left_out:
            self.partly[name] = None


class Identities:
    """Learns which process a node is while it is healthy, once each time that it comes up.

    `Health.verified`, `startable` and `protected` tell of it.
    """

    def __init__(self, health: Health, settings: Settings) -> None:
        self.agenda: Agenda[str] = Agenda()  # nodes that are to be looked at again
        self._health, self._settings = health, settings
        self._tries: Dict[str, Tuple[int, str]] = {}  # and the topic by which they are learned

    def came_up(self, node: str, topic: str) -> List[Command]:
        """Learn a node that is healthy on a topic, unless it is known."""
        if node in self._tries:
            return []
        self._tries[node] = 0, topic
        return [LearnNode(node, topic)]

    def learned(self, event: NodeLearned) -> None:
        """Note what was learned; the next try follows after a pause if it failed."""
        node, protected = event.node, self._health.protected
        if not event.known and node in self._tries:
            tries, topic = self._tries[node]
            self._tries[node] = tries + 1, topic
            self.agenda.set(node, event.time + self._settings.paused(tries))
        if event.known:
            self._health.verified.add(node)
            startable = self._health.startable
            (startable.add if event.starts else startable.discard)(node)
            protected.pop(node, None)
        if event.protected:
            protected[node] = event.protected

    def went(self, node: str) -> None:
        """Forget which process a node is: what comes up under its name is another one."""
        if self._tries.pop(node, None) is not None:
            self.agenda.set(node, None)
        else:  # nobody will learn it anew
            self._health.protected.pop(node, None)

    def due(self, time: float) -> List[Command]:
        """Return the looks that are due."""
        return [LearnNode(node, self._tries[node][1]) for node in self.agenda.pop_due(time)]


class Robot:
    """Everything that is known; nothing here decides.

    `wanted`: the table of substitutions. `incidents`: the last one. `maintained`: by people now;
    `dry_run`: nothing is killed or started; `restarts`: nodes may be started again, as were those
    `restarted`; not so those `abandoned`, which end with the launch that started them first.
    """

    def __init__(
        self, ontology: Ontology, som: Som, settings: Settings, namespace: str, host: str
    ) -> None:
        self.settings = settings
        self.som = som
        self.time = -inf
        self.incidents = 0
        self.maintained = self.dry_run = False
        self.restarts = True
        self.wanted: Table[Substitution, ShowSubstitutions] = Table(ShowSubstitutions)
        self.restarted: Set[str] = set()
        self.abandoned: Set[str] = set()
        self.names = Names(namespace)
        self.records: Table[Record, WriteDown] = Table(WriteDown)
        self.health = Health(self.records)
        self.identities = Identities(self.health, settings)
        self.availability = Availability(self.health)
        self.computers = Computers(host, settings.held_off, settings.stable)
        self.indexes = Indexes()
        how = settings.method, settings.deadlines
        self.planner = Planner(ontology, som, self.availability.services, *how)
        self.calibrations = self.planner.calibrations

    def note_subscribers(self, subscribers: Iterable[Tuple[str, Tuple[str, ...]]]) -> None:
        """Note which nodes subscribe to topics."""
        for topic, nodes in subscribers:
            self.health.consumers[topic] = self.names.consumers(nodes)

    def acts(self, som: Som) -> bool:
        """Tell that something may be killed or started: the SOM says so, and it is no dry run."""
        return som.act and not self.dry_run

    def as_told(self, som: Som) -> Som:
        """Return a SOM as it counts: what is needed, and what may be done about it."""
        self.names.hosts = som.hosts

        def counts(service: Service) -> Service:
            policy = service.policy if self.acts(som) else Policy.ADVISE
            if policy.restarts and not self.restarts:
                policy = Policy.SUBSTITUTE if policy.substitutes else Policy.ADVISE
            needed = service.needed
            if needed is None:  # what is healed stays so: a consumer may be starting anew
                healing = service.name in self.indexes.healing
                needed = healing or bool(self.health.consumers.get(service.heard))
            return replace(service, policy=policy, needed=needed)

        return som.with_services(map(counts, som))

    def spec(self, name: str) -> Optional[Service]:
        """Return a service as it counts now: nothing is done while it waits for its computer."""
        service = self.som.services.get(name)
        waits = service is not None and self.waiting(service)
        return replace(service, policy=Policy.ADVISE) if service and waits else service

    def waiting(self, service: Service) -> str:
        """Return why nothing is done for a service that is cut off; empty: it is not so."""
        if service.on_partition is not OnPartition.WAIT or not service.host:
            return ""
        if self.computers.lost(service.host):
            return f"{service.host} cannot be reached, and on_partition is wait"
        doubted = self.computers.doubted(service.host, self.time)
        return f"{service.host} was not heard since, and on_partition is wait" if doubted else ""

    def planned_without(self, service: Service) -> List[str]:
        """Return the nodes that a service is to be planned without."""
        publishers = (row.publisher for row in self.health.originals(self.som, service))
        return [service.node, *publishers, *self.health.excluded]

    def host_of(self, node: str) -> str:
        """Return the computer that a node runs on; empty: our own, or not known."""
        row = self.wanted.rows.get(node)
        if row is not None or not self.som.hosts:
            return row.host if row else ""
        named = next((each.host for each in self.som if each.node == node and each.host), "")
        return self.computers.name(named)

    def on(self, host: str) -> Iterator[Service]:
        """Return the services whose nodes run on another computer."""
        return (each for each in self.som if host and self.computers.name(each.host) == host)
