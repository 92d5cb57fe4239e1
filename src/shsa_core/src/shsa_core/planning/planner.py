"""Answers what could take a service over now; no question changes anything."""
from contextlib import suppress
from dataclasses import replace
from itertools import repeat
from typing import Any, Collection, Dict, Iterator, List, Mapping, Optional, Sequence, Set, Tuple

from shsa_core.codegen.generator import fusions_of, ways_of
from shsa_core.codegen.plans import Plan, errs_too_much, plan_service, safe_values
from shsa_core.codegen.prediction import Predictor, predictor
from shsa_core.errors import NoSubstitute, ShsaError
from shsa_core.model.calibration import UNCALIBRATED, Calibration, CalibrationRow
from shsa_core.model.error import Error
from shsa_core.model.ontology import Ontology
from shsa_core.model.service import Deadlines, Service, Signal, Source
from shsa_core.model.som import Som
from shsa_core.model.substitution import Program, Substitution
from shsa_core.planning.plan_table import PlanTable
from shsa_core.planning.settings import CHANGED, ENOUGH, RECALLED, STEPS

Calibrated = Tuple[Calibration, ...]


class Calibrations:
    """The newest calibration of every program that may substitute a service.

    While a service is being healed they stay as they were at the failure, but for their errors.
    `measured`: what derivations of a service's values have erred by, by their `way`. `replan`: the
    services for which another plan may be best by that now.
    """

    def __init__(self) -> None:
        self.replan: Set[str] = set()
        self.measured: Dict[str, Dict[str, Error]] = {}
        self._known: Dict[str, Dict[Program, Calibrated]] = {}
        self._later: Dict[str, Dict[Program, Calibrated]] = {}

    def of(self, service: str, program: Program) -> Calibrated:
        """Return the calibration of each output of a program; empty: none is known.

        If it is not followed itself, those are taken that do the same in other programs.
        """
        known = self._known.get(service, {})
        if program in known:
            return known[program]
        pairs = (pair for each, found in known.items() for pair in zip(ways_of(each), found))
        by_way, ways = dict(pairs), ways_of(program)
        found = tuple(by_way.get(way, UNCALIBRATED) for way in ways)
        return found if any(way in by_way for way in ways) else ()

    def add(self, row: CalibrationRow, healing: bool) -> bool:
        """Note what the monitor tells; `healing`: of a service that is healed. True: it counts."""
        known, counts = self.of(row.service, row.program), row.calibrations
        if len(counts) != len(row.program.outputs):
            return False
        if _samples(counts) < min(ENOUGH, _samples(known)):
            return False
        self._measure(row, 0 if healing else ENOUGH)
        if healing:
            self._later.setdefault(row.service, {})[row.program] = counts
            pairs = zip(known, counts)
            counts = tuple(replace(one, error=told.error) for one, told in pairs)
        self._known.setdefault(row.service, {})[row.program] = counts
        return not healing or counts != known

    def _measure(self, row: CalibrationRow, enough: int) -> None:
        """Note what is measured, where it changes much: plans are not to change all the time."""
        measured = self.measured.setdefault(row.service, {})
        for way, error in zip(ways_of(row.program), (each.error for each in row.calibrations)):
            if error is None or (error.n or 0) < enough:
                continue
            former = measured.get(way)
            if former is None or abs(error.rms - former.rms) > CHANGED * former.rms:
                measured[way] = error
                self.replan.add(row.service)

    def programs(self, service: str) -> Tuple[Program, ...]:
        """Return the programs of a service that are calibrated."""
        return tuple(self._known.get(service, ()))

    def knowing(self, service: str, predictor: Predictor) -> Predictor:
        """Return a predictor with what was measured of a service: errors, and proven fusions."""
        fusions = [each for program in self.programs(service) for each in fusions_of(program)]
        return predictor.knowing(self.measured.get(service, {}), fusions)

    def leave(self, service: str, program: Program) -> None:
        """The monitor follows a program no more."""
        self._known.get(service, {}).pop(program, None)
        for way in ways_of(program):
            self.measured.get(service, {}).pop(way, None)
        if fusions_of(program):
            self.replan.add(service)

    def recall(self, service: str, program: Program, outputs: Sequence[Signal]) -> None:
        """Note how a former reconfigurator has calibrated a program."""
        found = tuple(Calibration(each.gain, each.offset, each.error) for each in outputs)
        self._known.setdefault(service, {})[program] = found

    def healed(self, service: str) -> None:
        """Let count what was told while the service was healed."""
        self._known.setdefault(service, {}).update(self._later.pop(service, {}))

    def forget(self, service: str) -> None:
        """There is no such service any more."""
        self._known.pop(service, None)
        self._later.pop(service, None)
        self.measured.pop(service, None)


def _clearly_less(found: Calibrated, than: Calibrated) -> bool:
    """Tell that no value errs more, and one clearly less, by what the monitor tells."""
    errors = [(one.error, other.error) for one, other in zip(found, than)]
    known = [(one.rms, other.rms) for one, other in errors if one and other]
    less = any(one < (1.0 - CHANGED) * other for one, other in known)
    return less and len(known) == len(than) and all(one <= other for one, other in known)


def _samples(calibrations: Calibrated) -> int:
    """Return how much is known at least of what is calibrated."""
    errors = (each.error for each in calibrations if each != UNCALIBRATED)
    return min((error.n or 0 for error in errors if error is not None), default=0)


class Planner:
    """Answers from the plans that were made ahead, or by a search.

    `available`: the services that can be read now, each with the node that publishes it.
    """

    def __init__(
        self,
        ontology: Ontology,
        som: Som,
        available: Mapping[str, Service],
        method: str,
        deadlines: Deadlines,
    ) -> None:
        self.calibrations = Calibrations()
        self._method, self._deadlines, self._available = method, deadlines, available
        self._predictor: Optional[Predictor] = None
        self._predicts_for: Optional[Som] = None
        self.load(ontology, som)

    def load(self, ontology: Ontology, som: Som) -> None:
        """Plan by these models from now on."""
        self.ontology, self.som, self._predicts_for = ontology, som, None
        self.plans = PlanTable(ontology, som.needed(), self.explain)
        self.plans.change((), self._available.values())

    @property
    def predictor(self) -> Optional[Predictor]:
        """Return who predicts errors by the models as they are now; None: no errors are known."""
        if self._predicts_for is not self.som:
            self._predicts_for = self.som
            self._predictor = predictor(self.ontology, self.som.sources)
        return self._predictor

    def predictor_of(self, service: str) -> Optional[Predictor]:
        """Return who predicts errors of a service's values: those that were measured come first."""
        found = self.predictor
        return found and self.calibrations.knowing(service, found)

    def replan(self) -> None:
        """Plan ahead anew where another plan may be best by what was measured."""
        while self.calibrations.replan:
            self.plans.drop(self.calibrations.replan.pop())

    def recall(self, service: Service, row: Substitution) -> Optional[Plan]:
        """Return the plan that a row carries out; None: it is none of the best ones now."""
        program = program_of(row)
        safe = safe_values(service)
        if safe is not None and safe.program == program:
            return safe
        tried: List[Plan] = []
        with suppress(ShsaError):
            while len(tried) < RECALLED:
                plan = self.plan(service, (), tried)
                if plan.program == program:
                    return plan
                tried.append(plan)
        return None

    def replaceable(
        self, service: Service, excluded: Collection[str], tried: Collection[Plan] = ()
    ) -> bool:
        """Tell that a substitute could take all of a service over without some nodes."""
        if service.policy.substitutes and not self.plans.hopeless(service.name, excluded):
            with suppress(ShsaError):
                return not self.plan(service, excluded, tried).left_out
        return False

    def plan(self, service: Service, excluded: Collection[str], tried: Collection[Plan]) -> Plan:
        """Return the best plan without some nodes, but for those tried. Raises ShsaError."""
        ready = self.plans.plan(service.name)
        plan = ready if ready not in tried and ready and self.usable(ready, excluded) else None
        if plan is None:
            question = self.ontology, service, self.plans.sources, excluded, self._method, tried
            plan = plan_service(*question, self.predictor_of(service.name), STEPS)
        why = self.errs_too_much(plan)
        if not why:
            return plan
        with suppress(NoSubstitute):
            return self.plan(service, excluded, {*tried, plan})
        raise NoSubstitute(service.properties, (), refused=why)

    def explain(self, service: Service, excluded: Collection[str], method: str = "") -> Plan:
        """Search it, without some services, nodes and topics. Raises ShsaError."""
        question = self.ontology, service, self.plans.sources, excluded, method or self._method
        return plan_service(*question, predictor=self.predictor_of(service.name))

    def usable(self, plan: Plan, excluded: Collection[str] = ()) -> bool:
        """Tell that all that a plan reads is available, from the nodes that it was made for."""
        read, excluded = [self._available.get(e.service.name) for e in plan.inputs], set(excluded)
        return all(each is not None and excluded.isdisjoint(each.causes) for each in read)

    def row(self, service: Service, plan: Optional[Plan], **more: Any) -> Substitution:
        """Return a row of the table of substitutions; `plan`: what is followed, as far as known."""
        more.update(service=service.name, others=service.others)
        if plan is None:
            outputs = self.signals(service.sources, written=True)
            return Substitution(inputs=(), code="", outputs=outputs, **more)
        more.update(
            relations=plan.relations, quality=plan.quality, inputs=self.signals(plan.inputs)
        )
        return Substitution(code=plan.program.code, outputs=self.outputs(plan), **more)

    def shown(self, plan: Optional[Plan]) -> Dict[str, object]:
        """Return what an incident shows of the plan that is carried out, or could be."""
        program, computes = plan.program if plan else Program((), "", ()), plan and plan.computes
        outputs = self.outputs(plan) if plan and computes else ()
        return {
            "inputs": program.inputs if computes else (),
            "code": program.code,
            "outputs": program.outputs,
            "relations": plan.relations if plan else (),
            "gains": tuple([each.gain for each in outputs]),
            "offsets": tuple([each.offset for each in outputs]),
            "quality": plan.quality if plan and computes else None,
            "errors": tuple([each.error for each in outputs]),
        }

    def outputs(self, plan: Plan) -> Tuple[Signal, ...]:
        """Return what its program gives, with gain, offset and error as the living sensor shows."""
        signals = self.signals(plan.outputs, written=True)
        pairs = [(signal, vars(seen)) for signal, seen in zip(signals, self._seen(plan))]
        return tuple([replace(signal, **seen) for signal, seen in pairs])

    def errors(self, plan: Plan) -> Tuple[Optional[Error], ...]:
        """Return the errors that are expected of what a plan gives: those of its outputs."""
        return tuple([each.error for each in self._seen(plan)])

    def _seen(self, plan: Plan) -> Iterator[Calibration]:
        """Return the calibration of each output, with its predicted error until one is measured."""
        known = self.calibrations.of(plan.service, plan.program)
        for source, error, seen in zip(plan.outputs, plan.errors, known or repeat(UNCALIBRATED)):
            counts = seen if source.provision.calibrate else UNCALIBRATED
            measured = counts.error is not None and counts.error.rms > 0.0
            yield counts if measured else Calibration(counts.gain, counts.offset, error)

    def errs_too_much(self, plan: Plan) -> str:
        """Return why a plan is not used by what it errs by now, in words; empty: it may be."""
        return errs_too_much(plan, self.errors(plan))

    def errs_more(self, plan: Plan, another: Optional[Plan] = None) -> bool:
        """Tell that a plan errs clearly more by now than another; None: than any calibrated one."""
        known, service, own = self.calibrations, plan.service, plan.program
        others = [another.program] if another else known.programs(service)
        same = [known.of(service, other) for other in others if other.outputs == own.outputs]
        return any(_clearly_less(each, known.of(service, own)) for each in same)

    def signals(self, sources: Tuple[Source, ...], written: bool = False) -> Tuple[Signal, ...]:
        """Return them as the SOM says now: a period may have changed since the plan was made."""
        return tuple(self._signal(source, written) for source in sources)

    def _signal(self, source: Source, written: bool) -> Signal:
        current = self.som.services.get(source.service.name)
        if current is None:  # what the SOM has no more does not follow who else is on its topic
            return replace(self.som.signal(source, self._deadlines, written), node=source.node)
        return self.som.signal(Source(current, source.provision), self._deadlines, written)


def program_of(row: Substitution) -> Program:
    """Return the program that a row of the table of substitutions has."""
    inputs, outputs = ([each.path for each in signals] for signals in (row.inputs, row.outputs))
    return Program(tuple(inputs), row.code, tuple(outputs))
