"""A second gate: it is muted while the first one is heard, and takes over from it."""
from dataclasses import replace

import pytest
from gate_stand import FIRST, GATED, HEARD, NS, PERIOD, SUBSTITUTE, Stand, overheard

from shsa_core.monitoring.events import Disconnected
from shsa_gate.events import Tick


@pytest.fixture
def second() -> Stand:
    stand = Stand(standby_for=FIRST)
    stand.substitute()
    for _ in range(10):
        stand.feed(overheard(stand.time, FIRST))
        stand.run(1)
    assert not stand.heard
    return stand


def test_a_second_gate_takes_over_after_two_periods_of_silence(second: Stand) -> None:
    died = second.time
    second.run(10)
    assert second.heard[0][0] - died <= 2.0 * PERIOD and len(second.heard) >= 8
    assert second.gap() <= 1.5 * PERIOD + 1e-9


def test_time_in_which_a_second_gate_was_not_scheduled_is_no_silence_of_the_first(
    second: Stand,
) -> None:
    second.time += 10 * PERIOD
    second.feed(Tick(second.time))
    assert not second.said
    second.run(4)
    assert second.heard and "is silent" in second.said[0]


def test_at_a_high_rate_a_second_gate_grants_the_first_what_a_busy_machine_costs() -> None:
    stand = Stand(replace(GATED, period=0.005), standby_for=FIRST)
    stand.feed(overheard(0.0, FIRST))
    stand.until(0.049)
    assert not stand.said
    stand.until(0.051)
    assert "is silent" in stand.said[0]


def test_a_second_gate_takes_over_at_once_when_the_first_is_gone(second: Stand) -> None:
    second.feed(Disconnected(second.time, HEARD, FIRST))
    second.run(10)
    assert len(second.heard) == 10


def test_a_second_gate_yields_at_the_first_word_of_the_first(second: Stand) -> None:
    second.run(10)
    heard = len(second.heard)
    second.feed(overheard(second.time, FIRST))
    second.message(1.0)
    second.until(second.time + PERIOD)
    assert len(second.heard) == heard


def test_a_stranger_does_not_mute_a_second_gate(second: Stand) -> None:
    for _ in range(10):
        second.feed(overheard(second.time, "/stranger"))
        second.run(1)
    assert len(second.heard) >= 8


def test_a_second_gate_goes_on_with_newer_stamps_than_those_of_the_first(second: Stand) -> None:
    second.feed(overheard(second.time, FIRST, 500 * NS))
    second.feed(Disconnected(second.time, HEARD, FIRST))
    second.until(second.time + PERIOD)
    (filled,) = second.message(2.0, SUBSTITUTE, stamp=500 * NS - 100)
    assert filled.stamp == 500 * NS + 1


def test_another_gate_that_leaves_changes_nothing(second: Stand) -> None:
    second.feed(Disconnected(second.time, HEARD, "/another_gate"))
    assert not second.said and not second.message(2.0, SUBSTITUTE)


def test_a_muted_gate_tells_nothing_of_what_the_first_one_tells(second: Stand) -> None:
    for _ in range(10):
        second.message(61.0)
        second.feed(overheard(second.time, FIRST))
        second.until(second.time + PERIOD)
    assert not second.said


def test_a_second_gate_waits_until_it_could_hear_the_first() -> None:
    stand = Stand(standby_for=FIRST)
    stand.run(50)
    assert not stand.heard
    stand.run(100)
    assert stand.heard
