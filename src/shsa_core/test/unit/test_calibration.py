"""The calibration of a derivation: gain and offset as the sensor tells, and nothing worse."""
from math import inf, nan, pi, remainder, sin, sqrt, tau
from random import Random
from statistics import pvariance
from typing import Callable

import pytest

from shsa_core.derivations.calibrator import Calibrator
from shsa_core.derivations.settings import (
    DRIFT_S,
    ERRORS,
    ERRORS_APART,
    FEWEST_ERRORS,
    GAIN_STEP,
    GUARD_S,
    SAMPLE_S,
    SETTLING_S,
)
from shsa_core.model.calibration import PRIOR_GAIN, UNCALIBRATED, Calibration

PERIOD = 0.1
ERROR_S = ERRORS_APART * SAMPLE_S
NOISE = 0.3

Signal = Callable[[float], float]


def driving(time: float) -> float:
    return 5.0 + 3.0 * sin(time / 3.0) + 2.0 * sin(time / 17.0)


def standing(_time: float) -> float:
    return 0.5


def nothing(_time: float) -> float:
    return 0.0


class Stream:
    """A sensor that measures `gain` * derived + `offset`, with noise, and its calibrator."""

    def __init__(self, gain: float = 1.2, offset: float = 0.5, noise: float = NOISE) -> None:
        self.calibrator, self.random = Calibrator(NOISE), Random(1)
        self.gain, self.offset, self.noise = gain, offset, noise
        self.now = 1000.0

    def run(self, seconds: float, derived: Signal = driving, added: Signal = nothing) -> None:
        began = self.now
        for _ in range(round(seconds / PERIOD)):
            self.now += PERIOD
            value = derived(self.now)
            measured = self.gain * value + self.offset + added(self.now - began)
            self.calibrator.take(self.now, measured + self.random.gauss(0.0, self.noise), value)

    @property
    def found(self) -> Calibration:
        return self.calibrator.snapshot()

    def errs(self, derived: float) -> float:
        """By how much a substitute would err now against the sensor as it was."""
        return self.found(derived) - (self.gain * derived + self.offset)


@pytest.mark.parametrize("gain, offset", [(1.2, 0.5), (0.8, -2.0), (1.0, 3.0), (1.4, 0.0)])
def test_gain_and_offset_are_found(gain: float, offset: float) -> None:
    stream = Stream(gain, offset)
    stream.run(180.0)
    assert stream.found.gain == pytest.approx(gain, abs=0.02)
    assert all(abs(stream.errs(derived)) < 0.1 for derived in (0.0, 5.0, 10.0))


def test_twenty_seconds_help_already() -> None:
    stream = Stream()
    stream.run(20.0)
    assert abs(stream.errs(5.0)) < NOISE < 1.5  # which is what the relation alone errs by


def test_the_error_is_that_of_what_would_have_been_published() -> None:
    stream = Stream()
    stream.run(SETTLING_S + ERRORS * ERROR_S + GUARD_S + 10.0)
    error = stream.found.error
    assert error is not None and error.n == ERRORS
    assert error.rms == pytest.approx(NOISE, rel=0.1)
    assert abs(error.bias) < 3.0 * NOISE / sqrt(ERRORS)
    assert error.p95 == pytest.approx(1.96 * NOISE, rel=0.15)


def test_by_what_it_erred_while_it_learned_is_not_its_error() -> None:
    stream = Stream(1.4, 0.0, 0.01)
    stream.run(20.0, standing)
    stream.run(SETTLING_S)
    error = stream.found.error
    assert error is not None and error.rms < 0.15


def test_what_is_learned_far_from_zero_holds_there() -> None:
    """Gain and offset follow slowly once they have settled: not each by itself."""
    stream = Stream(0.8, 0.5)
    stream.run(SETTLING_S, lambda time: 95.0 + driving(time))
    for _ in range(6):
        stream.run(10.0, lambda time: 95.0 + driving(time))
        assert abs(stream.errs(100.0)) < 0.05


def test_nothing_is_told_before_enough_is_known() -> None:
    stream = Stream()
    stream.run(GUARD_S + GUARD_S + FEWEST_ERRORS * ERROR_S - 2.0)
    assert stream.found == UNCALIBRATED
    stream.run(4.0)
    assert stream.found.error is not None


def test_what_is_long_past_is_forgotten() -> None:
    """A heavier load: the offset follows, though slowly once it has settled."""
    stream = Stream()
    stream.run(40.0)
    stream.offset = 1.0
    stream.run(300.0)
    assert abs(stream.errs(5.0)) < 0.15


def test_the_last_seconds_before_a_failure_teach_nothing() -> None:
    stream = Stream()
    stream.run(30.0)
    before = stream.found
    stream.run(GUARD_S - 1.0, added=lambda passed: 20.0)
    assert abs(stream.found(5.0) - before(5.0)) < 0.1


def test_what_is_doubted_teaches_nothing_and_nor_does_what_came_just_before() -> None:
    stream = Stream()
    stream.run(30.0)
    for _ in range(20):
        stream.run(GUARD_S - 0.5, added=lambda passed: 20.0)
        stream.calibrator.doubt()
    doubted = stream.found
    stream.run(60.0)
    assert abs(doubted(5.0) - 6.5) < 0.3
    assert abs(stream.errs(5.0)) < 0.15


@pytest.mark.parametrize("rate", [0.005, 0.05, 1.0])
def test_a_sensor_that_nobody_confirms_takes_its_substitute_nowhere(rate: float) -> None:
    stream = Stream()
    stream.run(3.0 * SETTLING_S)
    settled, calibrator = stream.found, stream.calibrator
    calibrator.confirmed = False
    assert not calibrator.keeps
    stream.run(300.0, added=lambda passed: rate * passed + 0.001 * passed * driving(passed))
    assert (stream.found.gain, stream.found.offset) == (settled.gain, settled.offset)
    assert calibrator.keeps and calibrator.pull > NOISE
    assert stream.found.error is not None and settled.error is not None
    assert stream.found.error.rms > settled.error.rms


def test_a_change_that_is_confirmed_is_followed_slowly() -> None:
    stream = Stream()
    stream.run(3.0 * SETTLING_S)
    usual = max(abs(stream.errs(derived)) for derived in (0.0, 5.0, 10.0))
    stream.run(120.0, added=lambda passed: 0.05 * passed)
    for derived in (0.0, 5.0, 10.0):
        bound = 120.0 / DRIFT_S * (1.1 * NOISE + GAIN_STEP * abs(derived - 5.0))
        assert abs(stream.errs(derived)) <= bound + usual + 0.05
    assert abs(stream.errs(5.0)) > 0.05
    assert not stream.calibrator.keeps


def test_a_relation_that_is_as_good_as_stated_takes_no_drift_for_an_offset() -> None:
    stream = Stream(gain=1.0, offset=0.0)
    stream.calibrator.confirmed = False
    stream.run(90.0, added=lambda passed: 0.005 * passed)
    assert (stream.found.gain, stream.found.offset) == (1.0, 0.0)


def test_two_that_are_pulled_the_same_way_do_not_confirm_each_other() -> None:
    drifting, steady = Stream(), Stream()
    assert not steady.calibrator.confirms(1.0)  # it knows too little
    for stream in (drifting, steady):
        stream.run(3.0 * SETTLING_S)
        stream.calibrator.confirmed = False
    drifting.run(60.0, added=lambda passed: 0.05 * passed)
    pull = drifting.calibrator.pull
    assert steady.calibrator.confirms(pull) and not drifting.calibrator.confirms(pull)
    assert drifting.calibrator.confirms(-pull)


def test_what_nobody_measures_grows_with_age_and_beyond_what_was_seen() -> None:
    stream = Stream()
    stream.run(60.0)
    calibrator = stream.calibrator
    variance = pvariance([driving(1000.0 + 0.1 * each) for each in range(550)])
    ages = [calibrator.aged(stream.now + hours * 3600.0) for hours in (0.0, 0.5, 1.0, 100.0)]
    assert ages == sorted(ages) and ages[0] < 0.01 * variance
    assert ages[-1] == pytest.approx(PRIOR_GAIN**2 * variance, rel=0.1)
    assert calibrator.beyond(driving(stream.now)) == 0.0
    near, far = (sqrt(calibrator.beyond(each)) / PRIOR_GAIN for each in (20.0, 30.0))
    assert far - near == pytest.approx(10.0)  # by a gain that nobody knows
    assert near == pytest.approx(15.0 - 3.0 * sqrt(6.5), abs=1.0)


@pytest.mark.parametrize("noise", [0.0, 0.05])
def test_a_robot_that_stands_tells_of_the_offset_alone(noise: float) -> None:
    random = Random(2)
    stream = Stream(1.2, 0.5, noise=0.02)
    stream.run(600.0, lambda time: 0.5 + random.gauss(0.0, noise))
    assert stream.found.gain == pytest.approx(1.0, abs=0.25)
    assert stream.found(0.5) == pytest.approx(1.1, abs=0.02)


def test_a_robot_that_stands_for_long_forgets_nothing_of_the_gain() -> None:
    random = Random(3)
    stream = Stream()
    stream.run(120.0)
    stream.run(2.0 * 3600.0, lambda time: 0.5 + random.gauss(0.0, 0.05))
    assert stream.found.gain == pytest.approx(1.2, abs=0.03)
    assert abs(stream.errs(10.0)) < 0.3


def test_a_robot_that_stood_first_learns_its_gain_once_it_moves() -> None:
    stream = Stream()
    stream.run(300.0, standing)
    stream.run(120.0)
    assert stream.found.gain == pytest.approx(1.2, abs=0.03)
    assert abs(stream.errs(10.0)) < 0.3


def test_a_relation_that_is_right_is_left_as_it_is_within_the_noise() -> None:
    stream = Stream(1.0, 0.0)
    stream.run(300.0)
    assert all(abs(stream.errs(derived)) < 0.2 * NOISE for derived in (0.0, 5.0, 10.0))


def test_a_calibration_that_makes_things_worse_is_not_used() -> None:
    """An offset that changes its sign whenever it is nearly learned."""
    stream = Stream(1.0, 0.0, noise=0.001)
    stream.run(900.0, standing, lambda passed: 1.5 * sin(2.0 * pi * passed / 60.0) + 0.001)
    assert (stream.found.gain, stream.found.offset) == (1.0, 0.0)
    assert stream.found.error is not None and stream.found.error.rms == pytest.approx(1.06, rel=0.1)


def test_what_is_no_number_is_no_sample() -> None:
    stream = Stream()
    stream.run(60.0)
    for measured, derived in ((nan, 1.0), (1.0, nan), (inf, 1.0), (1.0, -inf), (1e308, -1e308)):
        stream.now += 1.0
        stream.calibrator.take(stream.now, measured, derived)
    stream.run(60.0)
    assert abs(stream.errs(5.0)) < 0.1


def test_whole_numbers_may_be_states_and_are_left_as_they_are() -> None:
    calibrator = Calibrator()
    for step in range(1000):
        calibrator.take(step * PERIOD, float(step // 100 % 2), 0.9 * (step // 100 % 2) + 0.1)
    assert (calibrator.snapshot().gain, calibrator.snapshot().offset) == (1.0, 0.0)


def test_a_gap_is_not_time_that_was_seen() -> None:
    """An hour of silence forgets nothing, and settles nothing."""
    stream = Stream()
    stream.run(30.0)
    stream.now += 3600.0
    stream.run(30.0)
    assert abs(stream.errs(5.0)) < 0.15


def test_a_clock_that_was_set_back_does_no_harm() -> None:
    stream = Stream()
    stream.run(60.0)
    stream.now -= 1000.0
    stream.run(60.0)
    assert abs(stream.errs(5.0)) < 0.1


@pytest.mark.parametrize("zero", (2.42, pi, -3.1))
def test_an_angle_of_another_zero_has_an_offset_and_no_gain(zero: float) -> None:
    calibrator, random = Calibrator(angle=True), Random(1)
    for step in range(1500):
        turned = 0.03 * step  # seven times around
        measured = remainder(turned + zero + random.gauss(0.0, 0.01), tau)
        calibrator.take(0.1 * step, measured, remainder(turned, tau))
    found = calibrator.snapshot()
    assert found.gain == 1.0 and found.error is not None and found.error.rms < 0.03
    assert abs(remainder(found.offset - zero, tau)) < 0.02
