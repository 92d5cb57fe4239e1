"""Whom a substitute tells of its topics, and how it yields them to the original."""
from dataclasses import replace
from typing import Any

import pytest
from substitute_driver import (
    DEADLINE,
    PERIOD,
    Driver,
    idle,
    only,
    row,
    running,
    served,
    signal,
    values,
)

from shsa_core.model.service import Signal
from shsa_core.model.substitution import CHANGEOVER_S, Substitution
from shsa_core.substitution import events
from shsa_core.substitution.machine import Substitute
from shsa_core.substitution.settings import WITHDRAW_DELAY_S

FLOAT = "std_msgs/Float64"
A, B = signal("/a"), signal("/b")


def looks(driver: Driver, until: float) -> list:
    """Return when subscribers were reminded."""
    driver.pass_to(until)
    return [round(time, 6) for time, command in driver.said if isinstance(command, events.Remind)]


def test_a_new_topic_is_announced_at_once_and_looked_after_in_pauses() -> None:
    driver = Driver(row())
    assert events.Advertise("/out", FLOAT) in [command for _, command in driver.said]
    driver.time = 1.0
    assert driver.ready() == [events.Remind(("/out",))]
    assert looks(driver, 60.0) == [1.0, 1.05, 1.15, 1.35, 1.75, 2.55, 4.15]


def test_an_idle_process_has_no_hurry() -> None:
    driver = Driver(idle(outputs=(A, B, signal("/a", field="x"))))
    assert [command for _, command in driver.said] == [
        events.Advertise("/a", FLOAT),
        events.Advertise("/b", FLOAT),
    ]
    assert driver.ready("/a") == [] and driver.ready("/b") == []
    assert looks(driver, 60.0) == [0.75, 1.55, 3.15]
    assert events.Remind(("/a", "/b")) in [command for _, command in driver.said]


def test_a_prepared_topic_is_not_advertised_again_but_looked_after() -> None:
    driver = Driver(idle(outputs=(A,)))
    driver.ready("/a")
    driver.time = 10.0
    assert driver.change(row(outputs=(A,))) == [
        events.Listen(signal("/in")),
        events.Compose("/a", FLOAT, (("data", None),)),
    ]
    assert looks(driver, 60.0)[-6:] == [10.05, 10.15, 10.35, 10.75, 11.55, 13.15]


def test_a_topic_that_is_wanted_while_it_is_being_advertised_is_announced() -> None:
    driver = Driver(idle(outputs=(A,)))
    driver.change(row(outputs=(A,)))
    assert driver.ready("/a") == [events.Remind(("/a",))]


def test_nothing_is_published_before_the_topic_is_advertised() -> None:
    driver = Driver(row(publishing=True))
    driver.stream(0.1)
    assert driver.published() == []
    driver.ready()
    driver.stream(0.14)
    assert len(driver.published()) == 2


def test_nobody_is_told_of_a_topic_that_was_taken_back() -> None:
    driver = running()
    driver.change(idle())
    driver.said.clear()
    assert driver.ready() == []
    assert looks(driver, 60.0) == []


def test_after_a_takeover_other_topics_are_withdrawn_with_a_delay() -> None:
    driver = Driver(idle(outputs=(A, B)))
    driver.ready("/a")
    driver.ready("/b")
    driver.change(row(publishing=True, outputs=(A,)))
    delay = WITHDRAW_DELAY_S
    assert only(driver.pass_to(delay - 0.001), events.Withdraw) == []
    assert only(driver.pass_to(delay), events.Withdraw) == [events.Withdraw("/b")]
    assert driver.core._advertising.topics == ("/a",)


def test_a_topic_that_is_wanted_again_is_not_withdrawn() -> None:
    driver = Driver(idle(outputs=(A, B)))
    driver.change(row(outputs=(A,)))
    driver.time = 0.1
    driver.change(row(outputs=(B,)))
    driver.pass_to(10.0)
    withdrawn = [c for _, c in driver.said if isinstance(c, events.Withdraw)]
    assert withdrawn == [events.Withdraw("/a")]


def test_an_idle_process_takes_topics_back_at_once() -> None:
    driver = Driver(idle(outputs=(A, B)))
    assert driver.change(idle(outputs=(B,))) == [events.Withdraw("/a")]


def standing_in(**of: Any) -> Driver:
    """A substitute that has just taken over from the node /node."""
    driver = running(original="/node", **of)
    driver.change(row(True, original="/node", outputs=driver.core.row.outputs))
    return driver


def test_it_looks_once_a_period_whom_the_original_serves() -> None:
    driver = standing_in()
    assert only(driver.pass_to(PERIOD / 2), events.LookAtOriginal) == []
    (look,) = only(driver.pass_to(PERIOD), events.LookAtOriginal)
    assert (look.topic, look.original) == ("/out", "/node")
    driver.stream(0.1)
    assert only([c for _, c in driver.said], events.LookAtOriginal) == [look]
    driver.tell(events.OriginalServes, look, None)
    assert len(only(driver.pass_to(0.1 + PERIOD), events.LookAtOriginal)) == 1


def test_it_looks_no_more_often_than_a_node_can_bear() -> None:
    fast = signal("/out", period=0.001)
    driver = running(outputs=(fast,), original="/node")
    driver.change(row(True, outputs=(fast,), original="/node"))
    assert only(driver.pass_to(0.0099), events.LookAtOriginal) == []
    assert len(only(driver.pass_to(0.0101), events.LookAtOriginal)) == 1


def test_it_yields_each_consumer_once_the_original_serves_it() -> None:
    driver = standing_in()
    driver.served(driver.pass_to(PERIOD), "/one")
    driver.arrive(1.0)
    looks = driver.pass_to(2 * PERIOD)
    assert served(driver.served(looks, "/one")) == [frozenset({"/one"})]
    driver.arrive(1.0)
    assert served(driver.served(driver.pass_to(3 * PERIOD))) == [frozenset()]


def test_a_joining_consumer_that_the_original_serves_is_left_to_it() -> None:
    driver = standing_in()
    driver.served(driver.pass_to(PERIOD), "/one")
    assert driver.tell(events.ConsumerJoined, "/out", "/one") == []
    assert len(values(driver.tell(events.ConsumerJoined, "/out", "/two"))) == 1


def test_muted_it_serves_the_others_for_a_while_and_looks_at_once() -> None:
    driver = standing_in()
    driver.stream(0.1)
    assert len(only([c for _, c in driver.said], events.LookAtOriginal)) == 1  # not answered
    driver.tell(events.OriginalServes, driver.said[0][1], None)  # not one of its looks
    (look,) = only([c for _, c in driver.said], events.LookAtOriginal)
    driver.tell(events.OriginalServes, look, None)
    (look,) = only(driver.change(row(False, original="/node")), events.LookAtOriginal)
    while driver.time < 0.1 + CHANGEOVER_S - PERIOD:
        driver.tell(events.OriginalServes, look, frozenset({"/one"}))
        driver.arrive(1.0)
        looked = only(driver.pass_to(round(driver.time + PERIOD, 9)), events.LookAtOriginal)
        look = looked[-1] if looked else look
    times = [time for time, _ in driver.published(0.1)]
    assert len(times) >= 47
    said = driver.said[-10:]
    assert set(served([c for _, c in said])) == {frozenset({"/one"})}
    driver.stream(3.0)
    assert driver.published(0.1 + CHANGEOVER_S) == []


def test_once_the_time_to_yield_is_over_nobody_looks_any_more() -> None:
    driver = standing_in()
    driver.served(driver.change(row(False, original="/node")))
    driver.pass_to(10.0)
    last = [time for time, c in driver.said if isinstance(c, events.LookAtOriginal)][-1]
    assert last < CHANGEOVER_S
    assert driver.core.next_deadline == float("inf")


def test_it_yields_to_nobody_where_no_original_is_named() -> None:
    driver = running(publishing=True)
    driver.stream(0.09)
    driver.change(row(False))
    driver.stream(0.5)
    assert driver.published(0.101) == []
    assert only([c for _, c in driver.said], events.LookAtOriginal) == []


def test_an_original_that_fails_again_serves_nobody() -> None:
    """Else its consumers would get nothing until the next look."""
    driver = standing_in()
    driver.served(driver.change(row(False, original="/node")), "/one")
    driver.time = 0.015
    driver.arrive(1.0)
    again = driver.change(row(True, original="/node"))
    assert served(again) == [frozenset()]


def test_an_answer_from_before_the_takeover_is_not_heeded() -> None:
    driver = standing_in()
    (look,) = only(driver.change(row(False, original="/node")), events.LookAtOriginal)
    driver.change(row(True, original="/node"))
    driver.tell(events.OriginalServes, look, frozenset({"/one"}))
    assert served(driver.pass_to(PERIOD)) == [frozenset()]


def test_it_follows_another_original() -> None:
    driver = standing_in()
    driver.served(driver.pass_to(PERIOD), "/one")
    driver.change(row(True, original="/other"))
    (look,) = only(driver.pass_to(2 * PERIOD), events.LookAtOriginal)
    assert look.original == "/other"
    assert served([c for _, c in driver.said])[-1] == frozenset()


def test_it_yields_to_whom_the_row_names_when_it_is_muted() -> None:
    driver = running(publishing=True)
    (look,) = only(driver.change(row(False, original="/node")), events.LookAtOriginal)
    assert look.original == "/node"
    assert values(driver.pass_to(PERIOD)) == []
    assert values(driver.tell(events.OriginalServes, look, None)) == [(1.0,)]


def test_it_yields_no_more_once_the_row_names_nobody_or_another_topic() -> None:
    for muted in (row(False), row(False, original="/node", outputs=(A,))):
        driver = standing_in()
        driver.change(row(False, original="/node"))
        driver.change(muted)
        driver.ready("/a")
        assert values(driver.pass_to(DEADLINE)) == []


@pytest.mark.parametrize("original", ["", "/node"])
def test_what_was_muted_before_does_not_yield(original: str) -> None:
    driver = running(original=original)
    driver.change(row(False, original="/other"))
    driver.stream(0.2)
    assert driver.published() == []


def test_what_an_idle_process_cannot_use_is_not_listened_to_when_other_plans_come() -> None:
    strange = Signal("/strange", "data", "no/Type", "", 0.1, 0.5)
    fine = Signal("/fine", "data", "std_msgs/Float64", "", 0.1, 0.5)
    out = Signal("/out", "data", "std_msgs/Float64", "", 0.1, 0.5)
    core = Substitute()
    row = Substitution("/s", "", (strange,), "", ())
    commands = core.handle(events.RowChanged(1.0, row, ((strange, "it is not built"),)))
    commands += core.handle(
        events.PlansChanged(2.0, (Substitution("", "a", (fine, strange), "", (out,)),), whole=True)
    )
    commands += core.handle(events.PlansChanged(3.0, (Substitution("", "b", (fine,), "", ()),)))
    listened = [each.signal for each in commands if isinstance(each, events.Listen)]
    assert listened == [fine]


def test_an_idle_process_leaves_the_topics_of_plans_that_are_gone() -> None:
    out = Signal("/out", "data", "std_msgs/Float64", "", 0.1, 0.5)
    core = Substitute()
    core.handle(events.RowChanged(1.0, Substitution("/s", "", (), "", ())))
    plan = Substitution("", "a", (), "", (out,))
    commands = core.handle(events.PlansChanged(2.0, (plan,), whole=True))
    assert events.Advertise("/out", "std_msgs/Float64") in commands
    core.handle(events.Advertised(2.1, "/out"))
    commands = core.handle(events.PlansChanged(3.0, (), removed=("a",)))
    assert events.Withdraw("/out") in commands
    commands = core.handle(events.PlansChanged(4.0, (plan,)))
    assert events.Advertise("/out", "std_msgs/Float64") in commands
    assert events.Withdraw("/out") in core.handle(events.PlansChanged(5.0, (), whole=True))


def test_plans_that_are_not_in_the_whole_table_are_prepared_for_no_more() -> None:
    driver = Driver(idle())
    plans = [replace(row(outputs=(each,)), node="", service=each.topic) for each in (A, B)]
    driver.tell(events.PlansChanged, tuple(plans), (), True)
    driver.ready("/a")
    driver.ready("/b")
    commands = driver.tell(events.PlansChanged, (plans[1],), (), True)
    assert only(commands, events.Withdraw) == [events.Withdraw("/a")]


def test_a_topic_that_was_prepared_keeps_its_type() -> None:
    driver = Driver(idle(outputs=(signal("/out"),)))
    commands = driver.change(row(outputs=(signal("/out", type="std_msgs/Int8"),)))
    (told,) = only(commands, events.Log)
    assert "it is a std_msgs/Float64 to this process" in told.text


def test_an_idle_process_prepares_for_the_plans_of_its_own_computer() -> None:
    here, there = (Signal(each, "data", "std_msgs/Float64", "", 0.1, 0.5) for each in ("/h", "/t"))
    core = Substitute()
    core.handle(events.RowChanged(1.0, Substitution("/s", "", (), "", (), host="pi")))
    plans = [Substitution("", each.topic, (), "", (each,), host="pi") for each in (here, there)]
    plans[1] = replace(plans[1], host="board")
    commands = core.handle(events.PlansChanged(2.0, tuple(plans), whole=True))
    advertised = [each.topic for each in commands if isinstance(each, events.Advertise)]
    assert advertised == ["/h"]
    core.handle(events.Advertised(2.1, "/h"))
    moved = replace(plans[0], host="board")
    assert events.Withdraw("/h") in core.handle(events.PlansChanged(3.0, (moved,)))
