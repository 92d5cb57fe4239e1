"""The monitor's core: events in, failures and tables out."""
from math import inf, nan

import pytest
from health_bench import DEADLINE, NODE, PERIOD, TOPIC, Bench, service

from shsa_core.monitoring.events import (
    Disconnected,
    FailureDetected,
    HealthChanged,
    Late,
    Message,
    SomChanged,
    Tick,
)
from shsa_core.monitoring.machine import Settings
from shsa_core.model.som import Som


@pytest.fixture
def bench() -> Bench:
    made = Bench()
    made.connect()
    made.stream(20)
    return made


def test_a_topic_is_unknown_until_its_first_good_message() -> None:
    bench = Bench()
    assert bench.state("") == "unknown"
    bench.connect()
    assert (bench.state(""), bench.state()) == (None, "unknown")
    bench.wait(1.0)
    bench.message()
    row = bench.core.table()[0]
    assert (row.state, row.first_message, row.last_good) == ("healthy", 101.0, 101.0)


def test_a_healthy_stream_stays_healthy(bench: Bench) -> None:
    before = len(bench.tables)
    bench.stream(1000)
    assert bench.failures == [] and len(bench.tables) == before


def test_a_lost_connection_is_a_failure_at_once(bench: Bench) -> None:
    last = bench.now
    bench.wait(0.001)
    bench.disconnect()
    failure = bench.failures[0]
    assert (failure.publisher, failure.kind) == (NODE, "node_gone")
    assert (failure.last_good, failure.time) == (last, last + 0.001)
    assert bench.state() == "failed"


def test_a_failure_is_reported_before_the_table_that_shows_it(bench: Bench) -> None:
    outputs = bench.core.handle(Disconnected(bench.now, TOPIC, NODE))
    assert [type(output) for output in outputs] == [FailureDetected, HealthChanged]
    assert outputs[1] == HealthChanged(bench.now, bench.core.table())


def test_silence_is_found_at_its_deadline_and_reported_once(bench: Bench) -> None:
    last = bench.now
    bench.wait(DEADLINE - 0.001)
    assert bench.failures == []
    bench.wait(5.0)
    assert bench.kinds() == [(NODE, "silent")]
    assert bench.failures[0].time == pytest.approx(last + DEADLINE)
    assert "0.100 s are allowed" in bench.failures[0].detail


def test_one_late_message_is_no_failure(bench: Bench) -> None:
    bench.wait(4.9 * PERIOD)
    bench.message()
    bench.stream(100)
    assert bench.failures == []


def test_fast_topics_have_the_minimum_deadline() -> None:
    bench = Bench(service(period=0.01))
    bench.connect()
    bench.message()
    bench.wait(0.099)
    assert bench.failures == []
    bench.wait(0.002)
    assert bench.kinds() == [(NODE, "silent")]


def test_no_deadline_passes_without_a_tick_being_due(bench: Bench) -> None:
    assert bench.core.next_deadline <= bench.now + DEADLINE
    bench.wait(1.0)
    assert bench.core.next_deadline == inf


def test_a_lost_connection_after_silence_is_not_reported_again(bench: Bench) -> None:
    bench.wait(1.0)
    bench.disconnect()
    assert bench.kinds() == [(NODE, "silent")]
    assert [row.kind for row in bench.core.table()] == ["node_gone"]


def test_a_node_that_wakes_up_is_healthy_after_some_good_messages(bench: Bench) -> None:
    bench.wait(1.0)
    bench.stream(4)
    assert bench.state() == "failed"
    bench.stream(2)
    assert bench.state() == "healthy"
    bench.wait(1.0)
    assert bench.kinds() == [(NODE, "silent")] * 2


def test_a_restarted_node_is_healthy_at_its_first_good_message(bench: Bench) -> None:
    bench.disconnect()
    bench.wait(1.0)
    bench.connect()
    assert bench.state() == "unknown"
    bench.message()
    row = bench.core.table()[0]
    assert (row.state, row.first_message) == ("healthy", bench.now)


@pytest.mark.parametrize(
    "value, kind",
    [
        (nan, "not_a_number"),
        (inf, "not_a_number"),
        (60.1, "out_of_range"),
        (-5.1, "out_of_range"),
    ],
)
def test_bad_values_make_a_failure_at_the_third(bench: Bench, value: float, kind: str) -> None:
    good = bench.now
    bench.stream(2, value=value)
    assert bench.failures == []
    bench.stream(5, value=value)
    assert bench.kinds() == [(NODE, kind)]
    assert bench.failures[0].last_good == good
    assert "battery_current is " in bench.failures[0].detail


@pytest.mark.parametrize("value", [-5.0, 60.0, 0.0])
def test_the_limits_are_in_the_range(bench: Bench, value: float) -> None:
    bench.stream(20, value=value)
    assert bench.failures == []


def test_single_bad_values_are_noise_and_every_third_is_not(bench: Bench) -> None:
    for _ in range(10):
        bench.message(nan)
        bench.stream(9)
    assert bench.failures == []
    for _ in range(4):
        bench.message(nan)
        bench.stream(2)
    assert bench.kinds() == [(NODE, "not_a_number")]


def test_a_publisher_recovers_from_bad_values(bench: Bench) -> None:
    bench.stream(3, value=99.0)
    bench.stream(4)
    bench.stream(1, value=99.0)
    bench.stream(4)
    assert bench.state() == "failed"
    bench.stream(1)
    assert bench.state() == "healthy"
    bench.stream(3, value=99.0)
    assert bench.kinds() == [(NODE, "out_of_range")] * 2


def test_a_message_that_cannot_be_decoded_is_bad(bench: Bench) -> None:
    for _ in range(3):
        bench.send(Message(bench.now, TOPIC, NODE, error="the message is not a Float64Stamped"))
    assert bench.kinds() == [(NODE, "not_a_number")]
    assert bench.failures[0].detail == "the message is not a Float64Stamped"


def test_values_that_were_not_decoded_are_not_judged(bench: Bench) -> None:
    for _ in range(5):
        bench.send(Message(bench.now, TOPIC, NODE))
    assert bench.failures == [] and bench.core.table()[0].last_good == bench.now


def test_blame_is_per_publisher(bench: Bench) -> None:
    bench.connect("/spoofer")
    for _ in range(20):
        bench.stream(1)
        bench.message(1000.0, "/spoofer")
    assert bench.kinds() == [("/spoofer", "out_of_range")]
    assert (bench.state(), bench.state("/spoofer")) == ("healthy", "failed")


def test_a_topic_that_never_came_up_fails_after_the_grace() -> None:
    bench = Bench()
    bench.wait(14.9)
    assert bench.failures == []
    bench.wait(20.0)
    assert bench.kinds() == [("", "never_published")]
    assert (bench.state(""), bench.failures[0].last_good) == ("failed", None)
    bench.connect()
    bench.message()
    assert (bench.state(""), bench.state()) == (None, "healthy")


def test_a_connected_node_that_never_spoke_is_blamed() -> None:
    bench = Bench()
    bench.connect("/other")
    bench.connect()
    bench.wait(16.0)
    assert bench.kinds() == [(NODE, "never_published")]


def test_a_topic_that_never_came_up_fails_beside_a_mute_substitute() -> None:
    bench = Bench()
    bench.substitutes(("/substitute_1", False))
    bench.connect("/substitute_1")
    bench.wait(16.0)
    assert bench.kinds() == [("", "never_published")]
    assert bench.state("/substitute_1") == "unknown"


def test_the_grace_counts_from_when_a_topic_is_watched() -> None:
    bench = Bench(settings=Settings(startup_grace=2.0))
    bench.wait(1.5)
    bench.message()
    bench.send(SomChanged(bench.now, Som([service(), service(topic="/new", property="new")])))
    bench.stream(110)
    assert bench.kinds() == [("", "never_published")]
    assert bench.failures[0].time == pytest.approx(103.5)


def test_a_topic_that_spoke_before_is_not_reported_as_never_published(bench: Bench) -> None:
    bench.disconnect()
    bench.wait(100.0)
    assert bench.kinds() == [(NODE, "node_gone")]


def test_a_node_that_left_before_it_spoke_is_no_failure() -> None:
    bench = Bench()
    bench.connect()
    bench.disconnect()
    assert bench.failures == [] and bench.state("") == "unknown"


def test_a_mute_substitute_is_never_silent(bench: Bench) -> None:
    bench.substitutes(("/substitute_1", False))
    bench.connect("/substitute_1")
    bench.stream(500)
    assert bench.failures == [] and bench.state("/substitute_1") == "unknown"
    assert bench.core.mute() == {(TOPIC, "/substitute_1")}
    bench.substitutes(("/substitute_1", True))
    assert bench.core.mute() == set()
    bench.substitutes(("/substitute_1", False))
    bench.disconnect("/substitute_1")
    assert bench.failures == [] and bench.state("/substitute_1") is None


def test_an_idle_process_that_advertised_a_topic_is_not_to_blame_for_it() -> None:
    bench = Bench()
    bench.substitutes(("/substitute_standby_1", False), topic="")
    bench.connect("/substitute_standby_1")
    bench.wait(16.0)
    assert bench.kinds() == [("", "never_published")]
    bench.substitutes(("/substitute_standby_1", True), topic="/elsewhere")
    bench.disconnect("/substitute_standby_1")
    assert bench.kinds() == [("", "never_published")]


def test_a_substitute_that_speaks_is_judged(bench: Bench) -> None:
    bench.disconnect()
    bench.connect("/substitute_1")
    bench.substitutes(("/substitute_1", True))
    bench.stream(50, "/substitute_1")
    bench.wait(1.0)
    assert bench.kinds() == [(NODE, "node_gone"), ("/substitute_1", "silent")]


def test_a_substitute_that_speaks_and_dies_has_failed(bench: Bench) -> None:
    bench.disconnect()
    bench.connect("/substitute_1")
    bench.substitutes(("/substitute_1", True))
    bench.stream(50, "/substitute_1")
    bench.disconnect("/substitute_1")
    assert bench.kinds() == [(NODE, "node_gone"), ("/substitute_1", "node_gone")]


def test_a_substitute_that_is_muted_on_purpose_has_not_failed(bench: Bench) -> None:
    bench.connect("/substitute_1")
    bench.substitutes(("/substitute_1", True))
    bench.stream(20, "/substitute_1")
    bench.substitutes(("/substitute_1", False))
    assert bench.state("/substitute_1") == "unknown"
    bench.message(node="/substitute_1")  # was under way
    bench.stream(100)
    assert bench.state("/substitute_1") == "unknown"
    assert bench.failures == [] or bench.kinds() == [(NODE, "silent")]


def test_a_muted_substitute_that_speaks_again_has_a_new_first_message(bench: Bench) -> None:
    bench.connect("/substitute_1")
    bench.message(node="/substitute_1")
    bench.substitutes(("/substitute_1", True))
    bench.substitutes(("/substitute_1", False))
    bench.wait(PERIOD)
    bench.message(node="/substitute_1")
    bench.substitutes(("/substitute_1", True))
    row = [row for row in bench.core.table() if row.publisher == "/substitute_1"][0]
    assert (row.state, row.first_message) == ("healthy", bench.now)


def test_the_first_message_counts_before_the_table_says_that_it_speaks(bench: Bench) -> None:
    bench.substitutes(("/substitute_1", False))
    bench.connect("/substitute_1")
    bench.message(node="/substitute_1")
    first = bench.now
    bench.wait(0.001)
    bench.substitutes(("/substitute_1", True))
    row = [row for row in bench.core.table() if row.publisher == "/substitute_1"][0]
    assert (row.state, row.first_message) == ("healthy", first)


def test_a_substitute_that_is_stopped_as_planned_has_not_failed(bench: Bench) -> None:
    bench.connect("/substitute_1")
    bench.substitutes(("/substitute_1", True))
    bench.message(node="/substitute_1")
    bench.substitutes()
    bench.stream(20)
    bench.disconnect("/substitute_1")
    assert bench.failures == [] and bench.state("/substitute_1") is None


def test_gone_strangers_are_forgotten_once_somebody_is_healthy(bench: Bench) -> None:
    bench.connect("/rostopic_1")
    bench.message(node="/rostopic_1")
    bench.disconnect("/rostopic_1")
    assert bench.kinds() == [("/rostopic_1", "node_gone")]
    assert [row.publisher for row in bench.core.table()] == [NODE]


def test_the_soms_node_stays_in_the_table_when_it_is_gone(bench: Bench) -> None:
    bench.disconnect()
    bench.connect("/substitute_1")
    bench.message(node="/substitute_1")
    assert (bench.state(), bench.state("/substitute_1")) == ("failed", "healthy")


def test_a_late_message_of_a_gone_publisher_changes_nothing(bench: Bench) -> None:
    bench.disconnect()
    bench.message()
    bench.wait(1.0)
    assert bench.state() == "failed" and bench.kinds() == [(NODE, "node_gone")]


def test_a_changed_period_counts_at_once(bench: Bench) -> None:
    bench.send(SomChanged(bench.now, Som([service(period=0.1)])))
    bench.wait(0.4)
    assert bench.failures == []
    bench.message()
    bench.send(SomChanged(bench.now, Som([service()])))
    bench.wait(DEADLINE)
    assert bench.kinds() == [(NODE, "silent")]


def test_a_changed_range_counts_at_once(bench: Bench) -> None:
    bench.send(SomChanged(bench.now, Som([service(range=(2.0, 3.0))])))
    bench.stream(3)
    assert bench.kinds() == [(NODE, "out_of_range")]


def test_topics_come_and_go(bench: Bench) -> None:
    other = service(topic="/odom", property="speed", node="/drivetrain")
    bench.send(SomChanged(bench.now, Som([other])))
    assert [(row.topic, row.state) for row in bench.core.table()] == [("/odom", "unknown")]
    bench.message()
    bench.disconnect()
    bench.wait(1.0)
    assert bench.failures == []


def test_a_late_monitor_grants_what_it_lost(bench: Bench) -> None:
    bench.now += DEADLINE + 0.05
    bench.send(Late(bench.now, 0.05))
    bench.send(Tick(bench.now))
    assert bench.failures == []
    assert bench.core.next_deadline == pytest.approx(bench.now + 0.05)
    bench.message()
    bench.stream(50)
    assert bench.failures == []


def test_a_monitor_that_is_always_late_still_finds_silence(bench: Bench) -> None:
    last = bench.now
    while not bench.failures and bench.now < last + 10.0:
        bench.now = bench.core.next_deadline + 0.03
        bench.send(Late(bench.now, 0.03))
        bench.send(Tick(bench.now))
    assert bench.now <= last + 2 * (DEADLINE + 0.03)


def test_a_hairs_breadth_of_lateness_is_not_granted(bench: Bench) -> None:
    bench.wait(DEADLINE - 1e-6)
    bench.now = bench.core.next_deadline + 0.001
    bench.send(Late(bench.now, 0.001))
    bench.send(Tick(bench.now))
    assert bench.kinds() == [(NODE, "silent")]


def test_messages_are_counted(bench: Bench) -> None:
    assert bench.core.messages() == {(TOPIC, NODE): 20}


def test_what_happens_on_topics_that_are_not_watched_is_ignored(bench: Bench) -> None:
    before = bench.core.table()
    bench.connect(topic="/elsewhere")
    bench.message(topic="/elsewhere")
    bench.disconnect(topic="/elsewhere")
    bench.disconnect("/who")
    bench.substitutes(("/substitute_1", True), topic="/elsewhere")
    bench.substitutes()
    assert bench.core.table() == before and bench.failures == []


def test_a_second_connection_of_a_known_publisher_changes_nothing(bench: Bench) -> None:
    before = bench.core.table()
    bench.connect()
    assert bench.core.table() == before


def test_a_tick_before_the_deadline_is_nothing(bench: Bench) -> None:
    bench.wait(0.01)
    assert bench.core.handle(Tick(bench.now)) == []
