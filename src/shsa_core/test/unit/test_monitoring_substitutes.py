"""The monitor and substitutes: one that is muted or stopped on purpose has not failed."""
from dataclasses import replace
from math import nan
from typing import List


import pytest
from monitor_bench import DEADLINE, NODE, PERIOD, TOPIC, Bench, provision, row, service, table

from shsa_core.model.substitution import CHANGEOVER_S
from shsa_core.monitoring.events import Message, SubstitutionsChanged


@pytest.fixture
def bench() -> Bench:
    made = Bench()
    made.connect()
    made.stream(60)  # it is connected for longer than CHANGEOVER_S
    return made


def test_a_topic_that_never_came_up_fails_beside_a_muted_substitute() -> None:
    bench = Bench()
    bench.substitutes(("/substitute_1", False))
    bench.connect("/substitute_1")
    bench.wait(16.0)
    assert bench.kinds() == [("", "never_published")]
    assert bench.state("/substitute_1") == "unknown"


def test_a_muted_substitute_is_never_silent(bench: Bench) -> None:
    bench.substitutes(("/substitute_1", False))
    bench.connect("/substitute_1")
    bench.stream(500)
    assert bench.failures == [] and bench.state("/substitute_1") == "unknown"
    assert bench.muted() == {(TOPIC, "/substitute_1")}
    bench.substitutes(("/substitute_1", True))
    assert bench.muted() == set()
    bench.substitutes(("/substitute_1", False))
    bench.disconnect("/substitute_1")
    assert bench.failures == [] and bench.state("/substitute_1") is None


def test_what_a_gate_keeps_back_is_no_failure_and_no_health(bench: Bench) -> None:
    node = "/substitute_1"
    row_of = lambda publishing: replace(row(node, publishing, TOPIC), gated=True)
    bench.send(SubstitutionsChanged(bench.now, (row_of(False),)))
    bench.connect(node)
    for _ in range(200):
        bench.message(node=node, value=1000.0)
        bench.stream(1)
    assert bench.failures == [] and bench.state(node) == "unknown"
    began = bench.now
    bench.send(SubstitutionsChanged(bench.now, (row_of(True),)))
    bench.message(node=node)
    assert bench.state(node) == "healthy"
    (health,) = [each for each in table(bench.core) if each.publisher == node]
    assert health.first_message is not None and health.first_message >= began


@pytest.mark.parametrize("node, kinds", [("/substitute_1", []), (NODE, ["not_a_number"])])
def test_a_value_that_a_substitute_does_not_compute_is_no_failure(
    node: str, kinds: List[str]
) -> None:
    values = provision(), provision(property="voltage", field="voltage")
    bench = Bench(service(provides=values))
    bench.substitutes(("/substitute_1", True))  # it computes `data` alone
    bench.connect(node)
    for _ in range(60):
        bench.wait(PERIOD)
        bench.send(Message(bench.now, TOPIC, node, (1.0, nan)))
    assert [kind for _, kind in bench.kinds()] == kinds
    bench.send(Message(bench.now, TOPIC, node, (nan, nan)))
    bench.send(Message(bench.now, TOPIC, node, (nan, nan)))
    bench.send(Message(bench.now, TOPIC, node, (nan, nan)))
    assert bench.kinds() == [(node, "not_a_number")]


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


def test_a_substitute_that_is_stopped_as_planned_has_not_failed(bench: Bench) -> None:
    bench.connect("/substitute_1")
    bench.substitutes(("/substitute_1", True))
    bench.message(node="/substitute_1")
    bench.substitutes()
    bench.stream(20)
    bench.disconnect("/substitute_1")
    assert bench.failures == [] and bench.state("/substitute_1") is None


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


def test_a_substitute_that_ends_and_leaves_nobody_is_missed_though_it_was_meant_to_end() -> None:
    bench = Bench()  # it started when the original was dead already
    bench.substitutes(("/substitute_1", True))
    bench.connect("/substitute_1")
    bench.stream(1000, "/substitute_1")
    bench.substitutes()
    bench.disconnect("/substitute_1")
    assert bench.failures == []
    bench.wait(14.0)
    assert bench.failures == []
    bench.wait(2.0)
    assert bench.kinds() == [("", "never_published")]


BRIDGE = 2.5 * PERIOD


def bridges(bench: Bench, publishing: bool = False) -> None:
    """The table has a substitute that fills in while it is muted."""
    told = replace(row("/substitute_1", publishing, TOPIC), bridge=0.0 if publishing else BRIDGE)
    bench.send(SubstitutionsChanged(bench.now, (told,)))


def filled_in(bench: Bench, count: int = 4, value: float = 1.0, period: float = PERIOD / 4) -> int:
    """The original is late, and the substitute fills in; how often it has so far."""
    bench.wait(BRIDGE)
    for _ in range(count):
        bench.send(Message(bench.now, TOPIC, "/substitute_1", (value,)))
        bench.wait(period)
    return bench.core.overview()[0].bridged


def test_who_fills_in_is_counted_and_held_against_nobody(bench: Bench) -> None:
    bench.connect("/substitute_1")
    bridges(bench)
    bench.stream(20)
    assert filled_in(bench) == 1
    bench.stream(20)
    assert filled_in(bench) == 2
    bench.stream(20)
    assert bench.failures == [] and bench.state("/substitute_1") == "unknown"
    assert bench.muted() == {(TOPIC, "/substitute_1")}
    (health,) = bench.core.overview()
    assert (str(health.condition), health.bridged) == ("healthy", 2)


def test_a_late_original_is_as_late_beside_who_fills_in(bench: Bench) -> None:
    bench.connect("/substitute_1")
    bridges(bench)
    bench.stream(20)
    since = bench.now
    filled_in(bench, count=40, period=PERIOD)
    assert bench.kinds() == [(NODE, "silent")]
    assert bench.failures[0].since - since == pytest.approx(DEADLINE)
    assert bench.state("/substitute_1") == "healthy"  # it is to take over any moment
    assert bench.core.overview()[0].bridged == 1


def test_nothing_is_learned_from_who_fills_in(bench: Bench) -> None:
    bench.connect("/substitute_1")
    bridges(bench)
    bench.stream(20)
    filled_in(bench, value=float("nan"))
    bench.stream(20)
    assert bench.failures == []


def test_one_that_was_muted_just_now_does_not_fill_in_yet(bench: Bench) -> None:
    bench.disconnect()
    bench.connect("/substitute_1")
    bridges(bench, publishing=True)
    bench.stream(50, "/substitute_1")
    bench.connect()
    bench.stream(3)
    bridges(bench)
    assert filled_in(bench) == 0  # to consumers whom the original does not serve yet
    bench.stream(int(CHANGEOVER_S / PERIOD))
    assert filled_in(bench) == 1


def test_nobody_is_missed_once_a_substitute_that_stood_by_speaks() -> None:
    bench = Bench()
    bench.substitutes(("/substitute", False))
    bench.connect("/substitute")
    bench.wait(16.0)
    assert bench.state("") == "failed"
    bench.substitutes(("/substitute", True))
    bench.stream(6, "/substitute")
    assert bench.state("/substitute") == "healthy" and bench.state("") is None
