"""What the state of charge would have been without healing, and the figure that shows it."""
from pathlib import Path
from typing import Dict, List

import pytest

from shsa_rover.battery import BatteryParameters
from shsa_rover.figure import draw, substituted
from shsa_rover.recording import Recording, Series, last_error, unhealed

CURRENT_A = 6.0
LOST_S, BACK_S, END_S = 10.0, 24.0, 30.0
NODE, SUBSTITUTE = "/amperemeter", "/substitute_1"


def charge(seconds: float) -> float:
    """Return the share of the battery that the current takes in so many seconds."""
    return CURRENT_A * seconds / 3600.0 / BatteryParameters().capacity


def series(start: float, stop: float, step: float) -> List[float]:
    return [start + step * n for n in range(round((stop - start) / step) + 1)]


@pytest.fixture(name="recording")
def _recording() -> Recording:
    """A constant current, whose sensor is lost for 14 s and substituted after 0.1 s."""
    times = [*series(0.0, LOST_S, 0.02), *series(BACK_S, END_S, 0.02)]
    truth: Series = [(time, 0.8 - charge(time)) for time in series(0.0, END_S, 0.02)]
    incidents: List[Dict[str, object]] = [
        {"faulty_node": NODE, "last_good": LOST_S, "detected": 10.01, "first_message": 10.1}
    ]
    return Recording(
        {
            NODE: [(time, CURRENT_A) for time in times],
            SUBSTITUTE: [(time, CURRENT_A) for time in series(10.1, 23.98, 0.02)],
        },
        [(time, CURRENT_A) for time, _ in truth],
        [point for point in truth[::5]],
        truth,
        incidents,
    )


def test_without_healing_the_outage_is_not_counted(recording: Recording) -> None:
    alone = unhealed(recording, NODE)
    assert last_error(recording.soc, recording.true_soc) == pytest.approx(0.0, abs=1e-9)
    missed = charge(BACK_S - LOST_S - 2.0)  # the last current is held for 2 s
    assert last_error(alone, recording.true_soc) == pytest.approx(missed, rel=0.02)
    assert [time for time, _ in alone] == sorted(time for time, _ in alone)


def test_what_is_never_lost_is_the_same_without_healing(recording: Recording) -> None:
    recording.current[NODE] = [(time, CURRENT_A) for time in series(0.0, END_S, 0.02)]
    assert unhealed(recording, NODE) == recording.soc


def test_the_figure_marks_the_substitute(recording: Recording, tmp_path: Path) -> None:
    assert substituted(recording) == [(10.1, pytest.approx(23.98))]
    draw(recording, tmp_path / "figure.png")
    assert (tmp_path / "figure.png").stat().st_size > 10000
