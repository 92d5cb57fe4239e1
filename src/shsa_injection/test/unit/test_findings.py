"""Chaos demands that faults are found: their kind, how soon, and of whom."""
from dataclasses import replace
from typing import List

import pytest

from shsa_core.model.checks import Checks, RateLow
from shsa_core.model.kinds import Kind
from shsa_core.model.service import Provision, Service
from shsa_injection.findings import FINDINGS, Told, not_found
from shsa_injection.invariants import Violation
from shsa_injection.vocabulary import FAULTS, Place

SERVICE = Service(
    "current", "/current", "p/T", "/meter", 0.02, (Provision("i", "data", (0.0, 9.0)),), needed=True
)


def judge(
    fault: str, *told: Told, service: Service = SERVICE, lasted: float = 4.0
) -> List[Violation]:
    return not_found(fault, service, 0.25, 10.0, 10.0 + lasted, told)


def test_every_fault_that_must_be_found_is_one_of_a_topic() -> None:
    assert set(FINDINGS) < set(FAULTS)
    assert all(FAULTS[word].place is not Place.MASTER for word in FINDINGS)


def test_a_fault_that_was_not_found_is_told_with_what_was_told_instead() -> None:
    (none,) = judge("garbage")
    assert (none.about, none.seen) == ("/current garbage", "not found within 1 s")
    (other,) = judge("garbage", Told(10.2, "/current", "/meter", "rate_low"))
    assert other.seen == "not found within 1 s; told were rate_low"


@pytest.mark.parametrize(
    "fault, publisher, kind",
    [
        ("garbage", "/meter", "out_of_range"),
        ("hang", "/meter", "silent"),
        ("duplicate", "/meter", "stale_stamp"),
        ("spoof_name", "/stranger", "out_of_range"),
    ],
)
def test_a_failure_that_fits_is_enough(fault: str, publisher: str, kind: str) -> None:
    assert judge(fault, Told(10.2, "/current", publisher, kind)) == []


@pytest.mark.parametrize(
    "told",
    [
        Told(9.9, "/current", "/meter", "out_of_range"),
        Told(11.1, "/current", "/meter", "out_of_range"),
        Told(10.2, "/other", "/meter", "out_of_range"),
        Told(10.2, "/current", "/stranger", "out_of_range"),
    ],
)
def test_one_of_before_or_late_or_of_somebody_else_is_not(told: Told) -> None:
    assert len(judge("garbage", told)) == 1


def test_the_innocent_node_must_not_be_blamed_for_a_stranger() -> None:
    assert len(judge("spoof", Told(10.2, "/current", "/meter", "out_of_range"))) == 1


@pytest.mark.parametrize("fault", ["stuck", "wrong", "intermittent", "hung_subscriber"])
def test_what_depends_on_the_robot_is_not_demanded(fault: str) -> None:
    assert judge(fault) == []


def test_what_is_short_or_not_needed_or_not_watched_is_not_demanded() -> None:
    assert judge("slow", lasted=2.9) == []
    assert judge("slow", service=replace(SERVICE, needed=False)) == []
    others = [check for check in SERVICE.checks.each if check.kind is not Kind.RATE_LOW]
    assert judge("slow", service=replace(SERVICE, checks=Checks(tuple(others)))) == []
    assert judge("slow", service=replace(SERVICE, checks=Checks((RateLow(0.6),)))) != []
    no_range = replace(SERVICE, provides=(Provision("i", "data"),))
    assert [each.about for each in judge("nan", service=no_range)] == ["/current nan"]
    assert judge("garbage", service=no_range) == []


def test_a_slow_topic_has_as_many_messages() -> None:
    slow = replace(SERVICE, period=0.1)
    late = Told(14.0, "/current", "/meter", "out_of_range")
    assert judge("garbage", late, service=slow, lasted=6.0) == []
