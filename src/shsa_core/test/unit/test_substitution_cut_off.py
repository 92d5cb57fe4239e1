"""A substitute decides by itself while its computer cannot reach the reconfigurator."""
from dataclasses import replace
from typing import Any, List, Tuple

import pytest
from substitute_driver import DEADLINE, OUT, PERIOD, Driver, only, row, running, signal
from shsa_core.model.kinds import OnPartition
from shsa_core.model.substitution import CHANGEOVER_S, Substitution
from shsa_core.substitution import events
from shsa_core.watch import LONGEST_STEP_S

ORIGINAL = "/original"
INTEGRAL = "t0=x[0];\ndef _tf1(i1): return integral(i1)\nt1=_tf1(t0);\ny=t1"


def heals(publishing: bool = False, **of: Any) -> Substitution:
    return replace(row(publishing, **of), host="pi", on_partition=OnPartition.HEAL)


def hot(publishing: bool = False, **of: Any) -> Driver:
    """A substitute on another computer, with fresh inputs, in reach of the reconfigurator."""
    driver = Driver(row(**of))
    driver.ready()
    driver.change(heals(publishing, **of))
    driver.arrive(1.0)
    return driver


def side(driver: Driver, until: float, other: bool = False) -> List[Tuple[float, float]]:
    """Its inputs come, and the other publisher if it is there; what it publishes."""
    since = driver.time
    while driver.time < until - 1e-9:
        driver.arrive(1.0)
        if other:
            driver.tell(events.OtherHeard, "/out", ORIGINAL)
        driver.pass_to(round(driver.time + PERIOD, 9))
    return driver.published(since + 1e-9)


def cut(driver: Driver, cut_off: bool = True) -> None:
    driver.tell(events.ReachChanged, cut_off)


def test_others_are_listened_for_once_and_only_where_the_row_says_so() -> None:
    assert not only(Driver(row()).change(row(True)), events.Overhear)
    driver = Driver(row())
    (overhear,) = only(driver.change(heals()), events.Overhear)
    assert overhear == events.Overhear("/out", OUT.type)
    assert not only(driver.change(heals(True)), events.Overhear)


def test_cut_off_it_takes_over_once_the_original_is_silent_for_its_deadline() -> None:
    driver = hot()
    assert side(driver, 1.0, other=True) == []
    cut(driver)
    first = side(driver, 2.0)[0][0]
    assert 1.0 + DEADLINE - 2 * PERIOD < first < 1.0 + DEADLINE + PERIOD
    assert len(driver.published(1.5)) in (25, 26)


def test_in_reach_or_while_the_original_is_heard_it_does_as_it_is_told() -> None:
    driver = hot()
    side(driver, 1.0, other=True)
    assert side(driver, 3.0) == []
    cut(driver)
    assert side(driver, 5.0, other=True) == []


def test_at_the_reunion_the_spare_one_yields_at_the_first_message() -> None:
    driver = hot()
    side(driver, 1.0, other=True)
    cut(driver)
    assert side(driver, 3.0)
    driver.tell(events.OtherHeard, "/out")
    assert side(driver, 3.0 + DEADLINE - 2 * PERIOD) == []
    cut(driver, False)
    assert side(driver, 5.0) == []


def test_one_that_publishes_goes_on_alone_and_yields_to_whoever_comes() -> None:
    driver = hot(publishing=True)
    assert side(driver, 0.5)
    cut(driver)
    assert len(side(driver, 1.5)) >= 49  # nobody was ever heard
    driver.tell(events.OtherHeard, "/out")
    assert side(driver, 2.5, other=True) == []
    cut(driver, False)  # the reconfigurator does not know yet that the original is back
    driver.change(heals(publishing=True))
    assert side(driver, 3.5, other=True) == []
    driver.change(heals())
    driver.change(heals(publishing=True))
    assert side(driver, 4.0)


def test_who_has_yielded_goes_on_when_the_other_one_is_silent_again() -> None:
    driver = hot(publishing=True)
    cut(driver)
    driver.tell(events.OtherHeard, "/out")
    assert side(driver, DEADLINE - PERIOD) == []
    assert side(driver, 1.0)


def test_when_the_reconfigurator_is_in_reach_it_follows_its_row_at_once() -> None:
    driver = hot()
    side(driver, 1.0, other=True)
    cut(driver)
    assert side(driver, 2.0)
    cut(driver, False)
    assert side(driver, 3.0) == []


def test_who_never_heard_anybody_and_who_has_no_deadline_takes_nothing_over() -> None:
    driver = hot()
    cut(driver)
    assert side(driver, 3.0) == []
    driver = hot(outputs=(signal("/out", deadline=None),))
    side(driver, 1.0, other=True)
    cut(driver)
    assert side(driver, 5.0) == []


def test_without_its_inputs_it_publishes_nothing() -> None:
    driver = hot(outputs=(signal("/out", deadline=2 * DEADLINE),))
    side(driver, 1.0, other=True)
    cut(driver)
    driver.pass_to(5.0)
    assert driver.published() == []


def test_time_in_which_it_was_stopped_is_no_silence_of_others() -> None:
    driver = hot()
    side(driver, 1.0, other=True)
    cut(driver)
    driver.time = 100.0
    driver.arrive(1.0)
    driver.tell(events.OtherHeard, "/out")
    assert driver.published() == [] and LONGEST_STEP_S < DEADLINE


def test_another_topic_is_another_story() -> None:
    driver = hot()
    side(driver, 1.0, other=True)
    outputs = (signal("/more"),)
    (overhear,) = only(driver.change(heals(outputs=outputs)), events.Overhear)
    assert overhear.topic == "/more"
    driver.ready("/more")
    cut(driver)
    driver.tell(events.OtherHeard, "/out")
    assert side(driver, 3.0) == []


def test_where_the_som_says_wait_a_cut_changes_nothing() -> None:
    driver = running()
    cut(driver)
    driver.tell(events.OtherHeard, "/out")
    assert side(driver, 3.0) == []
    driver = running(publishing=True)
    cut(driver)
    assert side(driver, 1.0, other=True)


@pytest.mark.parametrize("here", [False, True])
def test_one_whose_original_was_only_silent_yields_to_it_and_goes_on_when_it_is_silent(
    here: bool,
) -> None:
    driver = hot(publishing=True)
    told = row(True) if here else heals(publishing=True)
    driver.change(replace(told, yields=True, provider=ORIGINAL))
    assert side(driver, 1.0)
    driver.tell(events.OtherHeard, "/out", "/stranger")
    assert len(side(driver, 1.5)) >= 24
    assert side(driver, 2.0, other=True) == []
    assert side(driver, 3.0)[0][0] >= 2.0 + DEADLINE - 2 * PERIOD
    side(driver, 4.0, other=True)
    driver.change(told)  # the reconfigurator says that it is alone
    assert side(driver, 5.0)


def beside(driver: Driver, until: float, node: str) -> List[Tuple[float, float]]:
    """Its inputs come, and somebody publishes on its topic; what it publishes."""
    since = driver.time
    while driver.time < until - 1e-9:
        driver.tell(events.OtherHeard, "/out", node)
        side(driver, driver.time + PERIOD)
    return driver.published(since + 1e-9)


@pytest.mark.parametrize("here", [False, True])
def test_a_stranger_does_not_keep_one_still_that_has_yielded(here: bool) -> None:
    driver = hot(publishing=True)
    told = row(True) if here else heals(publishing=True)
    driver.change(replace(told, yields=True, provider=ORIGINAL))
    side(driver, 1.0, other=True)
    assert len(beside(driver, 2.0, "/stranger")) >= 36


@pytest.mark.parametrize("names", [{"provider": ORIGINAL}, {"original": ORIGINAL}, {}])
@pytest.mark.parametrize("other", [ORIGINAL, "/robot/substitute_out_3", "/stranger"])
def test_in_reach_again_it_waits_until_the_reconfigurator_has_heard_of_the_other_one(
    names: Any, other: str
) -> None:
    driver = hot(publishing=True)
    driver.change(replace(heals(publishing=True), **names))
    cut(driver)
    assert beside(driver, 1.0, other) == []
    cut(driver, False)
    assert beside(driver, 1.0 + CHANGEOVER_S, other) == []
    stays = other in names.values() or "substitute" in other
    assert len(beside(driver, 4.0, other)) in (range(1) if stays else range(84, 90))


def test_an_integral_that_no_last_message_starts_takes_nothing_over() -> None:
    """It was started for another failure, long ago."""
    driver = hot(publishing=True, code=INTEGRAL)
    last = events.LastMessage((("data", 5.0),))
    started = replace(heals(publishing=True, code=INTEGRAL), last_message=b"last")
    driver.tell(events.RowChanged, started, (), last)
    assert side(driver, 1.0)
    driver.change(heals(code=INTEGRAL))
    side(driver, 10.0, other=True)
    cut(driver)
    assert side(driver, 12.0) == []
    driver.change(started)
    assert side(driver, 13.0)


def test_beyond_a_cut_it_yields_to_whoever_is_heard() -> None:
    """It may be another substitute, on the other side."""
    driver = hot(publishing=True)
    driver.change(replace(heals(publishing=True), yields=True, provider=ORIGINAL))
    cut(driver)
    driver.tell(events.OtherHeard, "/out", "/substitute_2")
    assert side(driver, DEADLINE - PERIOD) == []
