"""What could take a service over now: questions that change nothing."""
from dataclasses import replace
from typing import Collection, List, Optional, Tuple, Union

from shsa_core.codegen.generator import Program
from shsa_core.codegen.prediction import Predictor, predictor
from shsa_core.codegen.plans import Plan, SafeValues, plan_service, safe_values
from shsa_core.errors import ShsaError
from shsa_core.healing.availability import Availability
from shsa_core.healing.calibrations import Calibrated, Calibrations
from shsa_core.healing.kills import Kills
from shsa_core.healing.nodes import Nodes
from shsa_core.healing.plan_table import PlanTable
from shsa_core.healing.settings import Settings
from shsa_core.model.error import Error
from shsa_core.model.ontology import Ontology
from shsa_core.model.service import Service, Signal, Source
from shsa_core.model.som import Som
from shsa_core.model.substitution import Substitution

AnyPlan = Union[Plan, SafeValues]
RECALLED = 20
"""A plan that is not among so many of the best is not known again."""


class Planner:
    """Answers from the plans that were made ahead, or by a search."""

    def __init__(
        self,
        ontology: Ontology,
        som: Som,
        settings: Settings,
        nodes: Nodes,
        availability: Availability,
        kills: Kills,
        calibrations: Calibrations,
    ) -> None:
        self.ontology = ontology
        self.som = som
        self.calibrations = calibrations
        self.plans = PlanTable(ontology, som.needed(), settings.method, lambda: self.predictor)
        self._settings = settings
        self._nodes = nodes
        self._availability = availability
        self._kills = kills
        self._predictor: Optional[Predictor] = None
        self._predicts_for: Optional[Som] = None
        self._answered: Tuple[object, ...] = (None,) * 3
        self._answer: Tuple[Signal, ...] = ()

    @property
    def predictor(self) -> Optional[Predictor]:
        """Who predicts errors by the models as they are now; None if no errors are known."""
        if self._predicts_for is not self.som:
            self._predicts_for = self.som
            self._predictor = predictor(self.ontology, self.som.sources)
        return self._predictor

    def plan(self, service: Service, tried: Collection[Plan], faulty: str) -> Plan:
        """The best plan for a service whose node `faulty` has failed, other than those tried.

        Raises ShsaError.
        """
        return self._without(service, self._nodes.excluded | self._kills.nodes | {faulty}, tried)

    def recall(self, service: Service, row: Substitution) -> Optional[AnyPlan]:
        """The plan that a row of the table carries out, by the models as they are now.

        None: it is none of the best, or none at all.
        """
        inputs, outputs = ([each.path for each in signals] for signals in (row.inputs, row.outputs))
        program = Program(tuple(inputs), row.code, tuple(outputs))
        safe = safe_values(service)
        if safe is not None and safe.program == program:
            return safe
        tried: List[Plan] = []
        while len(tried) < RECALLED:
            try:
                plan = self._without(service, (), tried)
            except ShsaError:
                return None
            if plan.program == program:
                return plan
            tried.append(plan)
        return None

    def replaceable(
        self, service: Service, excluded: Collection[str], tried: Collection[Plan] = ()
    ) -> bool:
        """Whether a substitute could take a service over without some nodes."""
        if not service.policy.substitutes or self.plans.hopeless(service.name, excluded):
            return False
        try:
            self._without(service, excluded, tried)
        except ShsaError:
            return False
        return True

    def _without(
        self, service: Service, excluded: Collection[str], tried: Collection[Plan]
    ) -> Plan:
        ready = self.plans.plan(service.name)
        if ready is not None and ready not in tried and self.usable(ready, excluded):
            return ready
        return self._search(service, excluded, self._settings.method, tried)

    def ahead(self, service: Service) -> Plan:
        """The best plan for the case that the node of a service fails. Raises ShsaError."""
        return self.plans.plan(service.name) or self.explain(service)

    def explain(self, service: Service, without: Collection[str] = (), method: str = "") -> Plan:
        """The same, also without some services, nodes and topics, by a search. Raises ShsaError."""
        publishers = {row.publisher for row in self._availability.originals(self.som, service)}
        excluded = {service.node, *publishers, *self._nodes.excluded, *without}
        method = method or self._settings.method
        return self._search(service, excluded, method)

    def _search(
        self,
        service: Service,
        excluded: Collection[str],
        method: str,
        tried: Collection[Plan] = (),
    ) -> Plan:
        sources = self.plans.sources
        return plan_service(
            self.ontology, service, sources, excluded, method, tried, self.predictor
        )

    def usable(self, plan: Plan, excluded: Collection[str] = ()) -> bool:
        """Whether all that a plan reads is available, from the nodes that it was made for."""
        services = self._availability.services
        return all(
            source.service.name in services
            and set(excluded).isdisjoint(services[source.service.name].causes)
            for source in plan.inputs
        )

    def unavailable(self, service: str) -> Tuple[str, ...]:
        """The services other than `service` that nothing can be derived from now, in order."""
        return tuple(sorted(self._availability.unavailable - {service}))

    def inputs(self, plan: AnyPlan) -> Tuple[Signal, ...]:
        """What the program of a plan reads."""
        return self._signals(plan.inputs) if isinstance(plan, Plan) else ()

    def outputs(self, plan: AnyPlan) -> Tuple[Signal, ...]:
        """What the program of a plan gives; a takeover asks it of one plan several times."""
        known = self.calibrations.of(plan.service, plan.program)
        asked = (plan, self.som, known)
        if any(each is not former for each, former in zip(asked, self._answered)):
            self._answered, self._answer = asked, self._outputs(plan, known)
        return self._answer

    def _outputs(self, plan: AnyPlan, known: Calibrated) -> Tuple[Signal, ...]:
        signals = self._signals(plan.outputs, written=True)
        if not isinstance(plan, Plan):
            return signals
        found = (replace(signal, error=error) for signal, error in zip(signals, plan.errors))
        return self._calibrated(plan, tuple(found), known)

    def errors(self, plan: AnyPlan) -> Tuple[Optional[Error], ...]:
        """The errors that are expected of what a plan gives: those of its outputs."""
        return tuple(signal.error for signal in self.outputs(plan))

    @staticmethod
    def _calibrated(
        plan: Plan, signals: Tuple[Signal, ...], known: Calibrated
    ) -> Tuple[Signal, ...]:
        """What a plan gives, with gain, offset and error as the living sensor has shown."""
        found = list(signals)
        for i, (source, calibration) in enumerate(zip(plan.outputs, known)):
            if source.provision.calibrate:
                gain, offset, error = calibration.gain, calibration.offset, calibration.error
                shown = error if error is not None and error.rms > 0.0 else signals[i].error
                found[i] = replace(signals[i], gain=gain, offset=offset, error=shown)
        return tuple(found)

    def _signals(self, sources: Tuple[Source, ...], written: bool = False) -> Tuple[Signal, ...]:
        """As the SOM says now: a period may have changed since the plan was made."""
        return tuple(self._signal(source, written) for source in sources)

    def _signal(self, source: Source, written: bool) -> Signal:
        deadlines = self._settings.deadlines
        current = self.som.services.get(source.service.name)
        if current is None:  # what the SOM has no more does not follow who else is on its topic
            return replace(self.som.signal(source, deadlines, written), node=source.node)
        return self.som.signal(Source(current, source.provision), deadlines, written)
