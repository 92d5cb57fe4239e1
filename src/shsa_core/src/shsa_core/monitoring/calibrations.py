"""What would substitute each needed service, calibrated by its node while that is healthy.

For each service the best plan is followed, and the best one without each node that this plan
reads: what healing would choose now, and after one more failure. Angles, which wrap, and integrals,
which start at the last good value, are not calibrated; nor are event-driven and latched topics, and
values that have only been whole numbers, which may be states.
"""
from collections import deque
from dataclasses import dataclass, field
from typing import Deque, Dict, FrozenSet, Iterable, List, Optional, Sequence, Tuple

from shsa_core.codegen.generator import Program
from shsa_core.codegen.plans import Plan, plan_service
from shsa_core.codegen.prediction import Predictor, predictor
from shsa_core.codegen.program import Step, compile_program
from shsa_core.errors import ShsaError
from shsa_core.language.memory import MAX_GAP_S
from shsa_core.model.calibration import UNCALIBRATED, Calibration
from shsa_core.model.field import is_angle
from shsa_core.model.ontology import Ontology
from shsa_core.model.service import Deadlines, Service, Source
from shsa_core.model.som import Som
from shsa_core.monitoring.calibration import SAMPLE_S, Calibrator
from shsa_core.monitoring.events import CalibrationRow, CalibrationsChanged, Command
from shsa_core.search.derivation import SourceTable

PLANS = 3
"""At most of one service: the best, and those for a second failure."""
REPLAN_S = 5.0
"""Between two looks at which services are there."""
SEARCH_S = 0.5
"""Between two searches for a plan: on a robot of 500 services one takes 50 ms."""
EVALUATIONS_PER_S = 2000.0
"""Of all programs together: what is beyond that is not followed."""
LOOK_S = 1.0
"""Between two looks at what one program has learned."""
LOOKS_PER_S = 100.0
"""Of all programs together."""
TOLD_SHARE = 0.1
"""A calibration is told anew if it moves its values by this share of their rms error."""
GAP_PERIODS = 5.0
UNITS_OF_ANGLES = ("rad", "radian", "radians", "mrad", "deg", "degree", "degrees", "°")

Key = Tuple[str, Program]
"""A service and a program that would substitute it."""
Value = Tuple[str, Optional[float]]


@dataclass
class _Followed:
    """A program, and the calibrators of its outputs: property and calibrator, None: as it is.

    `told`: the calibrations as they were told last; `looked`: when they were looked at.
    """

    key: Key
    inputs: Tuple[Source, ...]
    step: Step
    outputs: Tuple[Tuple[str, Optional[Calibrator]], ...]
    remembers: bool
    rate: float
    told: Tuple[Calibration, ...] = ()
    looked: float = 0.0

    def due(self, time: float) -> bool:
        """Whether it is to be evaluated."""
        return self.remembers or any(each.due(time) for _, each in self.outputs if each)

    def doubt(self) -> None:
        """What was heard last teaches nothing."""
        for _, each in self.outputs:
            if each is not None:
                each.doubt()

    def take(self, time: float, measured: Dict[str, float], known: Sequence[float]) -> None:
        """Evaluate it, and learn from what was measured at the same time."""
        derived = self.step(known, time)
        for (name, calibrator), value in zip(self.outputs, derived or ()):
            if calibrator is not None and name in measured:
                calibrator.take(time, measured[name], value)

    def snapshot(self) -> Tuple[Calibration, ...]:
        """The calibration of each output."""
        return tuple(each.snapshot() if each else UNCALIBRATED for _, each in self.outputs)


@dataclass
class _Wanted:
    """A plan to be searched: for a service, without what is excluded; `first`: its best one."""

    service: Service
    excluded: Tuple[str, ...]
    first: bool = True


@dataclass
class _Plans:
    """The programs that are followed for one service; those of before may come back."""

    now: List[_Followed] = field(default_factory=list)
    all: Dict[Program, _Followed] = field(default_factory=dict)


class Calibrations:
    """The calibrations of the services of a SOM; without an ontology there are none."""

    def __init__(self, ontology: Optional[Ontology], deadlines: Deadlines) -> None:
        self._ontology, self._deadlines = ontology, deadlines
        self._som = Som()
        self._plans: Dict[str, _Plans] = {}
        self._values: Dict[Tuple[str, str], Tuple[float, float]] = {}
        self._heard: Dict[str, float] = {}
        self._planned: FrozenSet[str] = frozenset()
        self._table: Optional[SourceTable] = None
        self._predictor: Optional[Predictor] = None
        self._wanted: Deque[_Wanted] = deque()
        self._replan_at = self._search_at = self._ticked = float("-inf")
        self._turn: Deque[_Followed] = deque()
        self._rate = 0.0
        self._changed: Dict[Key, Optional[CalibrationRow]] = {}

    def watch(self, som: Som) -> None:
        """The services are those of `som` now; a service that has changed begins anew."""
        before, self._som = self._som, som
        if self._ontology is not None:
            self._predictor = predictor(self._ontology, som.sources)
        for name in before.services:
            if before.services[name] != som.services.get(name):
                self._forget(name)
        self._planned = frozenset()
        self._replan_at = float("-inf")

    def take(self, service: Service, values: Iterable[Value], time: float, trusted: bool) -> None:
        """What the node of a service says; `trusted`: nothing is held against it."""
        if self._ontology is None:
            return
        name = service.name
        plans = self._plans.get(name)
        if not trusted:
            self._heard.pop(name, None)
            for each in plans.now if plans else ():
                each.doubt()
            return
        self._heard[name] = time
        measured = {key: value for key, value in values if value is not None}
        for key, value in measured.items():
            self._values[name, key] = time, value
        for each in plans.now if plans else ():
            if each.due(time):
                known = [self._value(source, time) for source in each.inputs]
                if None in known:
                    each.doubt()
                else:
                    each.take(time, measured, [value for value in known if value is not None])

    def _value(self, source: Source, time: float) -> Optional[float]:
        """The newest value of a source that is healthy; None if it is stale."""
        found = self._values.get((source.service.name, source.property))
        if found is None or source.service.name not in self._heard:
            return None
        deadline = self._deadlines.of(source.service)
        return None if deadline is not None and time - found[0] > deadline else found[1]

    def tick(self, time: float) -> None:
        """Search a plan that is wanted, and look at what was learned, as far as time allows."""
        if self._ontology is None:
            return
        if time >= self._replan_at:
            self._replan_at = time + REPLAN_S
            self._look_around(time)
        if self._wanted and time >= self._search_at:
            self._search_at = time + SEARCH_S
            self._search(self._wanted.popleft())
        passed, self._ticked = time - self._ticked, time
        for _ in range(1 + int(min(passed, LOOK_S) * LOOKS_PER_S)):
            if not self._turn or time - self._turn[0].looked < LOOK_S:
                break
            self._look(self._turn[0], time)
            self._turn.rotate(-1)

    def changed(self, time: float) -> List[Command]:
        """The calibrations that have changed since this was called last."""
        if not self._changed:
            return []
        changed, self._changed = self._changed, {}
        rows = tuple(row for row in changed.values() if row is not None)
        removed = tuple(key for key, row in changed.items() if row is None)
        return [CalibrationsChanged(time, rows, removed)]

    # Which programs

    def _look_around(self, time: float) -> None:
        """Plan anew if other services are there than before."""
        assert self._ontology is not None
        there = frozenset(service.name for service in self._som if self._is_there(service, time))
        if there == self._planned:
            return
        self._planned = there
        known = self._ontology.properties
        sources = [s for name in sorted(there) for s in self._som.services[name].readable]
        usable = (source for source in sources if source.property in known)
        self._table = SourceTable(self._ontology.network, usable)
        self._wanted = deque(
            _Wanted(service, (service.node,))
            for service in self._som.needed()
            if service.name in there and any(map(self._calibrates, service.sources))
        )

    def _is_there(self, service: Service, time: float) -> bool:
        heard = self._heard.get(service.name)
        deadline = self._deadlines.of(service)
        return heard is not None and (deadline is None or time - heard <= deadline + REPLAN_S)

    def _calibrates(self, source: Source) -> bool:
        """Whether gain and offset mean something for a value."""
        assert self._ontology is not None
        service, known = source.service, self._ontology.properties.get(source.property)
        steady = not (service.event_driven or service.latched)
        if known is None or not steady or not source.provision.calibrate:
            return False
        return known.unit.strip() not in UNITS_OF_ANGLES and not is_angle(source.provision.field)

    def _search(self, wanted: _Wanted) -> None:
        assert self._ontology is not None and self._table is not None
        service = wanted.service
        plans = self._plans.setdefault(service.name, _Plans())
        if wanted.first:
            self._leave(plans.now)
            plans.now = []
        try:
            plan = plan_service(
                self._ontology,
                service,
                self._table,
                wanted.excluded,
                predictor=self._predictor,
            )
            self._follow(plans, plan)
        except ShsaError:
            return  # nothing would take its place
        if wanted.first:
            nodes = dict.fromkeys(source.node for source in plan.inputs)
            more = [_Wanted(service, (*wanted.excluded, node), False) for node in nodes]
            self._wanted.extend(more)

    def _follow(self, plans: _Plans, plan: Plan) -> None:
        """Follow a plan from now on, unless there are enough. Raises ShsaError."""
        found = plans.all.get(plan.program) or self._made(plan)
        followed = [each.key for each in plans.now]
        rate = self._rate + found.rate
        if found.key in followed or len(followed) == PLANS or rate > EVALUATIONS_PER_S:
            return
        if not any(calibrator for _, calibrator in found.outputs):
            return
        plans.now.append(found)
        plans.all.pop(plan.program, None)
        plans.all[plan.program] = found
        self._turn.appendleft(found)
        self._rate = rate
        for program in list(plans.all)[: -2 * PLANS]:
            del plans.all[program]
            self._changed[plan.service, program] = None

    def _leave(self, followed: Iterable[_Followed]) -> None:
        for each in followed:
            each.doubt()
            self._turn.remove(each)
            self._rate -= each.rate

    def _forget(self, name: str) -> None:
        plans = self._plans.pop(name, None)
        if plans is not None:
            self._leave(plans.now)
            self._changed.update({(name, program): None for program in plans.all})
        self._heard.pop(name, None)

    def _made(self, plan: Plan) -> _Followed:
        period = plan.outputs[0].service.period or 0.0
        gap = max(MAX_GAP_S, GAP_PERIODS * period)
        n_inputs, n_outputs = len(plan.inputs), len(plan.outputs)
        program = compile_program(plan.program.code, n_inputs, n_outputs, gap)
        outputs: List[Tuple[str, Optional[Calibrator]]] = []
        for source, stated, sum_ in zip(plan.outputs, plan.errors, program.integrals):
            learns = self._calibrates(source) and sum_ is None and not program.hidden
            calibrator = Calibrator(stated.rms if stated else None) if learns else None
            outputs.append((source.property, calibrator))
        each = period if program.remembers else max(period, SAMPLE_S)
        rate = 1.0 / each if each else EVALUATIONS_PER_S
        key = plan.service, plan.program
        return _Followed(key, plan.inputs, program.step, tuple(outputs), program.remembers, rate)

    # What is told

    def _look(self, followed: _Followed, time: float) -> None:
        followed.looked = time
        now = followed.snapshot()
        if all(each.error is None for each in now):
            return
        if len(now) == len(followed.told) and not any(map(_moved, followed.told, now)):
            return
        followed.told = now
        self._changed[followed.key] = CalibrationRow(*followed.key, now)


def _moved(before: Calibration, now: Calibration) -> bool:
    """Whether a calibration is worth being told anew."""
    if before.error is None or now.error is None:
        return now != before
    rms = now.error.rms
    at_bias = abs(now.offset - before.offset)
    return (
        abs(now.gain - before.gain) > TOLD_SHARE**2
        or at_bias > TOLD_SHARE * rms
        or abs(rms - before.error.rms) > TOLD_SHARE * rms
    )
