"""Where everything runs, as far as is known, and where a substitute is to run."""
from typing import Callable, Dict, Iterator, Optional

from shsa_core.codegen.plans import Plan
from shsa_core.healing.concern import Concern
from shsa_core.healing.hosts import Hosts
from shsa_core.healing.placement import Place, Placement
from shsa_core.healing.planner import AnyPlan
from shsa_core.healing.pool import Pool
from shsa_core.healing.strays import Strays
from shsa_core.healing.topic import TopicHealing
from shsa_core.model.cost import Cost, cost
from shsa_core.model.kinds import OnPartition
from shsa_core.model.service import Service
from shsa_core.model.som import Som


class Whereabouts:
    """Nodes are where the SOM says, substitutes where they were started.

    `doubted`: the services whose node is silent, and that wait until its computer is heard, at a
    moment in s or later.
    """

    def __init__(
        self,
        som: Callable[[], Som],
        hosts: Hosts,
        strays: Strays,
        pool: Pool,
        concern: Concern,
        healings: Dict[str, TopicHealing],
    ) -> None:
        self.doubted: Dict[str, float] = {}
        self._som = som
        self._hosts = hosts
        self._strays = strays
        self._pool = pool
        self._concern = concern
        self._healings = healings
        self._placement = Placement(hosts, self._placed, som)

    def host_of(self, node: str) -> str:
        """The computer that a node runs on; empty: the reconfigurator's own, or not known."""
        som = self._som()
        if not som.hosts:
            return ""
        named = next((each.host for each in som if each.node == node and each.host), "")
        return self._strays.host(node) or self._hosts.name(named)

    def on(self, host: str) -> Iterator[Service]:
        """The services whose nodes run on another computer."""
        return (each for each in self._som() if host and self._hosts.name(each.host) == host)

    def lost(self, host: str) -> str:
        """Why a computer of the SOM is lost; empty: it is not."""
        return self._hosts.lost(self._hosts.name(host))

    def waiting(self, service: Service) -> str:
        """Why nothing is done for a service while its computer is cut off; empty: it is not so."""
        if service.on_partition is not OnPartition.WAIT or not service.host:
            return ""
        if self.lost(service.host):
            return f"{service.host} cannot be reached, and on_partition is wait"
        doubted = service.name in self.doubted
        return f"{service.host} was not heard since, and on_partition is wait" if doubted else ""

    def place(self, time: float, service: Service, plan: AnyPlan) -> Place:
        """The computer for a plan; rather where an idle process is. Raises ShsaError."""
        ready = self._pool.plans.get(service.name)
        if ready is None:
            return self._placement.place(time, service, plan)
        return self._placement.place(time, service, plan, ready.host, self._pool.hosts())

    def stands_by(self, time: float, service: Service, plan: Optional[Plan]) -> str:
        """The computer on which idle processes are wanted for a warm service."""
        if plan is None:
            known = self._pool.plans.get(service.name)
            return known.host if known and self._hosts.reachable(known.host) else ""
        return self._placement.stands_by(time, service, plan)

    def allowed(self, service: Service) -> bool:
        """Whether the substitute of a service may be where it is, as the SOM is now."""
        return self._placement.allowed(service, self._healings[service.name].substitute.host)

    def unheard(self, service: Service) -> bool:
        """Whether the computer of a service is not heard."""
        return not self._hosts.reachable(self._hosts.name(service.host))

    def parted(self, service: Service) -> bool:
        """Whether a cut may part the substitute of a service from us, or from the original."""
        healing = self._healings.get(service.name)
        host = "" if healing is None else healing.substitute.host
        return bool(host or (service.host and self._hosts.name(service.host)))

    def working_on(self, host: str) -> Iterator[str]:
        """The services whose substitute runs on a computer."""
        for name in self._concern.substituted:
            if self._healings[name].substitute.host == host:
                yield name

    def _placed(self, host: str, since: float) -> Iterator[Cost]:
        """What the substitutes cost that were set to work on a computer since a moment."""
        here = {host, self._hosts.in_som(host)}
        for name in self.working_on(host):
            process, service = self._healings[name].substitute, self._som().services.get(name)
            if service is not None and process.changed > since:
                inputs = process.plan.inputs if isinstance(process.plan, Plan) else ()
                yield cost([source.service for source in inputs], service, here)
