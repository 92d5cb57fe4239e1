"""What is learned of a healthy stream is not spoilt by a fault that was there for a moment."""
from monitor_bench import NODE, PERIOD, Bench
from shsa_core.monitoring.events import ClockTicked


def connected() -> Bench:
    bench = Bench()
    bench.connect()
    return bench


# Stamps


def test_one_old_message_among_the_first_excuses_no_later_one() -> None:
    """It was sent before our clock was set, or waited for somebody to connect."""
    bench = connected()
    for ahead in (1000.0, 1060.0):
        bench.send(ClockTicked(bench.now, ahead + bench.now))
        bench.stream(1, age=60.01)
        bench.stream(500, age=0.01)
    assert bench.failures == []
    bench.stream(3, age=20.0)
    assert bench.kinds() == [(NODE, "stale_stamp")]
