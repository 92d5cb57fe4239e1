"""Calibrates what would substitute each needed service, by its node while that is healthy.

For each service the best plan is followed, and the best one without each node that this plan
reads: what healing would choose now, and after one more failure. A better one that reads what is
computed from the service watches the others. docs/explanation/errors.md tells what is calibrated.
"""
from collections import deque
from math import inf
from typing import Callable, Deque, FrozenSet, Iterable, Iterator, NamedTuple, Optional, Set
from typing import Tuple, Union

from shsa_core.codegen.plans import plan_service, plan_sources
from shsa_core.codegen.prediction import Predictor
from shsa_core.errors import ShsaError
from shsa_core.model.calibration import CalibrationRow, CalibrationsChanged
from shsa_core.model.field import is_angle
from shsa_core.model.log import Level, Log
from shsa_core.model.ontology import Ontology
from shsa_core.model.service import Service, Source
from shsa_core.model.som import Som
from shsa_core.derivations import settings
from shsa_core.derivations.evaluation import Derivations, FollowedPlan, Output
from shsa_core.derivations.fusions import Fusions
from shsa_core.search.derivation import SourceTable

UNITS_OF_ANGLES = ("rad", "radian", "radians", "mrad", "deg", "degree", "degrees", "°")
Said = Union[CalibrationsChanged, Log]


class _Wanted(NamedTuple):
    """A plan to be searched for a service, without the nodes `excluded`: its own, and others.

    `watches`: it replaces nobody, and may read what is computed from the service.
    """

    service: Service
    excluded: Tuple[str, ...]
    watches: bool = False


class Calibrations:
    """Follows plans for the services of a SOM, and tells how they are calibrated. Times in s.

    `is_there`: the own node of a service is healthy, and has told something. `say`: tell others.
    """

    def __init__(
        self,
        ontology: Ontology,
        derivations: Derivations,
        is_there: Callable[[Service], bool],
        say: Callable[[Iterable[Said]], object],
    ) -> None:
        self._ontology, self._derivations = ontology, derivations
        self._is_there, self._say = is_there, say
        self._som = Som()
        self._predictor: Optional[Predictor] = None
        self._planned: FrozenSet[str] = frozenset()
        self._table = SourceTable(ontology.network)
        self._wanted: Deque[_Wanted] = deque()
        self._replan_at = self._search_at = -inf
        self._kept: Set[Source] = set()  # of these it was said
        self._fusions = Fusions(ontology, derivations)
        self._turn = 0

    def watch(self, som: Som, predictor: Optional[Predictor]) -> None:
        """Follow plans for the services of `som`."""
        self._som, self._predictor = som, predictor
        self._planned, self._replan_at = frozenset(), -inf
        self._wanted.clear()

    def tick(self, time: float) -> None:
        """Look at what was learned, and search a plan."""
        refreshed, gone = self._derivations.news()
        told = [each for each in refreshed if self._speaks_for(each) and self._fusions.tells(each)]
        self._say(log for each in told for log in self._kept_back(each))
        rows = {each.key: _row(each) for each in told if any(map(_has_moved, each.outputs))}
        removed = tuple(each.key for each in gone if each.key not in rows)
        if rows or removed:
            self._say([CalibrationsChanged(tuple(rows.values()), removed)])
        if time >= self._replan_at:
            self._replan_at = time + settings.REFRESH_S
            for service in (each for each in self._som if not self._is_there(each)):
                self._derivations.unmeasured(service, time)  # though nobody may speak for it
            self._plan()
            self._fuse(time)
        if self._wanted and time >= self._search_at:
            self._search_at = time + settings.SEARCH_S
            self._search(self._wanted.popleft())

    def _speaks_for(self, followed: FollowedPlan) -> bool:
        """Tell if a plan is the first of those that have its program, and read other nodes."""
        plans = self._derivations.plans(followed.plan.service)
        same = (each for each in plans if each.substitutes and each.key == followed.key)
        return next(same, None) is followed

    def _fuse(self, time: float) -> None:
        """Look at what is fused of one service that is there, one after the other."""
        self._turn += 1
        for name in sorted(self._planned)[self._turn % max(1, len(self._planned)) :][:1]:
            self._say(self._fusions.look(self._som.services[name]))
            for followed in self._fusions.propose(self._som.services[name], time):
                self._follow(followed, fused=True)

    def _plan(self) -> None:
        there = frozenset(service.name for service in self._som if self._is_there(service))
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

    def _search(self, wanted: _Wanted) -> None:
        service, first = wanted.service, len(wanted.excluded) == 1
        if first:
            self._rest(service.name)
        others, knows = self._table.excluding(wanted.excluded), self._predictor
        try:
            if wanted.watches:
                plan = plan_sources(self._ontology, service.sources, others, predictor=knows)
                if all(service.name in each.service.upstream for each in plan.inputs):
                    return  # it would only repeat what the service says
            else:
                plan = plan_service(self._ontology, service, others, predictor=knows)
            followed = self._derivations.made(plan)
        except ShsaError:
            return  # nothing would take its place
        self._follow(followed)
        if first:
            for node in dict.fromkeys(source.node for source in plan.inputs):
                without = (*wanted.excluded, node)
                self._wanted += _Wanted(service, without), _Wanted(service, without, watches=True)

    def _rest(self, service: str) -> None:
        """Follow no plan for a service, and give up those that rested for long."""
        plans = self._derivations.plans(service)
        resting = [plan for plan in plans if not plan.is_followed]
        for plan in resting[: -2 * settings.PLANS]:
            self._derivations.give_up(plan)
        for plan in plans:
            if plan.substitutes:
                plan.substitutes = False
                plan.doubt()

    def _follow(self, followed: FollowedPlan, fused: bool = False) -> None:
        """Follow a plan from now on, unless there are enough, or it teaches nothing."""
        now = [each for each in self._derivations.plans() if each.substitutes]
        others = sum(each.plan.service == followed.plan.service for each in now)
        enough = not fused and others >= settings.PLANS
        rate = sum(each.rate for each in now) + followed.rate
        plain = (each for each in followed.outputs if not each.integrates)
        told = [each for each in plain if self._calibrates(each.source)]
        if followed.substitutes or enough or rate > settings.EVALUATIONS_HZ or not told:
            return
        for output in told:
            output.calibrate()
        followed.substitutes = True

    def _kept_back(self, followed: FollowedPlan) -> Iterator[Log]:
        """Say once which calibrations do not follow their sensor."""
        for output in followed.outputs:
            own, source = output.calibrator, output.source
            if own.keeps and source not in self._kept:
                self._kept.add(source)
                what = f"{source.property} and what is derived of it part by {own.pull:.3g}"
                text = f"{source.topic}: {what}: its calibration stays as it was"
                yield Log(Level.WARN, text)


def _row(followed: FollowedPlan) -> CalibrationRow:
    for each in followed.outputs:
        each.told = each.calibration
    return CalibrationRow(*followed.key, tuple(each.told for each in followed.outputs))


def _has_moved(output: Output) -> bool:
    before, now = output.told, output.calibration
    if before.error is None or now.error is None:
        return now != before
    share, rms = settings.TOLD_SHARE, now.error.rms
    return (
        abs(now.gain - before.gain) > share**2
        or abs(now.offset - before.offset) > share * rms
        or abs(rms - before.error.rms) > share * rms
    )
