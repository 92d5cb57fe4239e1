"""Topics without a period: watched for their connections and values alone."""
from math import inf, nan

from monitor_bench import NODE, TOPIC, Bench, service
from shsa_core.monitoring.events import Disconnected

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


def test_an_event_driven_service_has_no_silence_to_wait_for() -> None:
    bench = Bench(EVENT_DRIVEN)
    bench.connect()
    bench.send(Disconnected(bench.now, TOPIC, NODE, certain=False))
    assert bench.kinds() == [(NODE, "silent")], "that it is gone is not certain"
    bench.connect()
    assert bench.state() == "healthy"


def test_an_event_driven_service_whose_node_never_connected_has_failed() -> None:
    bench = Bench(EVENT_DRIVEN)
    bench.wait(16.0)
    assert bench.kinds() == [("", "never_published")]
    assert bench.failures[0].detail == "no publisher in the first 15 s"
    bench.connect()
    assert (bench.state(""), bench.state()) == (None, "healthy")


def test_a_service_becomes_event_driven_and_periodic_again() -> None:
    bench = Bench()
    bench.connect()
    assert bench.state() == "unknown"
    bench.watch(service(period=None))
    assert bench.state() == "healthy"
    bench.wait(1000.0)
    bench.message()
    bench.watch(service())
    assert bench.state() == "healthy"
    bench.stream(60)
    assert bench.core.service_of(TOPIC, NODE) == service()
    bench.wait(1.0)
    assert bench.kinds() == [(NODE, "silent")]


def test_who_was_well_by_its_connection_alone_is_not_for_a_periodic_service() -> None:
    bench = Bench(service(period=None))
    bench.connect()
    assert bench.state() == "healthy"
    bench.watch(service(name="other", node="/other"))
    assert bench.state() == "unknown"


def test_a_muted_substitute_does_not_make_an_event_driven_service_appear() -> None:
    bench = Bench(EVENT_DRIVEN)
    bench.substitutes(("/substitute_1", False))
    bench.connect("/substitute_1")
    bench.wait(16.0)
    assert bench.kinds() == [("", "never_published")]
