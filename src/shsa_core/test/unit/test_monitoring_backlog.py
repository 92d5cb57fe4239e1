"""A link to another computer goes down and comes up again: what was sent meanwhile is no evidence.
"""
from dataclasses import replace
from typing import List, Optional

import pytest

from monitor_bench import check_tables, table
from shsa_core.model.health import PublisherState
from shsa_core.model.kinds import Kind
from shsa_core.model.service import Provision, Service
from shsa_core.model.som import Som
from shsa_core.monitoring.events import Command, Connected, Message, SomChanged, Tick
from shsa_core.monitoring.machine import Monitor
from shsa_testing.failures import failures_in

PERIOD = 0.02
SKEW = -0.7  # the other computer's clock is ahead


class Link:
    """A publisher on another computer, at 50 Hz."""

    def __init__(self, stamped: bool, deadline: Optional[float] = None) -> None:
        self.monitor, self.stamped = Monitor(), stamped
        provides = (Provision("x", "data"),)
        service = Service("x", "/x", "pkg/T", "/far", PERIOD, provides, needed=True)
        service = replace(service, deadline=deadline)
        self.said: List[Command] = list(self.monitor.handle(SomChanged(0.0, Som([service]))))
        self.feed(Connected(1.0, "/x", "/far"))
        self.number = 0

    def feed(self, event: object) -> None:
        self.said += self.monitor.handle(event)  # type: ignore[arg-type]
        check_tables(self.monitor)

    def hear(self, time: float, sent: Optional[float] = None) -> None:
        """A message comes that was sent at a time, now if none is given."""
        age = time - (time if sent is None else sent) + SKEW if self.stamped else None
        self.number += 1
        self.feed(Message(time, "/x", "/far", (float(self.number),), age=age))
        self.feed(Tick(time))

    def stream(self, begin: float, end: float) -> None:
        """Messages come as they are sent."""
        for number in range(round((end - begin) / PERIOD)):
            self.hear(begin + number * PERIOD)

    @property
    def failures(self) -> List[Optional[Kind]]:
        return [each.kind for each in failures_in(self.said)]

    @property
    def state(self) -> PublisherState:
        return table(self.monitor)[0].state


@pytest.mark.parametrize("stamped", [True, False])
@pytest.mark.parametrize("seconds", [2.0, 20.0])
def test_what_was_sent_while_a_link_was_down_is_neither_good_nor_bad(
    stamped: bool, seconds: float
) -> None:
    link = Link(stamped)
    link.stream(2.0, 5.0)
    for number in range(10):
        link.feed(Tick(5.0 + 0.1 * number))
    assert link.failures == [Kind.SILENT]
    up = 5.0 + seconds
    last_good = table(link.monitor)[0].last_good
    for number in range(round(seconds / PERIOD)):  # within a tenth of a second
        link.hear(up + 0.1 * number * PERIOD / seconds, 5.0 + number * PERIOD)
    assert link.failures == [Kind.SILENT] and link.state is PublisherState.FAILED
    assert table(link.monitor)[0].last_good == last_good
    link.stream(up + 0.12, up + 0.5)
    assert link.failures == [Kind.SILENT] and link.state is PublisherState.HEALTHY


@pytest.mark.parametrize("stamped", [True, False])
def test_a_silence_after_which_nothing_is_made_up_for_is_forgiven_as_ever(stamped: bool) -> None:
    link = Link(stamped)
    link.stream(2.0, 5.0)
    link.feed(Tick(6.0))
    link.stream(7.0, 7.2)
    assert link.failures == [Kind.SILENT] and link.state is PublisherState.HEALTHY


def test_a_burst_without_a_silence_is_still_a_failure() -> None:
    link = Link(True)
    link.stream(2.0, 5.0)
    for number in range(200):
        link.hear(5.0 + 0.001 * number)
    assert link.failures == [Kind.RATE_HIGH]


def test_messages_of_a_clock_set_back_in_a_silence_are_judged_and_not_held_for_ever() -> None:
    link = Link(True)
    link.stream(2.0, 5.0)
    for number in range(10):
        link.feed(Tick(5.0 + 0.1 * number))
    for number in range(150):  # 60 s too old by their stamps
        link.hear(6.0 + number * PERIOD, 6.0 + number * PERIOD - 60.0)
    assert table(link.monitor)[0].kind is Kind.STALE_STAMP


LONG_PERIODS = 200


@pytest.mark.parametrize("stamped", [True, False])
@pytest.mark.parametrize("pause", [0.3, 0.6, 1.5, 3.0])
@pytest.mark.parametrize("hiccup", [0.0, 0.6 * PERIOD])
def test_what_an_allowed_pause_held_up_comes_at_once(
    stamped: bool, pause: float, hiccup: float
) -> None:
    link, now = Link(stamped, LONG_PERIODS), 2.0
    for _ in range(3):
        link.stream(now, now + 5.0)
        now += 5.0
        for number in range(round(pause / PERIOD)):
            late = hiccup * (number // 10)
            link.hear(now + pause + 0.0005 * number + late, now + number * PERIOD)
        now += pause + 0.1
    assert link.failures == [] and link.state is PublisherState.HEALTHY


def test_what_comes_unevenly_after_a_failure_is_not_too_fast() -> None:
    link = Link(False)
    link.stream(2.0, 5.0)
    link.feed(Tick(6.0))
    for number in range(75):
        link.hear(6.5 + 0.0005 * number + 0.6 * PERIOD * (number // 10))
    link.stream(6.65, 8.0)
    assert link.failures == [Kind.SILENT] and link.state is PublisherState.HEALTHY


@pytest.mark.parametrize("pause", [0.0, 0.5, 3.0])
def test_what_is_more_than_a_silence_owes_is_too_fast(pause: float) -> None:
    link = Link(True, LONG_PERIODS)
    link.stream(2.0, 5.0)
    owed, number = round(pause / PERIOD), 0
    while not link.failures:
        link.hear(5.0 + pause + 0.001 * number)
        number += 1
    assert link.failures == [Kind.RATE_HIGH] and number <= owed + 40


def test_what_a_silence_owed_is_owed_no_longer_after_as_long() -> None:
    link = Link(True, LONG_PERIODS)
    link.stream(2.0, 5.0)
    link.stream(5.5, 6.1)
    for number in range(55):
        link.hear(6.1 + 0.001 * number)
    assert link.failures == [Kind.RATE_HIGH]


def test_a_pause_that_nothing_makes_up_for_is_a_low_rate() -> None:
    link = Link(True, LONG_PERIODS)
    link.stream(2.0, 5.0)
    link.stream(6.5, 8.0)
    assert link.failures == [Kind.RATE_LOW]


@pytest.mark.parametrize("rate", [90.0, 500.0])
def test_a_node_that_was_silent_for_long_is_too_fast_as_soon_as_any(rate: float) -> None:
    link = Link(stamped=True)
    link.stream(1.0, 5.0)
    link.feed(Tick(6.0))
    link.stream(65.0, 66.0)
    told = len(link.failures)
    for number in range(round(rate)):
        link.hear(66.0 + number / rate)
    assert link.failures[told:] == [Kind.RATE_HIGH]
