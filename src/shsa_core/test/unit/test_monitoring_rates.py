"""Rates that are too low beside what else is known: a substitute, a connection that was lost."""
from monitor_bench import NODE, PERIOD, TOPIC, Bench, service
from test_monitoring_checks import bench_with, only

from shsa_core.monitoring.events import Disconnected


def test_who_was_too_slow_for_a_former_monitor_is_so_for_the_next() -> None:
    """A rate that was never good is no failure, but of whom a substitute replaces."""
    bench = Bench(only(rate_low=0.5))
    bench.connect()
    bench.connect("/substitute_1")
    bench.substitutes(("/substitute_1", True))
    for _ in range(120):
        bench.wait(PERIOD / 0.4)
        bench.message()
        bench.message(node="/substitute_1")
    assert (NODE, "rate_low") in bench.kinds()


def test_a_little_noise_beside_a_rate_that_is_excused_is_no_failure() -> None:
    bench = Bench(service(period=2.0 * PERIOD))
    bench.connect()
    for _ in range(20):
        bench.stream(60)
        bench.stream(1, value=99.0)
    assert bench.failures == [] and bench.state() == "healthy"
    bench.stream(3, value=99.0)
    assert bench.kinds() == [(NODE, "out_of_range")]


def test_who_is_too_slow_and_then_cut_off_may_not_be_gone() -> None:
    bench = bench_with(rate_low=0.5)
    bench.stream(100)
    bench.stream(200, period=PERIOD / 0.4)
    bench.send(Disconnected(bench.now, TOPIC, NODE, certain=False))
    assert str(bench.rows[TOPIC, NODE].kind) == "silent"
    bench.disconnect()
    assert str(bench.rows[TOPIC, NODE].kind) == "node_gone"
