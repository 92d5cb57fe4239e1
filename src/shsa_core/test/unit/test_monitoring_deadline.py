"""A deadline that is learned: whose gaps teach it, what it is judged by, and what is told of it."""
from itertools import accumulate
from typing import Any, Dict, Optional

import pytest
from monitor_bench import NODE, PERIOD, TOPIC, Bench, row, service

from shsa_core.journal.codec import Codec
from shsa_core.model.substitution import CHANGEOVER_S
from shsa_core.model.service import AdaptiveDeadline, Deadlines, Service
from shsa_core.monitoring.events import Message, SubstitutionsChanged, Tick
from shsa_core.monitoring.publishers import Publisher
from shsa_core.monitoring.settings import Settings

FIXED = 0.25
LEARN = 1000
OFTEN = AdaptiveDeadline(10.0)


def adaptive(**changes: Any) -> Service:
    values: Dict[str, Any] = {"deadline": OFTEN, **changes}
    return service(**values)


def bench_of(*services: Service) -> Bench:
    return Bench(*services, settings=Settings())


@pytest.fixture
def bench() -> Bench:
    """One node, of which enough is known."""
    made = bench_of(adaptive())
    made.connect()
    made.stream(LEARN + 1)
    return made


def publisher(bench: Bench, node: str = NODE, topic: str = TOPIC) -> Publisher:
    found = bench.core._board.find(topic, node)
    assert found is not None
    return found


def allowed(bench: Bench) -> float:
    return publisher(bench).allowed


def gap(bench: Bench, seconds: float) -> None:
    """A gap, and the look that follows each message."""
    bench.wait(seconds)
    bench.message()
    bench.wake(0.0)


def test_a_hung_node_is_found_by_what_was_learned(bench: Bench) -> None:
    gap(bench, 0.2)
    last = bench.now
    bench.wait(1.0)
    (failure,) = bench.failures
    assert failure.since == pytest.approx(last + 0.3)
    assert failure.detail == (
        "no message for 0.300 s, 0.300 s are allowed, learned from 1001 gaps, "
        "10 false alarms an hour"
    )


def test_one_late_message_of_a_steady_stream_is_not_blamed(bench: Bench) -> None:
    bench.wait(0.18)
    bench.message()
    assert bench.failures == []


def test_before_that_the_fixed_deadline_counts() -> None:
    bench = bench_of(adaptive())
    bench.connect()
    bench.stream(LEARN - 1)
    last = bench.now
    bench.wait(1.0)
    (failure,) = bench.failures
    assert failure.since == pytest.approx(last + FIXED)
    assert "the fixed deadline until 1000 gaps are known, 998 are so far" in failure.detail


def test_it_is_shown(bench: Bench) -> None:
    (shown,) = bench.core.overview()
    assert shown.deadline == "0.250 s, learned from 1000 gaps, 10 false alarms an hour"
    (usual,) = bench_of(service()).core.overview()
    assert usual.deadline == ""


def test_a_longer_healthy_gap_raises_it_at_once(bench: Bench) -> None:
    gap(bench, 0.2)
    assert allowed(bench) >= 0.3 and bench.failures == []


def test_a_gap_while_the_monitor_was_late_does_not_teach(bench: Bench) -> None:
    bench.wait(0.168)
    bench.message()
    bench.wake(0.06)
    assert allowed(bench) == FIXED


def test_a_gap_while_healing_connects_does_not_teach(bench: Bench) -> None:
    bench.connect()
    gap(bench, 0.2)
    assert allowed(bench) == FIXED
    bench.stream(round(CHANGEOVER_S / PERIOD) + 1)
    gap(bench, 0.2)
    assert allowed(bench) > FIXED


def test_a_gap_that_was_interrupted_does_not_teach(bench: Bench) -> None:
    bench.interrupt()
    bench.wait(0.05)
    bench.connect()
    bench.stream(10)
    bench.interrupt()
    gap(bench, 0.2)
    assert allowed(bench) == FIXED


def robot(nodes: int, *deadlines: Optional[AdaptiveDeadline]) -> Bench:
    names = [f"/node_{number}" for number in range(nodes)]
    pairs = zip(names, deadlines or [OFTEN] * nodes)
    made = bench_of(*(service(name=n[1:], topic=n, node=n, deadline=d) for n, d in pairs))
    for name in names:
        made.connect(name, name)
    for _ in range(LEARN + 1):
        made.wait(PERIOD)
        for name in names:
            made.message(node=name, topic=name)
    return made


def together(bench: Bench, nodes: int, seconds: float) -> None:
    bench.wait(seconds)
    for number in range(nodes):
        bench.message(node=f"/node_{number}", topic=f"/node_{number}")
        bench.wait(0.001)
        bench.wake(0.0)


@pytest.mark.parametrize("nodes, teaches", [(2, True), (3, False), (5, False)])
def test_nodes_that_are_late_together_do_not_teach(nodes: int, teaches: bool) -> None:
    bench = robot(nodes)
    together(bench, nodes, 0.2)
    last = f"/node_{nodes - 1}"
    assert (publisher(bench, last, last).allowed > FIXED) is teaches
    assert bench.failures == []


def test_nodes_that_are_late_together_have_as_long_as_by_the_fixed_deadline() -> None:
    bench = robot(3)
    together(bench, 3, 1.9 * FIXED)
    assert bench.failures == []
    bench.wait(2.1 * FIXED)
    assert len(bench.failures) == 3


def test_others_with_a_fixed_deadline_are_late_together_with_it() -> None:
    bench = robot(3, OFTEN, None, None)
    together(bench, 3, 1.9 * FIXED)
    assert bench.failures == []


def test_the_gap_of_a_failure_does_not_teach(bench: Bench) -> None:
    bench.wait(0.5)
    bench.stream(20)
    assert bench.state() == "healthy" and len(bench.failures) == 1
    assert allowed(bench) == FIXED


def test_what_was_learned_outlives_a_restart_of_the_node(bench: Bench) -> None:
    bench.disconnect()
    bench.connect()
    bench.stream(1)
    assert allowed(bench) == FIXED


def test_a_substitute_has_the_fixed_deadline(bench: Bench) -> None:
    bench.send(SubstitutionsChanged(bench.now, (row("/stand_in", True, TOPIC),)))
    bench.connect("/stand_in")
    bench.stream(LEARN + 10, "/stand_in")
    assert publisher(bench, "/stand_in").allowed == FIXED


def test_messages_that_are_bad_do_not_teach(bench: Bench) -> None:
    bench.wait(0.2)
    bench.message(1000.0)
    bench.wake(0.0)
    assert allowed(bench) == FIXED


def test_a_number_instead_counts_at_once_if_it_allows_more(bench: Bench) -> None:
    bench.watch(service(deadline=10.0))
    assert allowed(bench) == pytest.approx(0.2) and bench.refused == []


def test_a_number_that_allows_less_counts_at_once_if_the_node_conforms(bench: Bench) -> None:
    bench.watch(service(deadline=3.0))
    assert allowed(bench) == pytest.approx(0.06)


def test_a_rate_is_adopted_and_what_is_known_counts_for_it(bench: Bench) -> None:
    bench.watch(adaptive(deadline=AdaptiveDeadline(100.0)))
    bench.stream(20)
    assert allowed(bench) == FIXED and bench.refused == []
    bench.watch(adaptive(deadline=AdaptiveDeadline(0.01)))
    assert allowed(bench) == FIXED, "18000 gaps are needed for that"


def test_another_period_is_another_stream() -> None:
    bench = bench_of(adaptive())
    bench.connect()
    bench.stream(LEARN + 10)
    bench.disconnect()
    bench.watch(adaptive(period=0.05))
    bench.connect()
    assert bench.core.service_of(TOPIC, NODE) == adaptive(period=0.05)
    bench.stream(10, period=0.05)
    assert allowed(bench) == FIXED


def test_stale_is_by_the_fixed_deadline_and_the_budget_by_the_longest() -> None:
    deadlines = Deadlines()
    assert deadlines.of(adaptive()) == FIXED and deadlines.longest(adaptive()) == 4 * FIXED
    assert deadlines.longest(service(deadline=3.0)) == pytest.approx(0.06)
    assert deadlines.longest(service(period=None)) is None


def test_it_survives_a_journal() -> None:
    codec = Codec(Service)
    for deadline in (OFTEN, 3.0, None):
        data = codec.encode(adaptive(deadline=deadline))
        assert codec.decode(data, "there", "a service").deadline == deadline


def test_the_same_events_teach_the_same() -> None:
    gaps = [PERIOD if number % 60 else 0.19 for number in range(1500)]
    made = [bench_of(adaptive()) for _ in range(2)]
    for one in made:
        one.connect()
        for time in accumulate(gaps):
            one.send(Message(100.0 + time, TOPIC, NODE, (1.0,)))
            one.send(Tick(100.0 + time))
    assert allowed(made[0]) == allowed(made[1]) > FIXED
