"""The monitor's core: events in, failures and changes out."""
from dataclasses import replace
from math import inf, nan
from typing import Any, List

import pytest
from monitor_bench import (
    DEADLINE,
    NODE,
    PERIOD,
    SETTINGS,
    TOPIC,
    Bench,
    message_checks,
    provision,
    row,
    service,
)

from shsa_core.errors import ShsaError
from shsa_core.model.checks import UnknownPublisher
from shsa_core.model.som import Som
from shsa_core.monitoring.events import (
    Connected,
    Disconnected,
    Ending,
    Event,
    FailureDetected,
    HealthChanged,
    Message,
    SomChanged,
    SubstitutionsChanged,
    Tick,
)
from shsa_core.monitoring.publishers import Publisher
from shsa_core.monitoring.settings import Settings


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
    shown = bench.core.table()[0]
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
    assert (failure.last_good, failure.time) == (last, last + 0.001)
    assert bench.state() == "failed"


def test_a_failure_is_reported_before_the_table_that_shows_it(bench: Bench) -> None:
    said = bench.send(Disconnected(bench.now, TOPIC, NODE))
    assert [type(command) for command in said] == [FailureDetected, HealthChanged]
    assert said[1] == HealthChanged(bench.now, bench.core.table())


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
    bench.wait(20.0)
    assert bench.core.next_deadline == inf


def test_a_lost_connection_after_silence_is_not_reported_again(bench: Bench) -> None:
    bench.wait(1.0)
    bench.disconnect()
    assert bench.kinds() == [(NODE, "silent")]
    assert [each.kind for each in bench.core.table()] == ["node_gone"]


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
    shown = bench.core.table()[0]
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


def test_a_connected_node_that_never_published_is_blamed() -> None:
    bench = Bench()
    bench.connect("/other")
    bench.connect()
    bench.wait(16.0)
    assert bench.kinds() == [(NODE, "never_published")]


def test_a_topic_that_never_came_up_fails_beside_a_muted_substitute() -> None:
    bench = Bench()
    bench.substitutes(("/substitute_1", False))
    bench.connect("/substitute_1")
    bench.wait(16.0)
    assert bench.kinds() == [("", "never_published")]
    assert bench.state("/substitute_1") == "unknown"


def test_the_grace_counts_from_when_a_topic_is_watched() -> None:
    bench = Bench(settings=replace(SETTINGS, startup_grace=2.0))
    bench.wait(1.5)
    bench.message()
    bench.watch(service(), service(name="new", topic="/new"))
    bench.stream(110)
    assert bench.kinds() == [("", "never_published")]
    assert bench.failures[0].time == pytest.approx(103.5)


def test_a_topic_that_was_there_before_is_not_reported_as_never_published(bench: Bench) -> None:
    bench.disconnect()
    bench.wait(100.0)
    assert bench.kinds() == [(NODE, "node_gone")]


def test_a_node_that_left_before_it_published_is_no_failure() -> None:
    bench = Bench()
    bench.connect()
    bench.disconnect()
    assert bench.failures == [] and bench.state("") == "unknown"


def test_a_muted_substitute_is_never_silent(bench: Bench) -> None:
    bench.substitutes(("/substitute_1", False))
    bench.connect("/substitute_1")
    bench.stream(500)
    assert bench.failures == [] and bench.state("/substitute_1") == "unknown"
    assert bench.core.muted() == {(TOPIC, "/substitute_1")}
    bench.substitutes(("/substitute_1", True))
    assert bench.core.muted() == set()
    bench.substitutes(("/substitute_1", False))
    bench.disconnect("/substitute_1")
    assert bench.failures == [] and bench.state("/substitute_1") is None


def test_an_idle_process_that_advertised_a_topic_is_not_to_blame_for_it() -> None:
    bench = Bench()
    idle = row("/substitute_standby_1", False, TOPIC, "/elsewhere", service="")
    bench.send(SubstitutionsChanged(bench.now, (idle,)))
    bench.connect("/substitute_standby_1")
    bench.wait(16.0)
    assert bench.kinds() == [("", "never_published")]
    bench.substitutes(("/substitute_standby_1", True), topic="/elsewhere")
    bench.disconnect("/substitute_standby_1")
    assert bench.kinds() == [("", "never_published")]


def test_a_substitute_that_publishes_is_judged(bench: Bench) -> None:
    bench.disconnect()
    bench.connect("/substitute_1")
    bench.substitutes(("/substitute_1", True))
    bench.stream(50, "/substitute_1")
    bench.wait(1.0)
    assert bench.kinds() == [(NODE, "node_gone"), ("/substitute_1", "silent")]


def test_a_substitute_that_publishes_and_dies_has_failed(bench: Bench) -> None:
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


def test_a_muted_substitute_that_publishes_again_has_a_new_first_message(bench: Bench) -> None:
    bench.connect("/substitute_1")
    bench.message(node="/substitute_1")
    bench.substitutes(("/substitute_1", True))
    bench.substitutes(("/substitute_1", False))
    bench.wait(PERIOD)
    bench.message(node="/substitute_1")
    bench.substitutes(("/substitute_1", True))
    shown = bench.rows[TOPIC, "/substitute_1"]
    assert (shown.state, shown.first_message) == ("healthy", bench.now)


def test_the_first_message_counts_before_the_table_says_that_it_publishes(bench: Bench) -> None:
    bench.substitutes(("/substitute_1", False))
    bench.connect("/substitute_1")
    bench.message(node="/substitute_1")
    first = bench.now
    bench.wait(0.001)
    bench.substitutes(("/substitute_1", True))
    shown = bench.rows[TOPIC, "/substitute_1"]
    assert (shown.state, shown.first_message) == ("healthy", first)


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
    assert [each.publisher for each in bench.core.table()] == [NODE]


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
    bench.watch(service(period=0.1))
    bench.wait(0.4)
    assert bench.failures == []
    bench.message()
    bench.watch(service())
    bench.wait(DEADLINE)
    assert bench.kinds() == [(NODE, "silent")]


def test_a_changed_range_counts_at_once(bench: Bench) -> None:
    bench.watch(service(provision(range=(2.0, 3.0))))
    bench.stream(3)
    assert bench.kinds() == [(NODE, "out_of_range")]


def test_topics_come_and_go(bench: Bench) -> None:
    other = service(name="odometry", topic="/odom", node="/drivetrain")
    bench.watch(service(), other)
    bench.stream(1)
    bench.watch(other)
    assert [(each.topic, each.state) for each in bench.core.table()] == [("/odom", "unknown")]
    bench.message()
    bench.disconnect()
    bench.wait(1.0)
    assert bench.failures == []


def test_a_late_monitor_grants_what_it_lost(bench: Bench) -> None:
    bench.now += DEADLINE + 0.05
    bench.wake(0.05)
    assert bench.failures == []
    assert bench.core.next_deadline == pytest.approx(bench.now + 0.05)
    bench.message()
    bench.stream(50)
    assert bench.failures == []


def test_a_monitor_that_is_always_late_still_finds_silence(bench: Bench) -> None:
    last = bench.now
    while not bench.failures and bench.now < last + 10.0:
        bench.now = bench.core.next_deadline + 0.03
        bench.wake(0.03)
    assert bench.now <= last + 2 * (DEADLINE + 0.03)


def test_a_hairs_breadth_of_lateness_is_not_granted(bench: Bench) -> None:
    bench.wait(DEADLINE - 1e-6)
    bench.now = bench.core.next_deadline + 0.001
    bench.wake(0.001)
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
    assert bench.core.service_of("/elsewhere", NODE) is None
    assert bench.core.service_of(TOPIC, NODE) == service()


def test_a_second_connection_of_a_known_publisher_changes_nothing(bench: Bench) -> None:
    before = bench.core.table()
    bench.connect()
    assert bench.core.table() == before


def test_a_tick_before_the_deadline_is_nothing(bench: Bench) -> None:
    bench.wait(0.01)
    assert bench.send(Tick(bench.now)) == []


def two_drivers(**left: Any) -> Bench:
    """Two services on one topic: the arm at 50 Hz, the wheels at 10 Hz and with a narrow range."""
    narrow = provision(property="wheel", range=(0.0, 2.0))
    return Bench(
        service(name="arm", topic="/joint_states", node="/arm_driver", **left),
        service(narrow, name="wheels", topic="/joint_states", node="/wheel_driver", period=0.1),
    )


def both(bench: Bench, seconds: float, arm: float = 1.0, wheel: float = 1.0) -> None:
    """Both drivers publish, each at its period."""
    for step in range(round(seconds / PERIOD)):
        bench.stream(1, "/arm_driver", arm, "/joint_states")
        if step % 5 == 0:
            bench.message(wheel, "/wheel_driver", "/joint_states")


def told(bench: Bench) -> List[str]:
    return [f"{f.service} {f.publisher} {f.kind}" for f in bench.failures]


def test_two_services_on_one_topic_are_judged_by_their_own_values_and_rates() -> None:
    bench = two_drivers()
    both(bench, 5.0, arm=30.0)
    assert told(bench) == []
    both(bench, 1.0, arm=30.0, wheel=3.0)
    assert told(bench) == ["wheels /wheel_driver out_of_range"]


def test_two_services_on_one_topic_are_silent_by_their_own_deadlines() -> None:
    bench = two_drivers()
    both(bench, 1.0)
    bench.wait(0.2)
    assert told(bench) == ["arm /arm_driver silent"]
    bench.wait(0.4)
    assert told(bench) == ["arm /arm_driver silent", "wheels /wheel_driver silent"]


def test_a_service_that_never_came_up_is_missed_beside_another_one_on_its_topic() -> None:
    bench = two_drivers()
    bench.stream(800, "/arm_driver", topic="/joint_states")
    assert told(bench) == ["wheels  never_published"]
    assert bench.state("", "/joint_states") == "failed"
    bench.stream(1, "/arm_driver", topic="/joint_states")
    assert bench.state("", "/joint_states") == "failed"
    bench.connect("/wheel_driver", "/joint_states")
    assert bench.state("", "/joint_states") is None


def test_a_substitute_on_a_shared_topic_is_judged_as_the_service_that_it_replaces() -> None:
    bench = two_drivers()
    both(bench, 1.0)
    bench.connect("/substitute_1", "/joint_states")
    assert bench.core.service_of("/joint_states", "/substitute_1") is None
    taking_over = row("/substitute_1", True, "/joint_states", service="wheels")
    bench.send(SubstitutionsChanged(bench.now, (taking_over,)))
    for _ in range(5):
        bench.message(3.0, "/substitute_1", "/joint_states")
    assert told(bench) == ["wheels /substitute_1 out_of_range"]


def test_a_stranger_on_a_shared_topic_is_judged_by_nobodys_values() -> None:
    bench = two_drivers()
    bench.message(1e9, "/stranger", "/joint_states")
    bench.stream(100, "/stranger", 1e9, "/joint_states")
    assert told(bench) == [] and bench.state("/stranger", "/joint_states") == "healthy"
    bench.wait(1.0)
    bench.disconnect("/stranger", "/joint_states")
    assert told(bench) == [] and bench.state("", "/joint_states") == "unknown"


def test_a_stranger_on_a_shared_topic_that_intrudes_fails_and_may_be_named_later() -> None:
    once = message_checks(UnknownPublisher(0.5), recovery=2)
    bench = two_drivers(checks=once)
    for _ in range(60):
        bench.stream(1, "/arm_driver", topic="/joint_states")
        bench.message(node="/stranger", topic="/joint_states")
    assert told(bench) == [" /stranger unknown_publisher"]
    bench.disconnect("/arm_driver", "/joint_states")
    bench.disconnect("/wheel_driver", "/joint_states")
    substitute = row("/stranger", True, "/joint_states", service="arm")
    bench.send(SubstitutionsChanged(bench.now, (substitute,)))
    bench.stream(3, "/stranger", topic="/joint_states")
    assert bench.state("/stranger", "/joint_states") == "healthy"


def test_a_stranger_whom_no_service_knows_recovers_by_the_usual_count() -> None:
    bench = two_drivers()
    for _ in range(60):
        bench.stream(1, "/arm_driver", topic="/joint_states")
        bench.message(node="/idle", topic="/joint_states")
    assert told(bench)[0] == " /idle unknown_publisher"
    bench.send(SubstitutionsChanged(bench.now, (row("/idle", False, "/elsewhere", service=""),)))
    for _ in range(5):
        bench.message(node="/idle", topic="/joint_states")
    assert bench.state("/idle", "/joint_states") == "healthy"


def test_one_of_two_services_leaves_a_topic() -> None:
    bench = two_drivers()
    bench.wait(16.0)
    assert len(bench.failures) == 2
    bench.watch(service(name="arm", topic="/joint_states", node="/arm_driver"))
    assert [(each.publisher, each.state) for each in bench.core.table()] == [("", "unknown")]
    bench.connect("/stranger", "/joint_states")
    named = bench.core.service_of("/joint_states", "/stranger")
    assert named is not None and named.name == "arm"


EVENT_DRIVEN = service(period=None, name="button")


def test_an_event_driven_service_is_never_silent_nor_too_slow() -> None:
    bench = Bench(EVENT_DRIVEN)
    bench.connect()
    assert bench.state() == "healthy"
    bench.wait(1000.0)
    bench.message()
    bench.wait(1000.0)
    for _ in range(100):
        bench.message()
    assert bench.failures == [] and bench.core.next_deadline == inf


def test_an_event_driven_service_is_watched_for_its_connection_and_its_values() -> None:
    bench = Bench(EVENT_DRIVEN)
    bench.connect()
    bench.disconnect()
    bench.connect()
    bench.stream(3, value=nan, period=100.0)
    assert bench.kinds() == [(NODE, "node_gone"), (NODE, "not_a_number")]
    bench.stream(5, period=100.0)
    assert bench.state() == "healthy"


def test_an_event_driven_service_whose_node_never_connected_has_failed() -> None:
    bench = Bench(EVENT_DRIVEN)
    bench.wait(16.0)
    assert bench.kinds() == [("", "never_published")]
    assert bench.failures[0].detail == "no publisher in the first 15 s"
    bench.connect()
    assert (bench.state(""), bench.state()) == (None, "healthy")


def test_a_muted_substitute_does_not_make_an_event_driven_service_appear() -> None:
    bench = Bench(EVENT_DRIVEN)
    bench.substitutes(("/substitute_1", False))
    bench.connect("/substitute_1")
    bench.wait(16.0)
    assert bench.kinds() == [("", "never_published")]


def test_a_service_becomes_event_driven_and_periodic_again() -> None:
    bench = Bench()
    bench.connect()
    assert bench.state() == "unknown"
    bench.watch(service(period=None))
    assert bench.state() == "healthy"
    bench.wait(1000.0)
    bench.watch(service())
    assert (bench.state(), bench.failures) == ("unknown", [])
    bench.wait(1.0)
    bench.watch(service(period=None))
    bench.wait(1.0)
    bench.watch(service())
    bench.wait(14.0)
    assert bench.failures == []
    bench.wait(2.0)
    assert bench.kinds() == [(NODE, "never_published")]


def test_who_was_well_by_its_connection_alone_is_not_for_a_periodic_service() -> None:
    bench = Bench(service(period=None))
    bench.connect()
    assert bench.state() == "healthy"
    bench.watch(service(name="other", node="/other"))
    assert bench.state() == "unknown"


def test_the_deadlines_come_from_the_settings() -> None:
    bench = Bench(settings=Settings(deadline=10.0, minimum_deadline=0.3))
    bench.connect()
    bench.message()
    bench.wait(0.29)
    assert bench.failures == []
    bench.wait(0.02)
    assert bench.kinds() == [(NODE, "silent")]


def test_rows_of_substitutions_come_as_changes(bench: Bench) -> None:
    bench.send(SubstitutionsChanged(bench.now, (row("/substitute_1", False, TOPIC),)))
    bench.send(SubstitutionsChanged(bench.now, (row("/substitute_2", False, TOPIC),)))
    bench.connect("/substitute_1")
    bench.connect("/substitute_2")
    assert len(bench.core.muted()) == 2
    bench.send(SubstitutionsChanged(bench.now, (), removed=("/substitute_1", "/who")))
    bench.message(node="/substitute_1")
    bench.stream(100)
    assert bench.failures == [] and len(bench.core.muted()) == 2
    bench.send(SubstitutionsChanged(bench.now, (row("/substitute_1", True, TOPIC),)))
    bench.message(node="/substitute_1")
    bench.stream(100)
    assert bench.kinds() == [("/substitute_1", "silent")]


def test_a_retired_substitute_that_connects_again_is_a_stranger(bench: Bench) -> None:
    bench.connect("/substitute_1")
    bench.substitutes(("/substitute_1", True))
    bench.message(node="/substitute_1")
    bench.substitutes()
    bench.disconnect("/substitute_1")
    bench.connect("/substitute_1")
    for _ in range(60):
        bench.stream(1)
        bench.message(node="/substitute_1")
    assert bench.kinds() == [("/substitute_1", "unknown_publisher")]


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


def test_lateness_is_what_the_monitor_lost_between_wanting_to_wake_and_waking() -> None:
    assert Tick(9.0).late == Tick(9.0, 3.0).late == Tick(9.0, None, 3.0).late == 0.0
    assert Tick(9.0, 3.0, 2.0).late == 0.0
    assert Tick(9.0, 3.0, 3.5).late == 0.5


def test_the_lateness_of_one_turn_excuses_nobody_in_the_next(bench: Bench) -> None:
    bench.wait(0.5 * DEADLINE)
    bench.wake(10.0)
    bench.wait(DEADLINE)
    assert bench.kinds() == [(NODE, "silent")]


def many(count: int) -> Bench:
    """Many healthy topics."""
    bench = Bench(
        *(service(name=f"s{i}", topic=f"/t{i}", node=f"/n{i}", period=1.0) for i in range(count))
    )
    for i in range(count):
        bench.connect(f"/n{i}", f"/t{i}")
        bench.now += 0.001
        bench.message(node=f"/n{i}", topic=f"/t{i}")
    return bench


def test_a_tick_looks_at_those_that_are_due_and_a_message_at_its_publisher(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    bench = many(50)
    looked: List[str] = []
    real: Any = vars(Publisher)["deadline"].fget

    def counting(publisher: Publisher) -> float:
        looked.append(publisher.name)
        return float(real(publisher))

    monkeypatch.setattr(Publisher, "deadline", property(counting))
    core = bench.core
    core.handle(Message(bench.now, "/t7", "/n7", (1.0,)))
    core.handle(Tick(bench.now))
    assert len(looked) == 0
    first = core.next_deadline
    core.handle(Tick(first))
    assert set(looked) == {"/n0"} and len(looked) < 10
    del looked[:]
    core.handle(Disconnected(first, "/t5", "/n5"))
    assert len(looked) < 10


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


def test_only_what_changed_is_said() -> None:
    bench = many(50)
    said = bench.send(Disconnected(bench.now, "/t5", "/n5"))
    assert isinstance(said[1], HealthChanged)
    assert [each.key for each in said[1].rows] == [("/t5", "/n5")] and said[1].removed == ()
    bench.watch(
        *(service(name=f"s{i}", topic=f"/t{i}", node=f"/n{i}", period=1.0) for i in range(49))
    )
    assert bench.changes[-1].rows == () and bench.changes[-1].removed == (("/t49", "/n49"),)


@pytest.mark.parametrize(
    "spoil, words",
    [
        (lambda topic, p: topic.publishers.clear(), "has no row"),
        (lambda topic, p: topic.services.clear(), "watched for no service"),
        (lambda topic, p: setattr(p, "kind", "stuck"), "without why"),
        (lambda topic, p: setattr(p, "connected", False), "gone, and healthy"),
        (lambda topic, p: setattr(p, "last_message", 0.0), "nobody looks"),
        (lambda topic, p: setattr(p, "watched", replace(p.watched)), "of another topic"),
        (lambda topic, p: setattr(p, "name", ""), "is connected"),
    ],
)
def test_a_broken_invariant_is_named(bench: Bench, spoil: object, words: str) -> None:
    topic = bench.core._board.topics[TOPIC]
    spoil(topic, topic.publishers[NODE])  # type: ignore[operator]
    with pytest.raises(ShsaError, match=words):
        bench.core.validate()


def test_a_service_for_which_nobody_waits_is_an_error(bench: Bench) -> None:
    watched = bench.core._board.topics[TOPIC].services["current"]
    watched.published = False
    bench.wait(20.0)
    watched.published = watched.overdue = False
    with pytest.raises(ShsaError, match="nobody waits for current"):
        bench.core.validate()


def test_a_retired_substitute_that_is_not_there_is_an_error(bench: Bench) -> None:
    bench.core._board.substitutes.retired.add((TOPIC, "/nobody"))
    with pytest.raises(ShsaError, match="retired, but not there"):
        bench.core.validate()
