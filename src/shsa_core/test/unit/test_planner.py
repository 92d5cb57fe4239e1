"""What planning makes of what the monitor has measured: which calibration and errors count."""
from dataclasses import replace
from typing import Any, Tuple

import pytest

from core_robot import A, ONTOLOGY, SOM
from shsa_core.codegen.generator import ways_of
from shsa_core.codegen.plans import Plan, plan_service
from shsa_core.model.calibration import Calibration, CalibrationRow
from shsa_core.model.error import Error
from shsa_core.model.service import Deadlines
from shsa_core.planning.planner import Calibrations, Planner
from shsa_core.planning.settings import CHANGED, ENOUGH
from shsa_core.search.derivation import SourceTable

TABLE = SourceTable(ONTOLOGY.network, SOM.sources)
BEST = plan_service(ONTOLOGY, SOM.services["a"], TABLE, (A,))
NEXT = plan_service(ONTOLOGY, SOM.services["a"], TABLE, (A,), tried=[BEST])
(WAY,) = ways_of(BEST.program)


def found(rms: float, n: int = ENOUGH, gain: float = 1.0) -> Calibration:
    return Calibration(gain, 0.0, Error(rms, n=n))


def row(*calibrations: Calibration, plan: Plan = BEST) -> CalibrationRow:
    return CalibrationRow("a", plan.program, calibrations)


def counts(known: Calibrations, plan: Plan = BEST) -> Tuple[Calibration, ...]:
    return known.of("a", plan.program)


def test_a_calibration_for_each_output_counts_and_no_other_number_of_them() -> None:
    known = Calibrations()
    assert not known.add(row(), False) and not known.add(row(found(0.1), found(0.2)), False)
    assert counts(known) == () and known.programs("a") == ()
    assert known.add(row(found(0.1)), False)
    assert counts(known) == (found(0.1),) and known.programs("a") == (BEST.program,)


def test_a_monitor_that_knows_less_is_not_believed_until_it_knows_enough() -> None:
    known = Calibrations()
    for n, believed in ((20, True), (19, False), (20, True), (5 * ENOUGH, True)):
        assert known.add(row(found(0.1, n)), False) is believed
    assert not known.add(row(found(0.2, ENOUGH - 1)), False)
    assert known.add(row(found(0.2, ENOUGH)), False) and counts(known) == (found(0.2),)
    assert not known.add(row(Calibration(2.0)), False), "of which nothing was measured"


def test_an_error_is_another_one_once_it_differs_by_a_share() -> None:
    known = Calibrations()
    known.add(row(found(1.0, ENOUGH - 1)), False)
    assert known.measured == {"a": {}} and not known.replan, "it was not measured for long"
    steps = ((1.0, True), (1.0 + 0.9 * CHANGED, False), (1.0 - 1.1 * CHANGED, True), (2.0, True))
    for rms, anew in steps:
        known.replan.clear()
        known.add(row(found(rms)), False)
        assert known.replan == ({"a"} if anew else set())
    assert known.measured == {"a": {WAY: Error(2.0, n=ENOUGH)}}


def test_while_a_service_is_healed_its_calibration_stays_and_its_error_counts() -> None:
    known = Calibrations()
    known.add(row(found(0.1, gain=1.5)), False)
    assert known.add(row(found(0.4, 1, gain=3.0)), True) is False, "it knows too little"
    assert known.add(row(found(0.4, gain=3.0)), True)
    assert counts(known) == (found(0.4, gain=1.5),)
    assert known.add(row(found(0.4, gain=4.0)), True) is False, "nothing changes by that"
    known.healed("a")
    assert counts(known) == (found(0.4, gain=4.0),)
    known.add(row(found(0.1, gain=1.5)), False)
    known.healed("a")
    assert counts(known) == (found(0.1, gain=1.5),), "what was told then was counted once"


def test_what_is_followed_no_more_and_a_service_that_left_are_forgotten() -> None:
    known = Calibrations()
    known.leave("a", BEST.program)
    known.add(row(found(0.1)), False)
    known.add(row(found(0.3), plan=NEXT), False)
    known.replan.clear()
    known.leave("a", BEST.program)
    assert known.programs("a") == (NEXT.program,) and not known.replan
    assert list(known.measured["a"].values()) == [Error(0.3, n=ENOUGH)]
    known.add(row(found(0.4, gain=4.0), plan=NEXT), True)
    known.forget("a")
    known.healed("a")
    assert known.programs("a") == () and known.measured == {} and counts(known, NEXT) == ()


def erring(*each: Tuple[Plan, Any]) -> Planner:
    """A planner that knows what plans err by, as far as that is known."""
    planner = Planner(ONTOLOGY, SOM, {}, "best", Deadlines())
    for plan, rms in each:
        planner.calibrations.add(row(found(rms) if rms else Calibration(2.0), plan=plan), False)
    return planner


@pytest.mark.parametrize(
    "own, other, more",
    [
        (1.0, 1.0 - 1.1 * CHANGED, True),
        (1.0, 1.0 - CHANGED, False),
        (1.0, 1.5, False),
        (1.0, None, False),
        (None, 0.1, False),
    ],
)
def test_a_plan_errs_more_than_one_that_errs_clearly_less(own: Any, other: Any, more: bool) -> None:
    planner = erring((BEST, own), (NEXT, other))
    assert planner.errs_more(BEST, NEXT) is more
    assert planner.errs_more(BEST) is more, "as any that is known"
    assert not planner.errs_more(BEST, BEST)


def test_what_a_former_reconfigurator_carried_out_is_found_among_the_best() -> None:
    available = {each.name: each for each in SOM if each.name != "a"}
    planner = Planner(ONTOLOGY, SOM, available, "best", Deadlines())
    service = SOM.services["a"]
    for plan in (BEST, NEXT):
        assert planner.recall(service, planner.row(service, plan, node="")) == plan
    changed = replace(planner.row(service, BEST, node=""), code=BEST.program.code + "\n")
    assert planner.recall(service, changed) is None
