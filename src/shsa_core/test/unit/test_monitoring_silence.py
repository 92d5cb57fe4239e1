"""Whose silence is a failure, and who has an alibi."""
from math import nan
from typing import Any, Dict, Iterable, List, Optional, Tuple

import pytest
from monitor_bench import DEADLINE, NODE, PERIOD, TOPIC, Bench, service, streaming, table

from shsa_core.model.kinds import Kind
from shsa_core.model.service import Service
from shsa_core.model.substitution import CHANGEOVER_S
from shsa_core.monitoring.alibis import ROWS, Case, Row, decide
from shsa_core.monitoring.events import ClockTicked, Disconnected
from shsa_core.monitoring.settings import RECONNECT_S, Settings

NODES = ("/one", "/two", "/three", "/four")
KINDS = (None, *Kind)


def robot(nodes: Iterable[str] = NODES, *more: Service) -> Bench:
    """A node for each topic, all healthy and connected for long."""
    bench = Bench(*(service(name=node[1:], topic=node, node=node) for node in nodes), *more)
    for node in nodes:
        bench.connect(node, node)
    stream(bench, nodes, 1.2)
    return bench


def stream(bench: Bench, nodes: Iterable[str], seconds: float) -> None:
    for _ in range(round(seconds / PERIOD)):
        bench.wait(PERIOD)
        for node in nodes:
            bench.message(node=node, topic=node)


@pytest.fixture
def bench() -> Bench:
    return streaming()


def test_all_that_fall_silent_together_and_come_back_are_not_blamed() -> None:
    bench = robot()
    bench.wait(1.7 * DEADLINE)
    stream(bench, NODES, 1.0)
    assert bench.failures == []


def test_a_node_that_babbles_after_a_silence_that_was_excused_is_found() -> None:
    bench = robot()
    bench.wait(1.5 * DEADLINE)
    for number in range(60):
        bench.wait(PERIOD / 3)
        bench.message(nan, NODES[0], NODES[0])
        if number % 3 == 0:
            for node in NODES[1:]:
                bench.message(node=node, topic=node)
    assert bench.kinds() == [(NODES[0], "not_a_number")]


def test_three_nodes_that_fall_silent_within_half_a_deadline_are_not_blamed() -> None:
    bench = robot()
    stream(bench, NODES[1:], 0.4 * DEADLINE)
    bench.wait(1.3 * DEADLINE)
    stream(bench, NODES, 1.0)
    assert bench.failures == []


def test_all_that_hang_together_are_found_after_one_more_deadline() -> None:
    bench = robot()
    last = bench.now
    bench.wait(1.0)
    assert sorted(bench.kinds()) == sorted((node, "silent") for node in NODES)
    for failure in bench.failures:
        assert failure.since == pytest.approx(last + 2 * DEADLINE)


@pytest.mark.parametrize("hung", [1, 2])
def test_one_or_two_that_hang_are_found_at_the_deadline(hung: int) -> None:
    bench = robot()
    last = bench.now
    stream(bench, NODES[hung:], 1.0)
    assert bench.kinds() == [(node, "silent") for node in NODES[:hung]]
    for failure in bench.failures:
        assert failure.since == pytest.approx(last + DEADLINE)


def test_that_others_are_late_for_less_than_half_of_its_silence_is_no_alibi() -> None:
    bench = robot()
    last = bench.now
    stream(bench, NODES[1:], 0.6 * DEADLINE)
    bench.wait(0.5 * DEADLINE)
    stream(bench, NODES[1:], 0.2)
    (failure,) = bench.failures
    assert failure.since == pytest.approx(last + DEADLINE)


def test_nodes_that_hang_one_after_the_other_are_each_found_at_the_deadline() -> None:
    bench = robot()
    last = bench.now
    for number in range(1, 4):
        stream(bench, NODES[number:], 0.1)
    stream(bench, NODES[3:], 1.0)
    times = [failure.since for failure in bench.failures]
    assert times == pytest.approx([last + DEADLINE, last + 0.1 + DEADLINE, last + 0.2 + DEADLINE])


def test_the_topics_of_one_node_are_one_node() -> None:
    bench = Bench(*(service(name=f"s{n}", topic=f"/{n}", node=NODE) for n in range(5)))
    topics = [f"/{n}" for n in range(5)]
    for topic in topics:
        bench.connect(NODE, topic)
    for _ in range(60):
        bench.wait(PERIOD)
        for topic in topics:
            bench.message(topic=topic)
    last = bench.now
    bench.wait(DEADLINE + 0.001)
    assert bench.kinds() == [(NODE, "silent")] * 5
    assert bench.failures[0].since == pytest.approx(last + DEADLINE)


def slow_stream(bench: Bench, slow: Iterable[str], seconds: float) -> None:
    """Some nodes publish at half their rate, the others as ever."""
    for _ in range(round(seconds / PERIOD / 2)):
        stream(bench, NODES, PERIOD)
        stream(bench, [node for node in NODES if node not in slow], PERIOD)


def test_nodes_that_are_slow_together_are_not_blamed_as_long_as_that_lasts() -> None:
    bench = robot()
    slow_stream(bench, NODES[1:], 5.0)
    assert bench.failures == []
    slow_stream(bench, NODES[3:], 5.0)
    assert bench.kinds() == [(NODES[3], "rate_low")]


def test_one_or_two_that_are_slow_are_found() -> None:
    bench = robot()
    slow_stream(bench, NODES[2:], 5.0)
    assert sorted(bench.kinds()) == [(NODES[3], "rate_low"), (NODES[2], "rate_low")]


def test_a_node_that_is_slow_while_healing_connects_is_not_blamed_until_that_is_over() -> None:
    bench = robot(NODES, service(name="another", topic="/another", node=NODES[3], period=None))
    for _ in range(8):
        bench.connect(NODES[3], "/another")
        slow_stream(bench, NODES[3:], 0.5)
    assert bench.failures == []
    slow_stream(bench, NODES[3:], 4.0)
    assert bench.kinds() == [(NODES[3], "rate_low")]


def test_to_connect_to_one_node_excuses_no_other_that_is_slow() -> None:
    bench = robot(NODES, service(name="another", topic="/another", node=NODES[0], period=None))
    for _ in range(8):
        bench.connect(NODES[0], "/another")
        slow_stream(bench, NODES[3:], 0.5)
    assert bench.kinds() == [(NODES[3], "rate_low")]


def test_slow_and_event_driven_topics_do_not_count_as_late() -> None:
    slow = [service(name=f"s{n}", topic=f"/s{n}", node=f"/s{n}", period=0.5) for n in range(4)]
    event = service(name="event", topic="/event", node="/event", period=None)
    tight = service(name="tight", topic="/tight", node="/tight", period=0.5, deadline=1.2)
    bench = Bench(service(), *slow, event, tight)
    bench.connect()
    for each in (*slow, event, tight):
        bench.connect(each.node, each.topic)
    for _ in range(3):
        for each in (*slow, event, tight):
            bench.message(node=each.node, topic=each.topic)
        bench.stream(25)
    last = bench.now
    bench.wait(DEADLINE + 0.001)
    assert bench.kinds()[0] == (NODE, "silent")
    assert bench.failures[0].since == pytest.approx(last + DEADLINE)


def test_a_node_that_healing_connects_to_has_a_deadline_more() -> None:
    bench = robot()
    bench.connect("/one", "/one")
    last = bench.now
    stream(bench, NODES[1:], 1.9 * DEADLINE)
    assert bench.failures == []
    stream(bench, NODES[1:], 0.2 * DEADLINE)
    assert bench.kinds() == [("/one", "silent")]
    assert bench.failures[0].since == pytest.approx(last + 2 * DEADLINE)


def test_another_topic_of_the_node_is_enough() -> None:
    bench = Bench(service(), service(name="second", topic="/second"))
    bench.connect()
    bench.stream(60)
    bench.connect(NODE, "/second")
    bench.wait(1.7 * DEADLINE)
    bench.stream(10)
    assert bench.failures == []


def test_people_see_why_a_late_node_is_not_blamed_as_long_as_it_is_late() -> None:
    bench = robot()
    bench.connect("/one", "/one")
    stream(bench, NODES[1:], 1.5 * DEADLINE)
    row = bench.rows["/one", "/one"]
    assert bench.state("/one", "/one") == "healthy"
    assert row.detail.startswith("not blamed: healing connected to it")
    stream(bench, NODES, 2 * PERIOD)
    assert bench.rows["/one", "/one"].detail == ""


def test_people_see_that_slow_nodes_are_slow_together() -> None:
    bench = robot()
    slow_stream(bench, NODES[1:], 5.0)
    assert "late together" in bench.rows[NODES[1], NODES[1]].detail
    stream(bench, NODES, 5.0)
    assert {row.detail for row in bench.rows.values()} == {""}


@pytest.mark.parametrize("kind", KINDS)
def test_who_has_no_alibi_is_to_blame(kind: Optional[Kind]) -> None:
    assert decide(Case(kind, 10.0, 9.0)) is None


@pytest.mark.parametrize("row", ROWS)
def test_who_is_late_has_the_same_alibis_whatever_shows_it(row: Row) -> None:
    late = {Kind.SILENT, Kind.RATE_LOW, Kind.STALE_STAMP, None}
    assert len(late & {*row.clears}) in (0, 1, len(late))


def test_each_alibi_clears_of_what_it_says_and_ends() -> None:
    facts: Tuple[Dict[str, Any], ...] = (
        dict(due=11.0),
        dict(reconnects_until=11.0),
        dict(busy=8.5),
        dict(short=8.5),
        dict(together=3),
        dict(paced=False),
        dict(confirmed=True),
        dict(together=2),
        dict(fed_badly=True),
        dict(was_there=True),
        dict(robot_came=False),
    )
    for row, fact in zip(ROWS, facts):
        for kind in KINDS:
            alibi = decide(Case(kind, 10.0, 9.0, limit=12.0, **fact))
            assert (alibi is not None and alibi.why == row.why) is (kind in row.clears)
            later = Case(kind, 14.0, 9.0, limit=12.0, **fact)
            assert row.until(later) <= 14.0 or kind not in row.clears or decide(later)
    assert len(facts) == len(ROWS)


def test_to_connect_to_one_node_excuses_no_other(bench: Bench) -> None:
    bench.connect("/spoofer")
    bench.wait(DEADLINE + 0.001)
    assert bench.kinds() == [(NODE, "silent")]


@pytest.mark.parametrize("after", (0.0, 0.9 * CHANGEOVER_S))
def test_while_a_substitute_comes_up_everybody_has_a_deadline_more(after: float) -> None:
    bench = robot()
    bench.substitutes(("/substitute_1", False), topic="/two")
    bench.connect("/substitute_1", "/two")
    stream(bench, NODES, after)
    last = bench.now
    stream(bench, NODES[1:], 1.9 * DEADLINE)
    assert bench.failures == []
    stream(bench, NODES[1:], 0.2 * DEADLINE)
    assert [failure.since for failure in bench.failures] == [pytest.approx(last + 2 * DEADLINE)]


def test_a_connection_long_before_a_silence_is_no_reason_for_it(bench: Bench) -> None:
    bench.connect()
    bench.stream(round(CHANGEOVER_S / PERIOD) + 1)
    last = bench.now
    bench.wait(1.0)
    assert bench.failures[0].since == pytest.approx(last + DEADLINE)


def test_a_connection_that_is_made_during_a_silence_may_be_its_reason(bench: Bench) -> None:
    bench.connect("/other")
    bench.wait(0.9 * DEADLINE)
    bench.connect()
    bench.wait(0.8 * DEADLINE)
    bench.stream(50)
    assert bench.failures == []


def test_all_excuses_together_grant_one_deadline() -> None:
    bench = robot()
    for node in NODES:
        bench.connect(node, node)
    last = bench.now
    while len(bench.failures) < 4 and bench.now < last + 10.0:
        bench.now = bench.core.next_deadline + 0.02
        bench.wake(0.02)
    assert bench.now <= last + 3 * DEADLINE


def test_an_interrupted_publisher_is_not_blamed_while_a_connection_is_made(bench: Bench) -> None:
    bench.interrupt()
    bench.wait(0.45)
    bench.connect()
    bench.wait(0.7 * DEADLINE)
    bench.stream(50)
    assert bench.failures == [] and bench.state() == "healthy"


def test_a_publisher_that_does_not_connect_again_is_gone(bench: Bench) -> None:
    bench.interrupt()
    bench.wait(0.003)
    bench.disconnect()
    assert bench.kinds() == [(NODE, "node_gone")]


def test_a_publisher_that_connects_again_and_is_silent_has_failed(bench: Bench) -> None:
    bench.interrupt()
    bench.wait(0.1)
    bench.connect()
    bench.wait(2 * DEADLINE + 0.001)
    assert bench.kinds() == [(NODE, "silent")]


def test_an_interruption_without_end_is_silence(bench: Bench) -> None:
    bench.interrupt()
    bench.wait(RECONNECT_S + 2 * DEADLINE)
    assert bench.kinds() == [(NODE, "silent")]


def test_a_publisher_that_drops_connections_and_says_nothing_is_found(bench: Bench) -> None:
    last = bench.now
    for _ in range(20):
        bench.interrupt()
        bench.wait(0.05)
        bench.connect()
        bench.wait(0.05)
    assert bench.kinds() == [(NODE, "silent")]
    assert bench.failures[0].since < last + 4 * DEADLINE


@pytest.mark.parametrize("whom", [("/elsewhere", NODE), (TOPIC, "/who")])
def test_an_interruption_of_who_is_not_known_is_nothing(
    bench: Bench, whom: Tuple[str, str]
) -> None:
    before = table(bench.core)
    bench.interrupt(whom[1], whom[0])
    assert table(bench.core) == before


def short_of_time(bench: Bench, seconds: float, share: float, *nodes: str, who: str = "") -> None:
    """A node, empty: any, waits for a processor for a share of the time; these nodes go on."""
    for _ in range(round(seconds / PERIOD)):
        bench.wait(PERIOD)
        bench.send(ClockTicked(bench.now, bench.now, waited=((who, share * bench.now),)))
        for node in nodes:
            bench.message(node=node)


SLOW = [(NODE, "rate_low")]


@pytest.mark.parametrize(
    "who, share, failed",
    [("", 0.9, []), ("", 0.2, SLOW), (NODE, 0.9, []), (NODE, 0.2, SLOW), ("/other", 0.9, SLOW)],
)
def test_nobody_is_slow_where_it_or_the_computer_is_short_of_processor_time(
    who: str, share: float, failed: List[Tuple[str, str]]
) -> None:
    bench = Bench(settings=Settings(minimum_deadline=1.0))
    bench.connect()
    bench.stream(120)
    for _ in range(40):
        short_of_time(bench, 3 * PERIOD, share, who=who)
        bench.message()
    assert bench.kinds() == failed
    if not failed:
        assert "short of processor time" in bench.rows[TOPIC, NODE].detail


def test_a_process_that_comes_anew_has_waited_for_less_than_the_one_before(bench: Bench) -> None:
    for waited in (50.0, 0.1, 0.2):
        bench.wait(PERIOD)
        bench.message()
        bench.send(ClockTicked(bench.now, bench.now, waited=((NODE, waited),)))
    assert bench.kinds() == []


def test_who_hangs_while_the_computer_is_short_of_processor_time_is_found(bench: Bench) -> None:
    bench.connect()
    short_of_time(bench, 1.0, 0.9, NODE)
    since = bench.now
    short_of_time(bench, 4 * DEADLINE, 0.9)
    assert bench.kinds() == [(NODE, "silent")]
    assert 1.9 * DEADLINE <= bench.failures[0].since - since <= 2.1 * DEADLINE


def test_a_node_that_lives_and_left_its_topic_is_silent_at_once(bench: Bench) -> None:
    bench.send(Disconnected(bench.now, TOPIC, NODE, certain=False, left=True))
    assert bench.kinds() == [(NODE, "silent")] and bench.failures[0].since == bench.now
    assert "its node lives, and publishes it no more" in bench.failures[0].detail
    bench.wait(0.1)
    bench.disconnect()
    assert bench.rows[TOPIC, NODE].kind == "node_gone", "it has ended"


def test_the_message_that_ends_a_silence_is_the_first_of_five_good_ones() -> None:
    bench = Bench()
    bench.connect()
    bench.stream(100, age=0.01)
    bench.wait(1.0)
    assert bench.failures[0].detail == "no message for 0.100 s, 0.100 s are allowed"
    bench.message(age=0.01)
    bench.stream(3, age=0.01)
    assert bench.state() == "failed"
    bench.stream(1, age=0.01)
    assert bench.state() == "healthy"


def test_whoever_is_gone_and_is_no_node_of_the_som_is_forgotten_once_another_does_well() -> None:
    bench = Bench()
    bench.connect("/play_1")
    bench.stream(60, "/play_1")
    bench.disconnect("/play_1")
    assert bench.state("/play_1") == "failed"
    bench.connect("/play_2")
    bench.stream(10, "/play_2")
    assert bench.state("/play_2") == "healthy" and bench.state("/play_1") is None
