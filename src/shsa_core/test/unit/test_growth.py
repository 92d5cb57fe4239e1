"""An error that grows while nobody measures."""
import pytest

from shsa_core.model.error import Error
from shsa_core.model.calibration import PARTED, Growth

ERROR = Error(0.2, p95=0.4)
EXPECTED = 0.09
LOOK = 0.2


def looked(seconds: float, apart: float, beyond: float = 0.0) -> Growth:
    growth = Growth(5.0, 60.0)
    for number in range(round(seconds / LOOK)):
        growth.look(number * LOOK, beyond, (apart, EXPECTED))
    return growth


def test_what_agrees_as_well_as_expected_adds_nothing() -> None:
    growth = looked(60.0, (0.99 * PARTED * EXPECTED) ** 0.5)
    assert growth.added(ERROR, 0.0) == ERROR
    assert growth.added(ERROR, 0.05).rms == pytest.approx(0.3)


def test_a_difference_beyond_the_errors_is_taken_in_within_seconds() -> None:
    error = looked(10.0, 2.0).added(ERROR, 0.0)
    assert 1.5 < error.rms < 2.0
    assert error.p95 is not None and error.p95 == pytest.approx(1.96 * error.rms, rel=0.02)


def test_it_is_forgotten_slowly() -> None:
    growth = looked(20.0, 2.0)
    before = growth.added(ERROR, 0.0).rms
    for number in range(100, 300):
        growth.look(number * LOOK, 0.0, (0.0, EXPECTED))
    assert 0.6 * before < growth.added(ERROR, 0.0).rms < 0.95 * before


def test_what_is_beyond_what_was_seen_is_added_at_once() -> None:
    growth = Growth(5.0, 60.0)
    growth.look(0.0, 0.05, None)
    assert growth.added(ERROR, 0.0).rms == pytest.approx(0.3)
    assert growth.added(Error(0.2), 0.0).p95 == pytest.approx(1.96 * 0.3, rel=0.01)
