"""Tests when a substitute publishes, and what it computes, in made-up time."""
import math
from dataclasses import replace
from typing import List

import pytest
from substitute_driver import (
    CODE,
    DEADLINE,
    IN,
    NAME,
    OUT,
    PERIOD,
    Driver,
    idle,
    only,
    row,
    running,
    signal,
    values,
)

from shsa_core.model.log import Level
from shsa_core.substitution import events
from shsa_core.substitution.settings import REST_S

DERIVATIVE = "t0=x[0];\ndef _tf1(i1): return derivative(i1)\nt1=_tf1(t0);\ny=t1"


def test_it_publishes_once_a_period_from_the_moment_its_inputs_are_there() -> None:
    driver = Driver(row(publishing=True))
    driver.ready()
    driver.pass_to(0.5)
    assert driver.published() == []
    driver.stream(0.56, 3.0)
    assert driver.published() == [(0.5, 3.0), (0.52, 3.0), (0.54, 3.0), (0.56, 3.0)]


def test_muted_it_computes_and_never_publishes() -> None:
    driver = running(publishing=False)
    driver.stream(0.99)
    assert driver.published() == []
    assert driver.core.next_deadline == pytest.approx(0.99 + REST_S, abs=REST_S)


def test_muted_it_rests_unless_its_program_remembers() -> None:
    for code, pause in ((CODE, REST_S), (DERIVATIVE, PERIOD)):
        driver = running(publishing=False, code=code)
        driver.stream(2.0)
        deadline = driver.core.next_deadline
        assert 2.0 < deadline <= 2.0 + pause
        driver.tell(events.RowChanged, row(True, code=code))
        driver.stream(2.2)
        times = [time for time, _ in driver.published()]
        assert times[0] == 2.0 and len(times) >= 10
        assert all(PERIOD - 1e-6 <= b - a for a, b in zip(times, times[1:]))


def test_behind_a_gate_it_publishes_always() -> None:
    driver = Driver(replace(row(), gated=True))
    driver.ready()
    driver.stream(0.1, 3.0)
    heard = [time for time, _ in driver.published()]
    driver.change(replace(row(publishing=True), gated=True))
    driver.stream(0.2, 3.0)
    driver.change(replace(row(), gated=True))
    driver.stream(0.3, 3.0)
    heard = [time for time, _ in driver.published()]
    assert len(heard) in (15, 16)
    assert max(b - a for a, b in zip(heard, heard[1:])) == pytest.approx(PERIOD)


def test_behind_a_gate_it_tells_of_an_unknown_start_only_while_it_stands_in() -> None:
    code = "t0=x[0];\ndef _tf1(i1): return integral(i1)\nt1=_tf1(t0);\ny=t1"
    driver = Driver(replace(row(code=code), gated=True))
    driver.ready()
    logs = lambda: [told for _, told in driver.said if isinstance(told, events.Log)]
    driver.stream(0.1)
    assert not logs()
    driver.change(replace(row(publishing=True, code=code), gated=True))
    driver.stream(0.2)
    assert len(logs()) == 1


def test_it_publishes_at_once_when_it_takes_over_and_goes_on_from_there() -> None:
    driver = running()
    driver.stream(0.1)
    driver.time = 0.113
    assert values(driver.change(row(publishing=True))) == [(1.0,)]
    driver.stream(0.15)
    assert [time for time, _ in driver.published()] == [0.113, 0.133, 0.153]


def test_a_row_that_says_the_same_again_changes_nothing() -> None:
    driver = running(publishing=True)
    driver.time = 0.01
    assert driver.change(row(publishing=True)) == []
    assert driver.core.next_deadline == PERIOD


def test_it_is_muted_at_once() -> None:
    driver = running(publishing=True)
    driver.time = 0.01
    driver.change(row(publishing=False))
    driver.stream(0.5)
    assert driver.published(since=0.01) == []


def test_the_order_to_publish_is_never_lost_while_an_input_is_missing() -> None:
    driver = Driver(row())
    driver.ready()
    driver.time = 1.0
    assert values(driver.change(row(publishing=True))) == []
    driver.pass_to(1.007)
    assert values(driver.arrive(2.0)) == [(2.0,)]


def test_while_an_input_is_stale_nothing_is_published_and_then_at_once() -> None:
    driver = running(publishing=True)
    driver.pass_to(DEADLINE)
    assert [time for time, _ in driver.published()][-1] == 0.24
    driver.pass_to(1.0)
    assert [time for time, _ in driver.published()][-1] == 0.24
    assert driver.core.next_deadline not in (0.26, 1.0)
    driver.time = 3.005
    assert values(driver.arrive(2.0)) == [(2.0,)]
    driver.pass_to(3.03)
    assert driver.published(3.0) == [(3.005, 2.0), (3.025, 2.0)]


def test_a_value_without_deadline_is_never_stale() -> None:
    constant = signal("/in", period=None, deadline=None)
    driver = running(publishing=True, inputs=(constant,))
    driver.pass_to(20.01)
    assert driver.published()[-1] == (20.0, 1.0)


def test_a_late_message_keeps_the_phase_and_a_very_late_one_sets_it_anew() -> None:
    driver = running(publishing=True)
    driver.time = 0.029
    assert values(driver.tell(events.Tick)) == [(1.0,)]
    assert driver.core.next_deadline == pytest.approx(0.04)
    driver.time = 0.095
    assert values(driver.tell(events.Tick)) == [(1.0,)]
    driver.stream(0.13)
    assert [time for time, _ in driver.published(0.096)] == [0.115, 0.135]


def test_an_event_driven_output_goes_out_when_an_input_comes_and_at_the_takeover() -> None:
    event = signal("/out", period=None, deadline=None)
    driver = running(outputs=(event,))
    driver.pass_to(10.0)
    assert driver.core.next_deadline == math.inf
    assert values(driver.arrive(2.0)) == []
    driver.time = 11.0
    assert values(driver.change(row(True, outputs=(event,)))) == []  # the input is stale
    driver.time = 12.0
    assert values(driver.arrive(3.0)) == [(3.0,)]
    assert values(driver.arrive(4.0)) == [(4.0,)]
    assert values(driver.arrive(5.0, topic="/other")) == []
    assert values(driver.pass_to(13.0)) == []
    driver.change(row(False, outputs=(event,)))
    assert values(driver.arrive(5.0)) == []
    assert values(driver.change(row(True, outputs=(event,)))) == [(5.0,)]


def test_a_joining_consumer_hears_the_newest_message_at_once_and_alone() -> None:
    driver = running(publishing=True)
    driver.time = 0.005
    (message,) = driver.tell(events.ConsumerJoined, "/out", "/consumer")
    assert (message.values, message.only) == ((1.0,), "/consumer")
    assert driver.core.next_deadline == PERIOD


@pytest.mark.parametrize("publishing, topic", [(False, "/out"), (True, "/other")])
def test_a_joining_consumer_hears_nothing_of_a_muted_one_or_on_another_topic(
    publishing: bool, topic: str
) -> None:
    driver = running(publishing)
    assert driver.tell(events.ConsumerJoined, topic, "/consumer") == []


def test_a_joining_consumer_of_a_topic_that_is_not_ready_waits() -> None:
    driver = Driver(row(publishing=True))
    driver.arrive(1.0)
    assert driver.tell(events.ConsumerJoined, "/out", "/consumer") == []


def test_a_joining_consumer_hears_nothing_stale_and_nothing_where_there_is_nothing() -> None:
    driver = Driver(row(publishing=True))
    driver.ready()
    assert only(driver.tell(events.ConsumerJoined, "/out", "/early"), events.Publish) == []
    driver.arrive(1.0)
    driver.pass_to(DEADLINE + 0.01)
    assert only(driver.tell(events.ConsumerJoined, "/out", "/late"), events.Publish) == []
    assert Driver(idle()).tell(events.ConsumerJoined, "/out", "/consumer") == []


def test_where_the_code_yields_nothing_nothing_is_published() -> None:
    driver = running(
        publishing=True, code="t0=x[0];\ndef _tf1(i1): return 1.0/i1\nt1=_tf1(t0);\ny=t1"
    )
    driver.arrive(0.0)
    assert values(driver.pass_to(PERIOD)) == []
    driver.arrive(2.0)
    assert values(driver.pass_to(2 * PERIOD)) == [(0.5,)]


HOLDS = "t0=x[0];\ndef _tf1(i1): return sqrt(5.0-i1)\nt1=_tf1(t0);\ny=t1"


def told(driver: Driver, value: float, steps: int) -> List[float]:
    """Return when the substitute says that it has no value, while its input has this value."""
    said = []
    for _ in range(steps):
        driver.arrive(value)
        commands = driver.pass_to(driver.time + PERIOD)
        said += [driver.time for each in only(commands, events.TellNoValue)]
    return said


@pytest.mark.parametrize("publishing", (True, False))
def test_a_law_that_does_not_hold_any_more_is_told_at_the_second_miss_and_once(
    publishing: bool,
) -> None:
    driver = running(publishing=publishing, code=HOLDS)
    pace = 1 if publishing else math.ceil(REST_S / PERIOD)
    assert told(driver, 1.0, 5 * pace) == []
    assert told(driver, 7.0, 1) == []
    assert len(told(driver, 7.0, 50)) == 1
    assert told(driver, 1.0, 5 * pace) == []
    assert len(told(driver, 7.0, 3 * pace)) == 1


def test_a_law_that_never_held_is_told_later_as_filters_need_a_few_samples() -> None:
    driver = running(publishing=True, code=HOLDS.replace("5.0-i1", "i1-5.0"))
    assert told(driver, 1.0, 8) == []
    assert len(told(driver, 1.0, 2)) == 1


def test_a_program_is_not_evaluated_twice_in_close_succession() -> None:
    """A derivative over a millisecond would be a wild one."""
    driver = running(code=DERIVATIVE)
    for number in range(1, 6):
        driver.arrive(number * 0.1)
        driver.pass_to(round(number * PERIOD, 9))
    driver.arrive(0.6)
    driver.time += 0.001
    ((slope,),) = values(driver.change(row(publishing=True, code=DERIVATIVE)))
    assert slope == pytest.approx(5.0)
    ((slope,),) = values(driver.pass_to(driver.time + PERIOD))
    assert slope == pytest.approx(5.0)


def test_what_a_program_remembers_outlasts_a_change_of_numbers() -> None:
    driver = running(publishing=True, code=DERIVATIVE)
    driver.pass_to(0.01)
    driver.arrive(1.2)
    driver.pass_to(PERIOD)
    slower = row(True, (signal("/in", deadline=9.0),), DERIVATIVE, (signal("/out", period=0.1),))
    assert driver.change(slower) == []
    driver.arrive(2.2)
    driver.pass_to(0.21)
    assert [time for time, _ in driver.published()] == [0.02, 0.04, 0.14]


def test_two_services_of_a_topic_are_told_apart() -> None:
    left, right = signal("/joint", node="/left"), signal("/joint", node="/right")
    code = "t0=x[0]; t1=x[1];\ndef _tf1(i1,i2): return i1-i2\nt2=_tf1(t0,t1);\ny=t2"
    driver = Driver(row(True, (left, right), code))
    driver.ready()
    driver.arrive(5.0, "/joint", "/left")
    assert driver.published() == []
    driver.arrive(7.0, "/joint", "/stranger")
    assert driver.published() == []
    assert values(driver.arrive(3.0, "/joint", "/right")) == [(2.0,)]


def test_another_program_takes_the_place_of_the_old_one_in_phase() -> None:
    driver = running(publishing=True)
    driver.tell(events.InputArrived, "/spare", "/other", (("data", 9.0),))
    driver.time = 0.01
    spare = row(True, (signal("/spare"),))
    (listen, *_) = driver.change(spare)
    assert listen == events.Listen(signal("/spare"))
    driver.arrive(9.0, "/spare")
    assert values(driver.pass_to(0.04)) == [(9.0,), (9.0,)]
    driver.change(row(True))
    assert values(driver.pass_to(0.06)) == [(1.0,)]  # what was listened to once stays so


def test_a_program_for_another_topic_starts_at_once() -> None:
    driver = running(publishing=True)
    other = row(True, outputs=(signal("/other", period=0.5),))
    driver.time = 0.003
    driver.change(other)
    driver.stream(0.1)
    assert driver.published(0.003) == []  # not before it is advertised
    driver.ready("/other")
    driver.stream(1.1)
    assert [time for time, _ in driver.published(0.003)] == [0.503, 1.003]


@pytest.mark.parametrize(
    "bad, problem",
    [
        (row(code="y=__import__('os')"), "y=__import__"),
        (row(outputs=(OUT, signal("/third"))), "fields of one topic, not of /out, /third"),
        (row(outputs=()), "not of none"),
        (row(inputs=(signal("/in", type="std_msgs/Int32"),)), "/in/data: it is a std_msgs/Float64"),
    ],
)
def test_a_program_that_is_not_valid_is_refused_once_and_the_old_one_goes_on(
    bad: events.Substitution, problem: str
) -> None:
    driver = running()
    (log,) = driver.change(bad)
    assert log.level == Level.ERROR and log.text.startswith("refuses its program: ")
    assert problem in log.text or "__import__" in problem
    assert driver.change(bad) == []
    driver.time = 0.001
    assert values(driver.change(row(publishing=True))) == [(1.0,)]


def test_a_refused_program_for_the_same_topic_leaves_the_old_one_publishing() -> None:
    driver = running(publishing=True)
    driver.change(row(True, code="nonsense"))
    assert values(driver.pass_to(PERIOD)) == [(1.0,)]


def test_a_refused_program_for_another_topic_mutes_the_old_one() -> None:
    driver = running(publishing=True)
    driver.change(row(True, code="nonsense", outputs=(signal("/other"),)))
    assert values(driver.pass_to(DEADLINE)) == []


def test_a_refused_program_for_another_topic_yields_nothing_to_its_original() -> None:
    driver = running(publishing=True)
    driver.change(row(True, code="nonsense", outputs=(signal("/other"),), original="/node"))
    assert values(driver.pass_to(DEADLINE)) == []


def test_a_type_that_is_not_known_here_is_refused_with_its_name() -> None:
    driver = running()
    strange = signal("/strange", type="no_such/Type")
    (log,) = driver.change(row(inputs=(strange,)), ((strange, "no_such is not built"),))
    assert log.text == "refuses its program: /strange/data: no_such is not built"


def test_an_idle_process_prepares_for_what_it_can_and_names_the_rest() -> None:
    strange = signal("/strange", type="no_such/Type")
    driver = Driver(idle())
    said = driver.change(idle((IN, strange), (OUT, strange)), ((strange, "no_such is not built"),))
    assert said == [
        events.Log(Level.WARN, "does not prepare for /strange/data: no_such is not built"),
        events.Listen(IN),
        events.Advertise("/out", "std_msgs/Float64"),
    ]
    driver.ready()
    driver.arrive(4.0)
    assert values(driver.change(row(publishing=True))) == [(4.0,)]  # it hurts nobody else


def test_a_process_that_is_idle_again_publishes_nothing() -> None:
    driver = running(publishing=True, original="/node")
    driver.change(idle((IN,), (OUT,)))
    driver.stream(1.0)
    assert driver.published(0.001) == []


def test_a_substitute_that_cannot_do_what_it_was_started_for_gives_up() -> None:
    (command,) = [command for _, command in Driver(row(code="nonsense")).said]
    assert isinstance(command, events.GiveUp) and "refuses its program" in command.reason


def test_without_a_row_it_goes_on_as_told_last() -> None:
    driver = running(publishing=True)
    assert driver.tell(events.RowRemoved) == []
    assert values(driver.pass_to(PERIOD)) == [(1.0,)]


def test_time_never_goes_back() -> None:
    """Events come from several threads, and each was stamped in its own."""
    driver = running(publishing=True)
    driver.pass_to(0.1)
    driver.time = 0.099
    driver.arrive(2.0)
    driver.tell(events.Tick)
    assert driver.core.next_deadline == pytest.approx(0.12)


def test_messages_come_before_all_other_work() -> None:
    driver = running(original="/node")
    driver.pass_to(0.05)
    driver.arrive(1.0)
    first, *others = driver.change(row(publishing=True, original="/node"))
    assert isinstance(first, events.Publish) and only(others, events.Publish) == []


def test_an_equal_story_is_told_with_equal_commands() -> None:
    stories = []
    for _ in range(2):
        driver = running(publishing=True, code=DERIVATIVE, original="/node")
        driver.stream(0.3)
        driver.change(row(False, code=CODE, original="/node"))
        driver.stream(2.0)
        stories.append(driver.said)
    assert stories[0] == stories[1]
    assert NAME == driver.core.row.node


def test_who_stands_by_for_nobody_ends_and_who_publishes_goes_on() -> None:
    assert only(Driver(idle()).tell(events.ReachChanged, False, True), events.GiveUp)
    assert only(running().tell(events.ReachChanged, False, True), events.GiveUp)
    assert running(publishing=True).tell(events.ReachChanged, False, True) == []
    by_hand = Driver(replace(row(), service=""))
    assert not only(by_hand.tell(events.ReachChanged, False, True), events.GiveUp)
