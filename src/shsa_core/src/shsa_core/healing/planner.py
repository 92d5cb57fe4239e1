"""What could take a service over now: questions that change nothing."""
from typing import Collection, Dict, Optional, Tuple, Union

from shsa_core.codegen.plans import Plan, SafeValues, plan_service, safe_values
from shsa_core.healing.availability import Availability
from shsa_core.healing.nodes import Nodes
from shsa_core.healing.plan_table import PlanTable
from shsa_core.healing.settings import Settings
from shsa_core.model.ontology import Ontology
from shsa_core.model.service import Service, Signal, Source
from shsa_core.model.som import Som

AnyPlan = Union[Plan, SafeValues]


class Planner:
    """Answers from the plans that were made ahead, or by a search."""

    def __init__(
        self,
        ontology: Ontology,
        som: Som,
        settings: Settings,
        nodes: Nodes,
        availability: Availability,
    ) -> None:
        self.ontology = ontology
        self.som = som
        self.plans = PlanTable(ontology, som.needed(), settings.method)
        self._settings = settings
        self._nodes = nodes
        self._availability = availability

    def plan(self, service: Service, tried: Collection[Plan], faulty: str) -> Plan:
        """The best plan for a service whose node `faulty` has failed, other than those tried.

        Raises ShsaError.
        """
        excluded = self._nodes.excluded | {faulty}
        ready = self.plans.plan(service.name)
        if ready is not None and ready not in tried and self.usable(ready, excluded):
            return ready
        return plan_service(
            self.ontology, service, self.plans.sources, excluded, self._settings.method, tried
        )

    def ahead(self, service: Service) -> Plan:
        """The best plan for the case that the node of a service fails. Raises ShsaError."""
        return self.plans.plan(service.name) or self.explain(service)

    def explain(self, service: Service, without: Collection[str] = (), method: str = "") -> Plan:
        """The same, also without some services, nodes and topics, by a search. Raises ShsaError."""
        publishers = {row.publisher for row in self._availability.originals(self.som, service)}
        excluded = {service.node, *publishers, *self._nodes.excluded, *without}
        method = method or self._settings.method
        return plan_service(self.ontology, service, self.plans.sources, excluded, method)

    def usable(self, plan: Plan, excluded: Collection[str] = ()) -> bool:
        """Whether all that a plan reads is available, from the nodes that it was made for."""
        services = self._availability.services
        return all(
            source.service.name in services and services[source.service.name].node not in excluded
            for source in plan.inputs
        )

    def safe_values(self, service: Service) -> Optional[SafeValues]:
        """The plan that publishes the safe values of a service; None if it has none."""
        return safe_values(service)

    def inputs(self, plan: AnyPlan) -> Tuple[Signal, ...]:
        """What the program of a plan reads."""
        return self._signals(plan.inputs) if isinstance(plan, Plan) else ()

    def outputs(self, plan: AnyPlan) -> Tuple[Signal, ...]:
        """What the program of a plan gives."""
        return self._signals(plan.outputs)

    def _signals(self, sources: Tuple[Source, ...]) -> Tuple[Signal, ...]:
        """As the SOM says now: a period may have changed since the plan was made."""
        current: Dict[str, Service] = self.som.services
        return tuple(
            self.som.signal(
                Source(current.get(source.service.name, source.service), source.provision),
                self._settings.deadlines,
            )
            for source in sources
        )
