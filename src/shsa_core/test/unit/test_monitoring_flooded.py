"""A monitor that is flooded: its thread has its turn seldom, and judges before it has read all."""
from monitor_bench import DEADLINE, NODE, PERIOD, TOPIC, Bench
from shsa_core.model.kinds import Kind
from shsa_core.monitoring.events import Message, Tick

TURN_S = 4 * DEADLINE
TURNS = 30


def flood(bench: Bench, knows: bool) -> None:
    """Have each turn come late; the monitor `knows` that it had wanted to look earlier.

    The kernel says when the messages that it reads then had come.
    """
    bench.connect()
    bench.stream(200)
    for _ in range(TURNS):
        began = bench.now
        bench.now += TURN_S
        bench.send(Tick(bench.now, bench.now - began - PERIOD if knows else 0.0))
        for number in range(1, round(TURN_S / PERIOD) + 1):
            bench.send(Message(began + number * PERIOD, TOPIC, NODE, (1.0,), age=0.0))


def test_it_blames_nobody_for_slowness() -> None:
    bench = Bench()
    flood(bench, knows=True)
    assert bench.failures == []


def test_it_would_if_it_did_not_know_that_it_is_late() -> None:
    bench = Bench()
    flood(bench, knows=False)
    assert {each.kind for each in bench.failures} == {Kind.SILENT}
