"""What is learned of a healthy stream is not spoilt by a fault that was there for a moment."""
from random import Random
from typing import List

import pytest
from monitor_bench import NODE, PERIOD, Bench, message_checks, service

from shsa_core.model.checks import StaleStamp
from shsa_core.monitoring.events import ClockTicked


def connected() -> Bench:
    bench = Bench()
    bench.connect()
    return bench


# Values that stand still


@pytest.mark.parametrize("value, seconds", [(8.0, 0.9), (60.0, 30.0)])
def test_a_short_freeze_and_a_saturation_let_off_no_longer_freeze(
    value: float, seconds: float
) -> None:
    """Less than a second is not judged, nor is the limit of the range."""
    bench, random = connected(), Random(1)

    def stream(count: int) -> None:
        for _ in range(count):
            bench.stream(1, value=random.gauss(8.0, 1.0))

    stream(1000)
    bench.stream(round(seconds / PERIOD), value=value)
    stream(1000)
    assert bench.failures == []
    bench.stream(round(1.5 / PERIOD), value=8.0)
    assert bench.kinds() == [(NODE, "stuck")]


# Stamps


def test_one_old_message_among_the_first_excuses_no_later_one() -> None:
    """It was sent before our clock was set, or waited for somebody to connect."""
    bench = connected()
    for ahead in (1000.0, 1060.0):
        bench.send(ClockTicked(bench.now, ahead + bench.now))
        bench.stream(1, age=60.01)
        bench.stream(500, age=0.01)
    assert bench.failures == []
    bench.stream(3, age=20.0)
    assert bench.kinds() == [(NODE, "stale_stamp")]


@pytest.mark.parametrize("count, found", [(49, []), (50, [(NODE, "stale_stamp")])])
def test_fifty_stamps_tell_how_old_they_usually_are(count: int, found: List[object]) -> None:
    bench = connected()
    bench.wait(2.0)  # until it has no alibi that healing has just connected to it
    bench.stream(count, age=0.01)
    bench.stream(3, age=20.0)
    assert bench.kinds() == found


def test_a_clock_that_drifts_away_is_followed() -> None:
    """Seldom messages, for as many hours as it takes, may be 1.5 s older than usual."""
    bench = Bench(service(deadline=1000, checks=message_checks(StaleStamp(0.0))))
    bench.connect()
    for second in range(20_000):
        bench.stream(1, age=second * 100e-6, period=1.0)
    assert bench.failures == []


def test_a_latency_that_grows_as_of_a_queue_that_fills_is_found() -> None:
    bench = connected()
    for number in range(50 * 40):
        bench.stream(1, age=0.01 + number * 0.02 * PERIOD)
    assert bench.kinds() == [(NODE, "stale_stamp")]


@pytest.mark.parametrize("every", [12, 15])
def test_stamps_that_are_old_now_and_then_from_the_start_are_usual(every: int) -> None:
    bench = connected()
    for number in range(3000):
        bench.wait(PERIOD)
        bench.message(1.0 + 0.01 * (number * 7 % 5), age=0.6 if number % every == 3 else 0.0)
    assert bench.kinds() == []
