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
from typing import Deque, FrozenSet, List, Optional, Set, Tuple

from shsa_core.codegen.plans import plan_service, plan_witness
from shsa_core.codegen.prediction import Predictor
from shsa_core.errors import ShsaError
from shsa_core.model.calibration import Calibration
from shsa_core.model.field import is_angle
from shsa_core.model.ontology import Ontology
from shsa_core.model.service import Service, Source
from shsa_core.model.som import Som
from shsa_core.monitoring import settings
from shsa_core.monitoring.board import Board
from shsa_core.monitoring.derivations import Derivations, FollowedPlan
from shsa_core.monitoring.events import CalibrationRow, CalibrationsChanged, Told
from shsa_core.monitoring.fusions import Fusions
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

    def __init__(self, ontology: Ontology, derivations: Derivations, board: Board) -> None:
        self._ontology, self._derivations, self._board = ontology, derivations, board
        self._som = Som()
        self._predictor: Optional[Predictor] = None
        self._planned: FrozenSet[str] = frozenset()
        self._table: Optional[SourceTable] = None
        self._wanted: Deque[_Wanted] = deque()
        self._replan_at = self._search_at = -inf
        self._kept: Set[Source] = set()  # of these it was said
        self._fusions = Fusions(ontology, derivations)
        self._turn = 0

    def watch(self, som: Som, predictor: Optional[Predictor], gone: List[FollowedPlan]) -> None:
        """Follow plans for the services of `som`; those that are `gone` are told no more."""
        self._som, self._predictor = som, predictor
        self._tell_gone(gone)
        self._planned, self._replan_at = frozenset(), -inf
        self._wanted.clear()

    def tick(self) -> None:
        """Look at what was learned, and search a plan."""
        time = self._board.now
        refreshed = self._derivations.refreshed()
        told = [each for each in refreshed if each.substitutes and self._fusions.tells(each)]
        rows = {each.key: self._row(each) for each in told if self._has_moved(each)}
        if rows:
            self._board.say(CalibrationsChanged(time, tuple(rows.values())))
        if time >= self._replan_at:
            self._replan_at = time + settings.REFRESH_S
            self._plan()
            self._fuse()
        if self._wanted and time >= self._search_at:
            self._search_at = time + settings.SEARCH_S
            self._search(self._wanted.popleft())

    def _fuse(self) -> None:
        """Look at what is fused of one service that is there, one after the other."""
        self._turn += 1
        for name in sorted(self._planned)[self._turn % max(1, len(self._planned)) :][:1]:
            service, time = self._som.services[name], self._board.now
            gone, said = self._fusions.look(service)
            self._tell_gone(gone)
            for text in said:
                self._board.say(Told(time, text, warning=False))
            for followed in self._fusions.propose(service, time):
                self._follow(followed, fused=True)

    def _tell_gone(self, gone: List[FollowedPlan]) -> None:
        if gone:
            keys = tuple(each.key for each in gone)
            self._board.say(CalibrationsChanged(self._board.now, (), keys))

    def _is_there(self, service: Service) -> bool:
        """Tell if the service's own node is healthy, and has told something."""
        node = self._board.find(service.topic, service.node)
        return node is not None and node.is_healthy and node.last_good is not None

    def _plan(self) -> None:
        """Search plans anew if other services are there now."""
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
        assert self._table is not None
        service = wanted.service
        if wanted.first:
            self._rest(service.name)
        question = self._ontology, service, self._table, wanted.excluded
        try:
            if wanted.watches:
                plan = plan_witness(*question, self._predictor)
            else:
                plan = plan_service(*question, predictor=self._predictor)
            followed = self._derivations.made(plan)
        except ShsaError:
            return  # nothing would take its place
        self._follow(followed)
        if wanted.first:
            nodes = dict.fromkeys(source.node for source in plan.inputs)
            without = [(*wanted.excluded, node) for node in nodes]
            more = [_Wanted(service, each, False, w) for each in without for w in (False, True)]
            self._wanted.extend(more)

    def _rest(self, service: str) -> None:
        """Follow no plan for a service, and give up those that rested for long."""
        plans = self._derivations.plans(service)
        resting = [plan for plan in plans if not plan.is_followed]
        gone = resting[: -2 * settings.PLANS]
        for plan in gone:
            self._derivations.give_up(plan)
        self._tell_gone(gone)
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
        told = [
            each
            for each in followed.outputs
            if self._calibrates(each.source) and not each.integrates
        ]
        if followed.substitutes or enough or rate > settings.EVALUATIONS_PER_S or not told:
            return
        for output in told:
            output.calibrate()
        followed.substitutes = True

    def _has_moved(self, followed: FollowedPlan) -> bool:
        """Tell if calibrations are worth being told; say once which do not follow their sensor."""
        for output in followed.outputs:
            own, source = output.calibrator, output.source
            if own is not None and own.keeps and source not in self._kept:
                self._kept.add(source)
                what = f"{source.property} and what is derived of it part by {own.pull:.3g}"
                text = f"{source.topic}: {what}: its calibration stays as it was"
                self._board.say(Told(self._board.now, text))
        now = [each.calibration for each in followed.outputs]
        if not any(each.error for each in now):
            return False
        return not followed.told or any(map(_moved, followed.told, now))

    def _row(self, followed: FollowedPlan) -> CalibrationRow:
        followed.told = tuple(each.calibration for each in followed.outputs)
        return CalibrationRow(*followed.key, followed.told)


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
