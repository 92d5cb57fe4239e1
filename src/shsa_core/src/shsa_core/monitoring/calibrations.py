"""Calibrates what would substitute each needed service, by its node while that is healthy.

For each service the best plan is followed, and the best one without each node that this plan
reads: what healing would choose now, and after one more failure. A better one that reads what is
computed from the service watches the others. Of the angles of a quaternion the offset is learned,
as their zeros differ; other angles, which wrap nobody knows where, are not calibrated, nor are
integrals, which start at the last good value, event-driven and latched topics, and values that have
only been whole numbers, which may be states.
"""
from collections import deque
from dataclasses import dataclass
from math import inf
from typing import Callable, Collection, Deque, Dict, FrozenSet, Iterable, List, Optional, Tuple

from shsa_core.codegen.plans import plan_service, plan_witness
from shsa_core.codegen.prediction import Predictor
from shsa_core.errors import ShsaError
from shsa_core.model.calibration import UNCALIBRATED, Calibration
from shsa_core.model.field import is_angle
from shsa_core.model.ontology import Ontology
from shsa_core.model.service import Service, Source
from shsa_core.model.som import Som
from shsa_core.model.substitution import Program
from shsa_core.monitoring import settings
from shsa_core.monitoring.derivations import Derivations, FollowedPlan, Output
from shsa_core.monitoring.events import CalibrationRow, CalibrationsChanged, Command, Told
from shsa_core.search.derivation import SourceTable

UNITS_OF_ANGLES = ("rad", "radian", "radians", "mrad", "deg", "degree", "degrees", "°")


@dataclass
class _Wanted:
    """A plan to be searched for a service, without what is excluded; `first`: its best one.

    `watches`: it replaces nobody, and may read what is computed from the service.
    """

    service: Service
    excluded: Tuple[str, ...]
    first: bool = True
    watches: bool = False


class Calibrations:
    """Follows plans for the services of a SOM, and tells how they are calibrated. Times in s."""

    def __init__(self, ontology: Ontology, derivations: Derivations) -> None:
        self._ontology, self._derivations = ontology, derivations
        self._som = Som()
        self._predictor: Optional[Predictor] = None
        self._plans: Dict[str, Dict[Program, FollowedPlan]] = {}  # the newest last
        self._planned: FrozenSet[str] = frozenset()
        self._table: Optional[SourceTable] = None
        self._wanted: Deque[_Wanted] = deque()
        self._replan_at = self._search_at = -inf
        self._kept: List[Source] = []  # of these it was said
        self._said: List[str] = []
        self._changed: Dict[Tuple[str, Program], Optional[CalibrationRow]] = {}

    def watch(self, som: Som, predictor: Optional[Predictor], changed: Iterable[str]) -> None:
        """Follow plans for the services of `som`; those that have `changed` begin anew."""
        self._som, self._predictor = som, predictor
        for name in changed:
            self._changed.update({(name, each): None for each in self._plans.pop(name, {})})
        self._planned, self._replan_at = frozenset(), -inf
        self._wanted.clear()

    def tick(self, time: float, there: Callable[[], Collection[str]]) -> None:
        """Look at what was learned, and search a plan; `there` returns the services that are."""
        for followed in self._derivations.refreshed():
            if followed.substitutes:
                self._tell(followed)
                self._say(followed)
        if time >= self._replan_at:
            self._replan_at = time + settings.REFRESH_S
            self._plan_with(frozenset(there()))
        if self._wanted and time >= self._search_at:
            self._search_at = time + settings.SEARCH_S
            self._search(self._wanted.popleft())

    def changed(self, time: float) -> List[Command]:
        """Return the calibrations that have changed since this was called last."""
        said: List[Command] = []
        while self._said:
            said.append(Told(time, f"{self._said.pop()}: its calibration stays as it was"))
        if not self._changed:
            return said
        changed, self._changed = self._changed, {}
        rows = tuple(row for row in changed.values() if row is not None)
        removed = tuple(key for key, row in changed.items() if row is None)
        return [*said, CalibrationsChanged(time, rows, removed)]

    def _plan_with(self, there: FrozenSet[str]) -> None:
        if there == self._planned:
            return
        self._planned = there
        known = self._ontology.properties
        sources = [s for name in sorted(there) for s in self._som.services[name].readable]
        usable = (source for source in sources if source.property in known)
        self._table = SourceTable(self._ontology.network, usable)
        self._wanted = deque(
            _Wanted(service, (service.node,))
            for service in self._som
            if service.needed is not False
            and service.name in there
            and any(map(self._calibrates, service.sources))
        )

    def _calibrates(self, source: Source) -> bool:
        """Tell if gain and offset mean something for a value."""
        service, known = source.service, self._ontology.properties.get(source.property)
        steady = not (service.event_driven or service.latched)
        if known is None or not steady or not source.provision.calibrate:
            return False
        return is_angle(source.provision.field) or known.unit.strip() not in UNITS_OF_ANGLES

    def _is_told(self, output: Output) -> bool:
        return self._calibrates(output.source) and not output.integrates

    def _search(self, wanted: _Wanted) -> None:
        assert self._table is not None
        service, plans = wanted.service, self._plans.setdefault(wanted.service.name, {})
        for followed in plans.values() if wanted.first else ():
            if followed.substitutes:
                self._derivations.leave(followed)
        question = self._ontology, service, self._table, wanted.excluded
        try:
            if wanted.watches:
                plan = plan_witness(*question, self._predictor)
            else:
                plan = plan_service(*question, predictor=self._predictor)
            followed = plans.get(plan.program) or self._derivations.made(plan)
        except ShsaError:
            return  # nothing would take its place
        self._follow(plans, followed)
        if wanted.first:
            nodes = dict.fromkeys(source.node for source in plan.inputs)
            without = [(*wanted.excluded, node) for node in nodes]
            more = [_Wanted(service, each, False, w) for each in without for w in (False, True)]
            self._wanted.extend(more)

    def _follow(self, plans: Dict[Program, FollowedPlan], followed: FollowedPlan) -> None:
        """Follow a plan from now on, unless there are enough, or it teaches nothing."""
        now = [each for all_ in self._plans.values() for each in all_.values() if each.substitutes]
        enough = sum(each.substitutes for each in plans.values()) == settings.PLANS
        rate = sum(each.rate for each in now) + followed.rate
        told = list(filter(self._is_told, followed.outputs))
        if followed.substitutes or enough or rate > settings.EVALUATIONS_PER_S or not told:
            return
        for output in told:
            output.calibrate()
        followed.substitutes = True
        self._derivations.follow(followed)
        plans.pop(followed.program, None)
        plans[followed.program] = followed
        for program in list(plans)[: -2 * settings.PLANS]:
            del plans[program]
            self._changed[followed.service, program] = None

    def _say(self, followed: FollowedPlan) -> None:
        """Say once of a value that its calibrations do not follow the sensor."""
        for output in followed.outputs:
            own, source = output.calibrator, output.source
            if own is not None and own.keeps and source not in self._kept:
                self._kept.append(source)
                what = f"{source.property} and what is derived of it part by {own.pull:.3g}"
                self._said.append(f"{source.topic}: {what}")

    def _tell(self, followed: FollowedPlan) -> None:
        now = tuple(
            each.calibration if self._is_told(each) else UNCALIBRATED for each in followed.outputs
        )
        if all(each.error is None for each in now):
            return
        if not followed.told or any(map(_moved, followed.told, now)):
            followed.told = now
            row = CalibrationRow(followed.service, followed.program, now)
            self._changed[followed.service, followed.program] = row


def _moved(before: Calibration, now: Calibration) -> bool:
    """Tell if a calibration is worth being told anew."""
    if before.error is None or now.error is None:
        return now != before
    share, rms = settings.TOLD_SHARE, now.error.rms
    return (
        abs(now.gain - before.gain) > share**2
        or abs(now.offset - before.offset) > share * rms
        or abs(rms - before.error.rms) > share * rms
    )
