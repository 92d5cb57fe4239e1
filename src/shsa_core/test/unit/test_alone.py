"""An idle process takes over by itself while no reconfigurator is there."""
from dataclasses import replace
from typing import Any, List

from substitute_driver import DEADLINE, NAME, Driver, idle, only, row, signal

from shsa_core.substitution import events

PLAN = replace(row(), node="")
OTHER_PLAN = replace(row(outputs=(signal("/other"),)), node="", service="other")
PATIENCE = 0.5
IDLE = replace(idle(), bridge=PATIENCE)
LAST = b"the last good message"


class Left(Driver):
    """An idle process whose reconfigurator was heard last at the moment `heard`."""

    def __init__(self, heard: float, patience: float = PATIENCE) -> None:
        super().__init__(replace(IDLE, bridge=patience))
        self.heard = heard
        self.tell(events.PlansChanged, (PLAN, OTHER_PLAN), (), True)
        for topic in ("/out", "/other"):
            self.ready(topic)
        self.time = 10.0

    def gone(self, topic: str = "/out", kind: str = "node_gone") -> None:
        """The monitor tells that a node is gone, or fails otherwise."""
        self.tell(events.FailureHeard, topic, kind, LAST)

    def healer_heard(self) -> float:
        return self.heard

    def until(self, time: float) -> List[Any]:
        """Let time pass: what it takes over comes as its row."""
        said: List[Any] = []
        while self.time < time:
            self.arrive(1.0)
            now = self.pass_to(min(time, self.time + 0.02))
            while now:
                said += now
                rows = [self.change(each.row) for each in only(now, events.TakeOver)]
                now = [each for commands in rows for each in commands]
        return said


def test_it_takes_over_once_no_reconfigurator_gives_a_sign_of_life() -> None:
    process = Left(heard=9.97)
    process.gone()
    process.until(10.46)
    assert process.published() == []
    (taken,) = only(process.until(10.6), events.TakeOver)
    assert (taken.row.node, taken.row.service, taken.row.last_message) == (NAME, "out", LAST)
    assert len(process.published()) > 3


def test_it_takes_nothing_over_while_a_reconfigurator_gives_signs_of_life() -> None:
    process = Left(heard=10.0)
    process.gone()
    for tenth in range(101, 200):
        process.until(tenth / 10)
        process.heard = tenth / 10
    process.heard = 19.9
    assert not only(process.until(40.0), events.TakeOver)


def test_it_takes_nothing_over_from_a_node_that_fails_otherwise() -> None:
    process = Left(heard=9.97)
    process.gone(kind="silent")
    process.gone(kind="no word")
    assert not only(process.until(20.0), events.TakeOver)


def test_it_takes_over_where_the_reconfigurator_died_before_it_had_decided() -> None:
    process = Left(heard=10.01)
    process.gone()
    assert not only(process.until(10.5), events.TakeOver)
    assert only(process.until(10.55), events.TakeOver)


def test_the_second_one_leaves_a_topic_to_whom_it_hears() -> None:
    process = Left(heard=9.97, patience=2 * PATIENCE)
    process.gone()
    heeds = only(process.until(10.8), events.Overhear)
    assert {each.topic for each in heeds} == {"/out"}
    process.tell(events.OtherHeard, "/out", "/substitute_2")
    assert not only(process.until(20.0), events.TakeOver)


def test_the_second_one_takes_the_topic_that_the_first_leaves() -> None:
    process = Left(heard=9.97, patience=2 * PATIENCE)
    process.gone("/out")
    process.gone("/other")
    process.until(10.8)
    process.tell(events.OtherHeard, "/out", "/substitute_2")
    (taken,) = only(process.until(11.1), events.TakeOver)
    assert taken.row.service == "other"


def test_what_it_has_no_plan_for_is_left_alone() -> None:
    process = Left(heard=9.97)
    process.gone("/elsewhere")
    assert not only(process.until(20.0), events.TakeOver)


def test_one_that_is_told_no_silence_takes_nothing_over() -> None:
    process = Left(heard=9.97, patience=0.0)
    process.gone()
    assert not only(process.until(20.0), events.TakeOver)


def test_it_is_idle_again_once_the_node_is_back() -> None:
    process = Left(heard=9.97)
    process.gone()
    process.until(11.0)
    process.tell(events.OtherHeard, "/out", "/node")
    assert process.core.row == IDLE and not process.core.publishing
    process.ready("/other")
    process.gone("/out")
    assert only(process.until(12.0), events.TakeOver)


def test_of_two_that_take_the_same_topic_over_the_first_goes_on() -> None:
    process = Left(heard=9.97)
    process.gone()
    process.until(11.0)
    process.tell(events.OtherHeard, "/out", "/substitute_10")
    assert not process.core.row.idle and not process.core.publishing
    assert not process.published(11.0)
    process.until(11.0 + 2 * DEADLINE)
    assert process.core.publishing and process.published(11.0)
    process.tell(events.OtherHeard, "/out", "/substitute_0")
    assert process.core.row == IDLE


def test_a_reconfigurator_that_comes_back_does_not_mute_it() -> None:
    process = Left(heard=9.97)
    process.gone()
    process.until(11.0)
    process.change(IDLE)
    process.until(12.0)
    adopted = row(publishing=True)
    process.change(adopted)
    process.until(13.0)
    times = [time for time, _ in process.published(10.6)]
    assert max(after - before for before, after in zip(times, times[1:])) < 0.03
    process.tell(events.OtherHeard, "/out", "/node")  # it is the reconfigurator's from now on
    assert process.core.row == adopted


def test_its_own_row_gives_way_to_one_of_the_table() -> None:
    process = Left(heard=9.97)
    process.gone()
    (taken,) = only(process.pass_to(10.6), events.TakeOver)
    given = replace(row(outputs=(signal("/other"),)), service="other")
    process.change(given)
    process.change(taken.row)
    assert process.core.row == given
