"""The monitor's core: events in, failures and changes out."""
from dataclasses import replace
from math import inf, nan
from typing import List

import pytest
from monitor_bench import (
    DEADLINE,
    NODE,
    PERIOD,
    SETTINGS,
    TOPIC,
    Bench,
    check_tables,
    row,
    service,
    table,
)

from shsa_core.model.som import Som
from shsa_core.monitoring.events import (
    Connected,
    Disconnected,
    Ending,
    Event,
    HealthChanged,
    Message,
    SomChanged,
    SubstitutionsChanged,
    Tick,
)
from shsa_core.monitoring.settings import Settings


@pytest.fixture
def bench() -> Bench:
    made = Bench()
    made.connect()
    made.stream(60)  # it is connected for longer than CHANGEOVER_S
    return made


def test_a_topic_is_unknown_until_its_first_good_message() -> None:
    bench = Bench()
    assert bench.state("") == "unknown"
    bench.connect()
    assert (bench.state(""), bench.state()) == (None, "unknown")
    bench.wait(1.0)
    bench.message()
    shown = table(bench.core)[0]
    assert (shown.state, shown.first_message, shown.last_good) == ("healthy", 101.0, 101.0)


def test_a_healthy_stream_stays_healthy(bench: Bench) -> None:
    before = len(bench.changes)
    bench.stream(1000)
    assert bench.failures == [] and len(bench.changes) == before


def test_a_lost_connection_is_a_failure_at_once(bench: Bench) -> None:
    last = bench.now
    bench.wait(0.001)
    bench.disconnect()
    failure = bench.failures[0]
    assert (failure.service, failure.topic) == ("current", TOPIC)
    assert (failure.publisher, failure.kind) == (NODE, "node_gone")
    assert (failure.last_good, failure.since) == (last, last + 0.001)
    assert bench.state() == "failed"


def test_who_may_only_be_cut_off_is_not_gone_before_that_is_certain(bench: Bench) -> None:
    """Its link may be down for long: then its connection ends, and its node lives."""
    cut_off = lambda: bench.send(Disconnected(bench.now, TOPIC, NODE, certain=False))
    cut_off()
    assert bench.failures == [] and bench.state() == "healthy"
    bench.wait(DEADLINE)
    assert bench.kinds() == [(NODE, "silent")]
    bench.wait(150.0)
    cut_off()
    assert bench.rows[TOPIC, NODE].kind == "silent"
    bench.connect()
    bench.stream(10)
    assert bench.state() == "healthy"
    bench.disconnect()
    assert bench.kinds()[1:] == [(NODE, "node_gone")]


def test_each_good_message_of_who_was_silent_is_told(bench: Bench) -> None:
    bench.wait(1.0)
    bench.stream(1)  # it may have been held up
    for _ in range(3):
        bench.stream(1)
        row = bench.rows[TOPIC, NODE]
        assert (row.state, row.kind, row.last_good) == ("failed", "silent", bench.now)
    assert len(bench.failures) == 1


def test_the_row_of_who_fails_tells_of_it(bench: Bench) -> None:
    (said,) = bench.send(Disconnected(bench.now, TOPIC, NODE))
    assert said == HealthChanged(bench.now, table(bench.core), (), table(bench.core))
    assert bench.failures == list(table(bench.core))


def test_silence_is_found_at_its_deadline_and_reported_once(bench: Bench) -> None:
    last = bench.now
    bench.wait(DEADLINE - 0.001)
    assert bench.failures == []
    bench.wait(5.0)
    assert bench.kinds() == [(NODE, "silent")]
    assert bench.failures[0].since == pytest.approx(last + DEADLINE)
    assert "0.100 s are allowed" in bench.failures[0].detail


def test_one_late_message_is_no_failure(bench: Bench) -> None:
    bench.wait(4.9 * PERIOD)
    bench.message()
    bench.stream(100)
    assert bench.failures == []


def test_fast_topics_have_the_minimum_deadline() -> None:
    bench = Bench(service(period=0.01))
    bench.connect()
    bench.stream(110, period=0.01)
    bench.wait(0.099)
    assert bench.failures == []
    bench.wait(0.002)
    assert bench.kinds() == [(NODE, "silent")]


def test_no_deadline_passes_without_a_tick_being_due(bench: Bench) -> None:
    assert bench.core.next_deadline <= bench.now + DEADLINE
    bench.wait(20.0)
    assert bench.core.next_deadline == inf


def test_a_lost_connection_after_silence_is_not_reported_again(bench: Bench) -> None:
    bench.wait(1.0)
    bench.disconnect()
    assert bench.kinds() == [(NODE, "silent")]
    assert [each.kind for each in table(bench.core)] == ["node_gone"]


def test_a_node_that_wakes_up_is_healthy_after_some_good_messages(bench: Bench) -> None:
    bench.wait(1.0)
    bench.stream(4)
    assert bench.state() == "failed"
    bench.stream(2)
    assert bench.state() == "healthy"
    bench.wait(1.0)
    assert bench.kinds() == [(NODE, "silent")] * 2


def test_a_silent_node_that_wakes_with_nonsense_is_reported_once_more(bench: Bench) -> None:
    bench.wait(1.0)
    bench.stream(10, value=float("nan"))
    assert bench.kinds() == [(NODE, "silent"), (NODE, "not_a_number")]
    assert [str(each.kind) for each in table(bench.core)] == ["not_a_number"]


def test_a_restarted_node_is_healthy_at_its_first_good_message(bench: Bench) -> None:
    bench.disconnect()
    bench.wait(1.0)
    bench.connect()
    assert bench.state() == "unknown"
    bench.message()
    shown = table(bench.core)[0]
    assert (shown.state, shown.first_message) == ("healthy", bench.now)


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
    for _ in range(20):
        bench.message(nan)
        bench.stream(19)
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
    assert bench.failures == [] and table(bench.core)[0].last_good == bench.now


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


def test_a_connected_node_that_never_published_is_blamed() -> None:
    bench = Bench()
    bench.connect("/other")
    bench.connect()
    bench.wait(16.0)
    assert bench.kinds() == [(NODE, "never_published")]


def test_another_process_of_the_same_name_begins_a_new_life() -> None:
    bench = Bench()
    for uri in ("http://127.0.0.1:1/", "http://127.0.0.1:2/"):
        bench.connect(uri=uri)
        assert bench.state() == "unknown"
        bench.stream(10)
        (row,) = [each for each in bench.rows.values() if each.publisher == NODE]
        assert row.uri == uri and row.state == "healthy"


def test_the_grace_counts_from_when_a_topic_is_watched() -> None:
    bench = Bench(settings=replace(SETTINGS, startup_grace=2.0))
    bench.wait(1.5)
    bench.message()
    bench.watch(service(), service(name="new", topic="/new"))
    bench.stream(110)
    assert bench.kinds() == [("", "never_published")]
    assert bench.failures[0].since == pytest.approx(103.5)


def test_a_topic_that_was_there_before_is_not_reported_as_never_published(bench: Bench) -> None:
    bench.disconnect()
    bench.wait(100.0)
    assert bench.kinds() == [(NODE, "node_gone")]


def test_a_node_that_left_before_it_published_is_no_failure() -> None:
    bench = Bench()
    bench.connect()
    bench.disconnect()
    assert bench.failures == [] and bench.state("") == "unknown"


def test_the_first_message_counts_before_the_table_says_that_it_publishes(bench: Bench) -> None:
    bench.substitutes(("/substitute_1", False))
    bench.connect("/substitute_1")
    bench.message(node="/substitute_1")
    first = bench.now
    bench.wait(0.001)
    bench.substitutes(("/substitute_1", True))
    shown = bench.rows[TOPIC, "/substitute_1"]
    assert (shown.state, shown.first_message) == ("healthy", first)


def test_gone_strangers_are_forgotten_once_somebody_is_healthy(bench: Bench) -> None:
    bench.connect("/rostopic_1")
    bench.message(node="/rostopic_1")
    bench.disconnect("/rostopic_1")
    assert bench.kinds() == [("/rostopic_1", "node_gone")]
    assert [each.publisher for each in table(bench.core)] == [NODE]


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


def test_topics_come_and_go(bench: Bench) -> None:
    other = service(name="odometry", topic="/odom", node="/drivetrain")
    bench.watch(service(), other)
    bench.stream(1)
    bench.watch(other)
    assert [(each.topic, each.state) for each in table(bench.core)] == [("/odom", "unknown")]
    bench.message()
    bench.disconnect()
    bench.wait(1.0)
    assert bench.failures == []


def test_messages_are_counted(bench: Bench) -> None:
    assert [[*each.publishers.values()] for each in bench.core.overview()] == [[60]]


def test_what_happens_on_topics_that_are_not_watched_is_ignored(bench: Bench) -> None:
    before = table(bench.core)
    bench.connect(topic="/elsewhere")
    bench.message(topic="/elsewhere")
    bench.disconnect(topic="/elsewhere")
    bench.disconnect("/who")
    bench.substitutes(("/substitute_1", True), topic="/elsewhere")
    bench.substitutes()
    assert table(bench.core) == before and bench.failures == []
    assert bench.core.service_of("/elsewhere", NODE) is None
    assert bench.core.service_of(TOPIC, NODE) == service()


def test_a_second_connection_of_a_known_publisher_changes_nothing(bench: Bench) -> None:
    before = table(bench.core)
    bench.connect()
    assert table(bench.core) == before


def test_a_tick_before_the_deadline_is_nothing(bench: Bench) -> None:
    bench.wait(0.01)
    assert bench.send(Tick(bench.now)) == []


def test_the_deadlines_come_from_the_settings() -> None:
    bench = Bench(settings=Settings(minimum_deadline=0.3))
    bench.connect()
    bench.stream(60)
    bench.wait(0.29)
    assert bench.failures == []
    bench.wait(0.02)
    assert bench.kinds() == [(NODE, "silent")]


def test_rows_of_substitutions_come_as_changes(bench: Bench) -> None:
    bench.send(SubstitutionsChanged(bench.now, (row("/substitute_1", False, TOPIC),)))
    bench.send(SubstitutionsChanged(bench.now, (row("/substitute_2", False, TOPIC),)))
    bench.connect("/substitute_1")
    bench.connect("/substitute_2")
    assert len(bench.muted()) == 2
    bench.send(SubstitutionsChanged(bench.now, (), removed=("/substitute_1", "/who")))
    bench.message(node="/substitute_1")
    bench.stream(100)
    assert bench.failures == [] and len(bench.muted()) == 2
    bench.send(SubstitutionsChanged(bench.now, (row("/substitute_1", True, TOPIC),)))
    bench.message(node="/substitute_1")
    bench.stream(100)
    assert bench.kinds() == [("/substitute_1", "silent")]


def test_when_the_launch_ends_nothing_is_reported_any_more(bench: Bench) -> None:
    assert bench.send(Ending(bench.now)) == []
    events: List[Event] = [
        Disconnected(bench.now, TOPIC, NODE),
        Connected(bench.now, TOPIC, "/other"),
        Tick(bench.now + 100.0),
        SomChanged(bench.now, Som()),
    ]
    for event in events:
        assert bench.core.handle(event) == []
    assert bench.core.next_deadline == inf


def test_a_row_that_did_not_change_changes_nothing(bench: Bench) -> None:
    bench.connect("/substitute_1")
    for _ in range(2):
        bench.substitutes(("/substitute_1", True))
        bench.message(node="/substitute_1")
    assert bench.state("/substitute_1") == "healthy"


def test_a_row_without_a_node_is_nobodys() -> None:
    bench = Bench()
    bench.substitutes(("", False))
    bench.wait(16.0)
    assert bench.kinds() == [("", "never_published")]


@pytest.mark.parametrize(
    "spoil, words",
    [
        (lambda topic, p: topic.publishers.clear(), "has no row"),
        (lambda topic, p: topic.services.clear(), "watched for no service"),
        (lambda topic, p: setattr(p, "kind", "stuck"), "without why"),
        (lambda topic, p: setattr(p, "connected", False), "gone, and healthy"),
        (lambda topic, p: setattr(p, "silent_since", 0.0), "nobody looks"),
        (lambda topic, p: setattr(p, "watched", replace(p.watched)), "of another topic"),
        (lambda topic, p: setattr(p, "name", ""), "is connected"),
    ],
)
def test_a_broken_invariant_is_named(bench: Bench, spoil: object, words: str) -> None:
    topic = bench.core._board.topics[TOPIC]
    spoil(topic, topic.publishers[NODE])  # type: ignore[operator]
    with pytest.raises(AssertionError, match=words):
        check_tables(bench.core)


def test_a_service_for_which_nobody_waits_is_an_error(bench: Bench) -> None:
    watched = bench.core._board.topics[TOPIC].services["current"]
    bench.wait(20.0)
    watched.due = bench.now + 1.0
    with pytest.raises(AssertionError, match="nobody waits for current"):
        check_tables(bench.core)
