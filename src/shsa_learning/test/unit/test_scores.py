"""Figures of an error, of parts that have gaps, no output, or one sample."""
import math
from typing import Any

import numpy as np
import pytest

from shsa_learning.backtest.rehearsal import Played
from shsa_learning.backtest.scores import covered, delay_of, score

TIME = np.arange(0.0, 180.0, 0.1)
WAVE = np.sin(1.1 * TIME) + 0.4 * np.sin(2.9 * TIME)


def part(values: Any, measured: Any = WAVE, time: Any = TIME) -> Played:
    return Played(np.array(time), np.array(values), np.array(measured))


def nothing() -> np.ndarray:
    return np.full(len(TIME), math.nan)


def test_without_output_there_is_no_score() -> None:
    assert score([part(nothing())]) is None


def test_a_recording_without_output_counts_as_time_without_it() -> None:
    found = score([part(WAVE + 0.5), part(nothing())])
    assert found is not None
    assert found.share == 0.5 and found.error.rms == pytest.approx(0.5)
    assert found.worst.recording == 0
    assert found.charged == pytest.approx(math.sqrt(0.5 * 0.25 + 0.5 * np.var(WAVE)))


def test_where_nothing_was_measured_nothing_is_compared() -> None:
    measured = np.where(TIME < 90.0, WAVE, math.nan)
    found = score([part(WAVE + np.where(TIME < 90.0, 0.1, 99.0), measured)])
    assert found is not None
    assert found.error.n == 900 and found.share == 1.0
    assert found.error.rms == pytest.approx(0.1) and found.error.bias == pytest.approx(0.1)


@pytest.mark.parametrize("shift", [0, 3, -7, 15])
def test_a_delay_is_found_across_gaps(shift: int) -> None:
    late = np.roll(WAVE, shift) + 0.2 * np.random.RandomState(3).randn(len(WAVE))
    late[300:420] = math.nan
    found = delay_of([part(late[50:-50], WAVE[50:-50], TIME[50:-50])])
    assert found is not None
    assert found.seconds == pytest.approx(0.1 * shift, abs=1e-6)
    assert found.resolution == pytest.approx(0.1)


def test_what_is_later_than_is_looked_for_has_no_delay() -> None:
    slow = np.sin(0.2 * TIME)
    assert delay_of([part(np.sin(0.2 * (TIME - 5.0)), slow)]) is None


def test_one_sample_has_an_error_and_no_delay() -> None:
    found = score([part([1.5], [1.0], [0.0])])
    assert found is not None and found.resolution is None and found.nrmse is None
    assert found.error.rms == 0.5 and found.worst.rms == 0.5


def test_points_within_a_bound_are_counted() -> None:
    wrong = np.linspace(0.0, 1.0, len(WAVE))
    assert covered([part(WAVE + wrong)], 0.25) == pytest.approx(0.25, abs=0.001)


def test_the_worst_minute_is_that_of_any_recording() -> None:
    good = part(WAVE + 0.1)
    bad = part(WAVE + np.where((TIME >= 50.0) & (TIME < 110.0), 2.0, 0.0))
    found = score([good, bad])
    assert found is not None
    assert (found.worst.recording, found.worst.begin) == (1, pytest.approx(50.0))
    assert found.worst.rms == pytest.approx(2.0, rel=0.01)
