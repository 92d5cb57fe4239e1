"""What the reconfigurator knows of the robot, for the services that decide."""
from dataclasses import replace
from math import inf
from typing import Dict, Iterator, List, Optional

from shsa_core.codegen.plans import Plan
from shsa_core.healing.containment import Stakes
from shsa_core.healing.health import Availability, Health
from shsa_core.healing.hosts import Computers
from shsa_core.healing.indexes import Indexes
from shsa_core.healing.naming import Names
from shsa_core.healing.node import Nodes
from shsa_core.healing.placement import Place, Placement
from shsa_core.healing.planner import AnyPlan, Calibrations, Planner
from shsa_core.healing.process import Processes
from shsa_core.healing.settings import Settings
from shsa_core.healing.tables import records
from shsa_core.model.cost import Cost, cost
from shsa_core.model.kinds import BY_LINK, Kind, OnPartition, Policy
from shsa_core.model.ontology import Ontology
from shsa_core.model.service import Service
from shsa_core.model.som import Som


class Robot:
    """The rooms of what is known; none of them decides about a service.

    Nodes are where the SOM says, substitutes where they were started. `doubted`: the services whose
    node is silent, and that wait until its computer is heard, at a moment in s or later.
    `incidents`: the last number of one. `room_at`: when it is
    looked again whether a computer has room.
    """

    def __init__(
        self, ontology: Ontology, som: Som, settings: Settings, namespace: str, host: str
    ) -> None:
        self.settings = settings
        self.som = som
        self.time = -inf
        self.incidents = 0
        self.room_at = -inf
        self.doubted: Dict[str, float] = {}
        self.names = Names(namespace)
        self.records = records()
        self.health = Health()
        self.availability = Availability(self.health)
        self.computers = Computers(settings, host)
        self.indexes = Indexes()
        self.calibrations = Calibrations()
        self.planner = self.plan_by(ontology)
        self.processes = Processes(settings, self.names, self.health, self.records)
        self.placement = Placement(self.computers, self._placed, lambda: self.som)
        stakes = Stakes(self.names, self.health, self.indexes, lambda: self.planner)
        self.nodes = Nodes(
            *(settings, self.health, stakes, self.computers),
            *(self._spec_of, self.host_of, self.records),
        )

    def plan_by(self, ontology: Ontology) -> Planner:
        """Return a planner that knows no plan yet."""
        rooms = self.health, self.availability, self.calibrations
        return Planner(ontology, self.som, self.settings, *rooms)

    def spec(self, service: Service) -> Service:
        """Return a service as it counts now: nothing is done while it waits for its computer."""
        waits = service.on_partition is OnPartition.WAIT and service.host and self.waiting(service)
        return replace(service, policy=Policy.ADVISE) if waits else service

    def _spec_of(self, name: str) -> Optional[Service]:
        service = self.som.services.get(name)
        return None if service is None else self.spec(service)

    def waiting(self, service: Service) -> str:
        """Return why nothing is done for a service that is cut off; empty: it is not so."""
        if service.on_partition is not OnPartition.WAIT or not service.host:
            return ""
        if self.lost(service.host):
            return f"{service.host} cannot be reached, and on_partition is wait"
        doubted = service.name in self.doubted
        return f"{service.host} was not heard since, and on_partition is wait" if doubted else ""

    def host_of(self, node: str) -> str:
        """Return the computer that a node runs on; empty: our own, or not known."""
        if not self.som.hosts:
            return ""
        named = next((each.host for each in self.som if each.node == node and each.host), "")
        return self.processes.host(node) or self.computers.name(named)

    def on(self, host: str) -> Iterator[Service]:
        """Return the services whose nodes run on another computer."""
        return (each for each in self.som if host and self.computers.name(each.host) == host)

    def lost(self, host: str) -> str:
        """Return why a computer of the SOM is lost; empty: it is not."""
        return self.computers.lost(self.computers.name(host))

    def heard(self, service: Service) -> bool:
        """Tell that the computer of a service is heard."""
        return self.computers.reachable(self.computers.name(service.host))

    def parted(self, service: Service, host: str) -> bool:
        """Tell that a cut may part the substitute on `host` from us, or from the original."""
        return bool(host or (service.host and self.computers.name(service.host)))

    def by_link(self, service: Service, kind: Kind) -> bool:
        """Tell that a failure of the service's node may be one of its link."""
        return kind in BY_LINK and bool(self.host_of(service.node))

    def place(self, service: Service, plan: AnyPlan) -> Place:
        """Return the computer for a plan; rather where an idle process is. Raises ShsaError."""
        ready = self.processes.pool.plans.get(service.name)
        if ready is None or not self.som.hosts:
            return self.placement.place(self.time, service, plan)
        idle = self.processes.pool.hosts()
        return self.placement.place(self.time, service, plan, ready.host, idle)

    def stand_by(self, service: Service, plan: Optional[Plan]) -> None:
        """Let idle processes prepare for a warm service where its plan is placed."""
        if plan is not None:
            host = self.placement.stands_by(self.time, service, plan)
        else:
            known = self.processes.pool.plans.get(service.name)
            host = known.host if known and self.computers.reachable(known.host) else ""
        self.processes.stand_by(service, self.planner, plan, host)

    def _placed(self, host: str, since: float) -> List[Cost]:
        """Return what the substitutes cost that were set to work on a computer since a moment."""
        here = {host, self.computers.in_som(host)}
        found = []
        for name in self.processes.working_on(host):
            changed, plan = self.indexes.working[name]
            service = self.som.services.get(name)
            if service is not None and changed > since:
                inputs = plan.inputs if isinstance(plan, Plan) else ()
                found.append(cost([source.service for source in inputs], service, here))
        return found
