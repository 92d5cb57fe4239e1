"""How long others have been silent, by an honest watch."""
import math

import pytest

from shsa_core.silence import LEAST_LATE_S, LONGEST_STEP_S, Silence

MATTERS = 1.0


@pytest.fixture
def watch() -> Silence:
    found = Silence(MATTERS)
    found.pass_time(10.0, None)
    return found


def test_who_wakes_when_he_wanted_to_need_not_look_in_between(watch: Silence) -> None:
    wanted = watch.left(MATTERS)
    assert wanted == pytest.approx(10.0 + MATTERS)
    watch.pass_time(wanted, wanted)
    assert watch.silence == pytest.approx(MATTERS)


def test_what_comes_before_that_counts_as_long_as_it_lasted(watch: Silence) -> None:
    watch.pass_time(10.7, 11.0)
    assert watch.silence == pytest.approx(0.7)
    assert watch.left(MATTERS) == pytest.approx(11.0)


@pytest.mark.parametrize("late", (0.3, 5.0, 3600.0))
def test_who_was_held_up_himself_grants_as_much_to_others(watch: Silence, late: float) -> None:
    watch.pass_time(10.9 + late, 10.9)
    assert watch.silence == pytest.approx(max(0.0, 0.9 - late))


def test_a_little_late_is_on_time() -> None:
    watch = Silence(0.001)
    watch.pass_time(10.0, None)
    watch.pass_time(10.001 + 0.9 * LEAST_LATE_S, 10.001)
    assert watch.silence == pytest.approx(0.001 + 0.9 * LEAST_LATE_S)


@pytest.mark.parametrize("wanted", (None, math.inf))
def test_where_nobody_said_when_to_wake_a_long_step_is_none_of_theirs(
    watch: Silence, wanted: float
) -> None:
    watch.pass_time(20.0, wanted)
    assert watch.silence == LONGEST_STEP_S


def test_the_clock_never_goes_back(watch: Silence) -> None:
    watch.pass_time(10.5, 11.0)
    watch.pass_time(10.2, 11.0)
    watch.pass_time(10.6, 11.0)
    assert watch.silence == pytest.approx(0.6)
