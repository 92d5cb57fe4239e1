"""Detection plus reaction against the time that a service's users tolerate."""
from dataclasses import replace
from typing import Dict

import pytest

from shsa_core.healing.settings import Settings
from shsa_core.model.checks import Checks, Stuck
from shsa_core.model.kinds import Contain, Kind, Policy, Standby
from shsa_core.model.service import AdaptiveDeadline, Provision, Service
from shsa_core.model.som import Som
from shsa_core.analysis import budget
from shsa_core.analysis.budget import budgets, check_budgets

RANGED = Provision("x", "data", range=(0.0, 1.0))
FAST = Service("x", "/x", "pkg/T", "/n", 0.02, (RANGED,), needed=True, contain=Contain.NODE)
SETTINGS = Settings(kill_patience=0.1)


@pytest.fixture(autouse=True)
def takeovers(monkeypatch: pytest.MonkeyPatch) -> None:
    figures = {Standby.COLD: 0.8, Standby.WARM: 0.05, Standby.HOT: 0.03}
    monkeypatch.setattr(budget, "TAKEOVERS", figures)


def totals(service: Service) -> Dict[Kind, float]:
    return {each.kind: each.total for each in budgets(service, SETTINGS)}


def test_the_sum_is_of_what_finds_it_and_of_what_stands_by() -> None:
    cold = totals(FAST)
    assert cold[Kind.NODE_GONE] == pytest.approx(0.8)
    assert cold[Kind.SILENT] == pytest.approx(0.25 + 0.8)
    assert cold[Kind.OUT_OF_RANGE] == pytest.approx(3 * 0.02 + 0.1 + 0.8)
    assert cold[Kind.RATE_LOW] == pytest.approx(1.0 / 0.6 + 0.1 + 0.8)
    polite = totals(replace(FAST, contain=None))  # its node is given longer to answer
    assert polite[Kind.OUT_OF_RANGE] == pytest.approx(3 * 0.02 + 1.0 + 0.8)
    hot = totals(replace(FAST, standby=Standby.HOT, deadline=3.0, bridge=0.0))
    assert hot[Kind.SILENT] == pytest.approx(0.06 + 0.03)
    assert totals(replace(FAST, standby=Standby.WARM))[Kind.NODE_GONE] == pytest.approx(0.05)


def test_a_deadline_that_is_learned_counts_as_long_as_it_can_become() -> None:
    learned = totals(replace(FAST, deadline=AdaptiveDeadline(0.01)))
    assert learned[Kind.SILENT] == pytest.approx(4 * 0.25 + 0.8)


def test_a_silence_that_is_filled_in_lasts_for_the_bridge_and_a_period() -> None:
    hot = replace(FAST, standby=Standby.HOT)
    assert totals(hot)[Kind.SILENT] == pytest.approx(2.5 * 0.02 + 0.02)
    assert totals(replace(hot, bridge=100.0))[Kind.SILENT] == pytest.approx(0.25 + 0.03)
    assert totals(replace(hot, host="pi"))[Kind.SILENT] == pytest.approx(0.25 + 0.03)
    limit = replace(hot, fault_tolerant_time=0.1, checks=Checks(each=()))
    limit = replace(limit, provides=(Provision("x", "data", checks=()),))
    assert not list(check_budgets(Som([limit]), SETTINGS))
    shared = replace(limit, name="y", node="/m", needed=False)
    assert len(list(check_budgets(Som([limit, shared]), SETTINGS))) == 1


def test_a_value_that_stands_still_is_found_later() -> None:
    still = replace(FAST, provides=(Provision("x", "data", checks=(Stuck(2.0),)),))
    assert totals(still)[Kind.STUCK] == pytest.approx(2.0 + 0.06 + 0.1 + 0.8)


def test_a_node_that_is_started_again_costs_the_pause_and_a_start() -> None:
    assert totals(replace(FAST, policy=Policy.RESTART))[Kind.NODE_GONE] == pytest.approx(0.5 + 0.8)


def test_an_event_driven_service_is_found_by_its_connection_alone() -> None:
    assert list(totals(replace(FAST, period=None))) == [Kind.NODE_GONE]


def test_what_takes_longer_than_is_tolerated_is_told_with_its_sums() -> None:
    plain = replace(FAST, checks=Checks(each=()), fault_tolerant_time=0.9)
    ((_, late),) = check_budgets(Som([plain]), SETTINGS)
    assert late == (
        "x tolerates 0.9 s, but: "
        "not_a_number: 0.06 s until it is found + 0.90 s until it is healed = 0.96 s; "
        "out_of_range: 0.06 s until it is found + 0.90 s until it is healed = 0.96 s; "
        "silent: 0.25 s until it is found + 0.80 s until it is healed = 1.05 s"
    ) or late.startswith("x tolerates 0.9 s, but: silent: 0.25 s until it is found")
    enough = replace(plain, standby=Standby.HOT)
    assert not list(check_budgets(Som([enough]), SETTINGS))
    advised, unbounded = replace(plain, policy=Policy.ADVISE), replace(
        plain, fault_tolerant_time=None
    )
    for other in (advised, unbounded, replace(plain, needed=False)):
        assert not list(check_budgets(Som([other]), SETTINGS))
