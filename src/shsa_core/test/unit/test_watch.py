"""A clock that stands while we, the link or the other end could not act."""
import math
from random import Random
from typing import Optional

import pytest

from shsa_core.watch import LEAST_LATE_S, LONGEST_STEP_S, Watch

BEGAN = 10.0


@pytest.fixture
def watch() -> Watch:
    made = Watch()
    made.look(BEGAN)
    return made


def test_time_passes_where_we_wake_as_we_wanted(watch: Watch) -> None:
    assert watch.when(BEGAN, 1.0) == pytest.approx(11.0)
    watch.look(10.7, 11.0)
    assert watch.passed(BEGAN) == pytest.approx(0.7) and not watch.has_passed(BEGAN, 1.0)
    assert watch.passed(10.5) == pytest.approx(0.2) and watch.passed(10.8) == 0.0
    watch.look(11.0, 11.0)
    assert watch.has_passed(BEGAN, 1.0)


def test_a_little_late_is_on_time(watch: Watch) -> None:
    watch.look(10.01 + 0.9 * LEAST_LATE_S, 10.01)
    assert watch.passed(BEGAN) == pytest.approx(0.01 + 0.9 * LEAST_LATE_S)


@pytest.mark.parametrize("late", (0.2, 0.3, 5.0, 3600.0))
def test_it_stands_while_we_were_held_up_and_as_long_again_for_others(
    watch: Watch, late: float
) -> None:
    woke = 10.9 + late
    watch.look(woke, 10.9)
    assert watch.passed(BEGAN) == pytest.approx(0.9)
    assert watch.passed(woke - late / 2) == 0.0
    assert watch.when(BEGAN, 1.0) == pytest.approx(woke + min(max(0.1, late), 1.0))
    assert watch.when(BEGAN, 0.6) == pytest.approx(woke + min(late, 0.3))
    assert watch.when(BEGAN, 0.2) == woke
    watch.look(woke + 5.0, woke + 5.0)
    assert watch.passed(BEGAN) == pytest.approx(0.9 + 5.0)


def test_others_need_not_catch_up_with_a_small_part_of_what_is_waited_for(watch: Watch) -> None:
    watch.look(10.909, 10.9)
    assert watch.passed(BEGAN) == pytest.approx(0.9) and watch.has_passed(BEGAN, 0.9)


def test_who_is_always_late_sees_time_pass(watch: Watch) -> None:
    now = BEGAN
    while not watch.has_passed(BEGAN, 0.1) and now < BEGAN + 1.0:
        wanted = watch.when(BEGAN, 0.1)
        now = wanted + 0.03
        watch.look(now, wanted)
    assert now <= BEGAN + 2 * 0.13


@pytest.mark.parametrize("wanted", (None, math.inf))
def test_where_nobody_said_when_to_wake_a_long_step_is_a_hold_up(
    watch: Watch, wanted: Optional[float]
) -> None:
    watch.look(20.0, wanted)
    assert watch.passed(BEGAN) == pytest.approx(LONGEST_STEP_S)


def test_time_in_which_the_other_end_waits_for_a_processor_does_not_count(watch: Watch) -> None:
    watch.starve(BEGAN, 7.0)
    watch.look(10.8, 10.8)
    watch.starve(10.8, 7.3)
    assert watch.passed(BEGAN) == pytest.approx(0.5)
    watch.starve(10.8, 7.3)
    assert watch.passed(BEGAN) == pytest.approx(0.5)


def test_what_holds_up_both_ends_counts_once(watch: Watch) -> None:
    watch.look(10.9, 10.6)
    watch.starve(10.9, 0.3)
    watch.stand(10.5, 10.7)
    assert watch.passed(BEGAN) == pytest.approx(0.5)


def test_the_clock_never_goes_back(watch: Watch) -> None:
    watch.look(10.5, 11.0)
    watch.look(10.2, 11.0)
    assert watch.now == 10.5
    watch.look(10.6, 11.0)
    assert watch.passed(BEGAN) == pytest.approx(0.6)


def test_random_hold_ups_leave_a_clock_that_goes_on_and_never_faster_than_time() -> None:
    random = Random(7)
    for _ in range(200):
        watch, now = Watch(), 0.0
        watch.look(now)
        for _ in range(100):
            before = watch.passed(0.0)
            wanted = now + random.choice((1e-4, 0.01, 0.1))
            step = wanted + random.choice((0.0, 0.0, 1e-3, 0.02, 0.3)) - now
            now += step
            watch.look(now, wanted)
            if random.random() < 0.1:
                watch.stand(now - step, now)
            assert -1e-9 <= watch.passed(0.0) - before <= step + 1e-9
            due = watch.when(0.0, 1.0)
            assert due >= now and (due > now or watch.has_passed(0.0, 1.0))
        watch.look(now + 3.0, now + 3.0)
        assert watch.passed(now) > 2.0
