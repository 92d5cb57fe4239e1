"""Publishers of another type than the SOM names, whom no consumer of the topic hears."""
from dataclasses import replace

import pytest
from monitor_bench import DEADLINE, NODE, PERIOD, SETTINGS, TOPIC, Bench, service, streaming
from test_monitoring_checks import both

from shsa_core.monitoring.events import Message
from shsa_core.monitoring.overview import Condition

WHY = "it sends another type"
FIRST, SECOND = "http://127.0.0.1:1/", "http://127.0.0.1:2/"


def foreign(bench: Bench, count: int = 10, node: str = NODE) -> None:
    for _ in range(count):
        bench.wait(PERIOD)
        bench.send(Message(bench.now, TOPIC, node, foreign=WHY))


@pytest.mark.parametrize("period", [PERIOD, None])
def test_who_comes_back_with_another_type_is_not_back(period: float) -> None:
    bench = Bench(service(period=period))
    bench.connect(uri=FIRST)
    bench.stream(10)
    bench.disconnect()
    assert bench.kinds() == [(NODE, "node_gone")]
    bench.connect(uri=SECOND)
    foreign(bench)
    assert bench.state() != "healthy" and bench.rows[TOPIC, NODE].detail == WHY
    bench.disconnect()
    bench.connect(uri=FIRST)
    bench.stream(10)
    assert bench.state() == "healthy" and bench.rows[TOPIC, NODE].detail == ""


def test_a_node_that_changes_its_type_is_silent() -> None:
    bench = streaming()
    foreign(bench, 1)
    assert bench.kinds() == [(NODE, "silent")] and bench.failures[0].detail == WHY
    foreign(bench)
    bench.wait(10.0 * DEADLINE)
    assert len(bench.failures) == 1 and bench.state() == "failed"
    bench.stream(20)
    assert bench.state() == "healthy"


@pytest.mark.parametrize("period", [PERIOD, None])
def test_a_node_that_always_had_another_type_is_not_missed(period: float) -> None:
    """The SOM may be wrong."""
    bench = Bench(service(period=period), settings=replace(SETTINGS, startup_grace=1.0))
    bench.connect()
    foreign(bench, 100)
    assert bench.failures == []
    assert bench.state() == "unknown" and bench.rows[TOPIC, NODE].detail == WHY
    (shown,) = bench.core.overview()
    assert (shown.condition, shown.detail) == (Condition.STARTING, WHY)


def test_a_stranger_of_another_type_replaces_nobody() -> None:
    bench = Bench(settings=replace(SETTINGS, startup_grace=1.0))
    bench.connect("/stranger")
    foreign(bench, 100, "/stranger")
    assert [kind for _, kind in bench.kinds()] == ["never_published"]


def test_a_publisher_that_was_there_before_healing_is_named_and_not_blamed() -> None:
    bench = Bench()
    bench.connect("/stranger")
    bench.stream(100)
    both(bench, 10.0)
    bench.stream(100)  # the stranger pauses
    both(bench, 10.0)
    bench.disconnect("/stranger")
    both(bench, 10.0)
    assert [kind for _, kind in bench.kinds() if kind == "unknown_publisher"] == []
    assert bench.state("/stranger") == "healthy"
    told = [text for text in bench.told if "name it in the SOM" in text]
    assert len(told) == 2, "once for each of its lives"
