"""Each check of messages: found when it is on, silent when it is off, back to healthy when it is over."""
from math import nan
from typing import Dict

import pytest
from health_bench import NODE, PERIOD, TOPIC, Bench, service

from shsa_core.errors import ModelError
from shsa_core.monitoring.events import Message, SomChanged
from shsa_core.monitoring.evidence import TopicChecks
from shsa_core.model.checks import Checks, read_checks
from shsa_core.files.document import from_parameters
from shsa_core.model.som import Som, som_from_parameters

OFF = Checks(False, False, None, None, None, None, None, None, None)


def bench_with(**checks: object) -> Bench:
    """A bench whose topic has no checks but these, after a second of healthy messages."""
    values: Dict[str, object] = {}
    values.update(OFF.parameters())
    values.update(checks)
    read = read_checks(from_parameters(values, "checks"), "checks")
    bench = Bench(service(checks=read, range=None))
    bench.connect()
    bench.stream(60)
    assert bench.state() == "healthy"
    return bench


def test_too_fast() -> None:
    bench = bench_with(rate_high=1.5)
    bench.stream(200, period=PERIOD / 1.4)
    assert bench.failures == []
    bench.stream(200, period=PERIOD / 1.6)
    assert bench.kinds() == [(NODE, "rate_high")]
    assert "at most 75.0 Hz" in bench.failures[0].detail
    bench.stream(100)
    assert bench.state() == "healthy"


def test_too_slow() -> None:
    bench = bench_with(rate_low=0.5)
    bench.stream(200, period=PERIOD / 0.6)
    assert bench.failures == []
    bench.stream(200, period=PERIOD / 0.4)
    assert bench.kinds() == [(NODE, "rate_low")]
    bench.stream(100)
    assert bench.state() == "healthy"


def test_a_burst_after_a_short_gap_is_not_too_fast() -> None:
    bench = bench_with(rate_high=1.5, rate_low=0.5)
    for _ in range(20):
        bench.wait(4 * PERIOD)
        for _ in range(5):
            bench.message()
    assert bench.failures == []


def test_what_has_waited_for_the_monitor_is_judged_in_the_publishers_favour() -> None:
    bench = bench_with(rate_high=1.1, rate_low=0.9, stale_stamp=0.2)
    for _ in range(3):
        bench.now += 5.0
        for number in range(250):
            age = 5.0 - number * PERIOD
            bench.send(Message(bench.now, TOPIC, NODE, (1.0,), age=age, waited=5.0))
        bench.stream(100, age=0.0)
    assert bench.failures == []


def test_waiting_excuses_no_more_than_its_time() -> None:
    bench = bench_with(stale_stamp=0.2)
    for _ in range(3):
        bench.wait(PERIOD)
        bench.send(Message(bench.now, TOPIC, NODE, (1.0,), age=0.31, waited=0.1))
    assert bench.kinds() == [(NODE, "stale_stamp")]
    assert bench.failures[0].detail == "the stamp is 0.210 s old, 0.2 s are allowed"


def test_stuck() -> None:
    bench = bench_with()
    bench.stream(500, value=2.0)
    assert bench.failures == []
    bench = Bench(service(checks=Checks(stuck=1.0)))
    for step in range(200):
        bench.stream(1, value=1.0 + step % 7)
    assert bench.failures == []
    bench.stream(49, value=3.0)
    assert bench.failures == []
    bench.stream(10, value=3.0)
    assert bench.kinds() == [(NODE, "stuck")]
    for step in range(6):
        bench.stream(1, value=1.0 + step)
    assert bench.state() == "healthy"


def test_jump() -> None:
    bench = bench_with(jump=5.0)
    for value in (6.0, 11.0, 7.0):
        bench.stream(1, value=value)
    bench.stream(1, value=100.0)
    bench.stream(20, value=7.0)
    assert bench.failures == []
    bench.stream(2, value=13.0)
    assert bench.failures == []
    bench.stream(1, value=13.0)
    assert bench.kinds() == [(NODE, "jump")]
    assert bench.failures[0].detail == "battery_current went from 7 to 13, steps of 5 are allowed"
    bench.stream(5, value=13.0)
    assert bench.state() == "healthy"


def test_stale_stamp() -> None:
    bench = bench_with(stale_stamp=0.5)
    bench.stream(20, age=0.4)
    bench.stream(20, age=-9.0)
    bench.stream(20)
    assert bench.failures == []
    bench.stream(3, age=0.6)
    assert bench.kinds() == [(NODE, "stale_stamp")]
    bench.stream(5, age=0.0)
    assert bench.state() == "healthy"


def test_future_stamp() -> None:
    bench = bench_with(future_stamp=0.5)
    bench.stream(20, age=-0.4)
    bench.stream(20, age=9.0)
    assert bench.failures == []
    bench.stream(3, age=-0.6)
    assert bench.kinds() == [(NODE, "future_stamp")]


def test_switched_off_checks_see_nothing() -> None:
    bench = bench_with()
    bench.stream(100, period=PERIOD / 3, value=nan, age=100.0)
    bench.connect("/stranger")
    for _ in range(100):
        bench.stream(1)
        bench.message(node="/stranger")
    assert bench.failures == []


def test_range_can_be_switched_off() -> None:
    bench = Bench(service(checks=Checks(out_of_range=False)))
    bench.stream(20, value=1000.0)
    assert bench.failures == []


def both(bench: Bench, seconds: float, other: str = "/stranger") -> None:
    """The SOM's node and another one publish side by side."""
    for _ in range(round(seconds / PERIOD)):
        bench.stream(1)
        bench.message(node=other)


def test_a_stranger_beside_the_soms_node() -> None:
    bench = bench_with(unknown_publisher=1.0)
    bench.connect("/stranger")
    both(bench, 0.9)
    assert bench.failures == []
    both(bench, 1.0)
    assert bench.kinds() == [("/stranger", "unknown_publisher")]
    both(bench, 10.0)
    bench.disconnect()
    bench.stream(100, node="/stranger")
    assert bench.state("/stranger") == "failed"


def test_a_stranger_becomes_known_when_the_som_names_it() -> None:
    bench = Bench()
    both(bench, 2.0)
    assert bench.kinds() == [("/stranger", "unknown_publisher")]
    bench.send(SomChanged(bench.now, Som([service(node="/stranger")])))
    bench.stream(10, node="/stranger")
    assert bench.state("/stranger") == "healthy"


def test_substitutes_are_no_strangers() -> None:
    bench = bench_with(unknown_publisher=1.0)
    bench.connect("/substitute_1")
    bench.substitutes(("/substitute_1", True))
    both(bench, 3.0, "/substitute_1")
    bench.substitutes()
    both(bench, 3.0, "/substitute_1")
    assert bench.failures == []


def test_a_stranger_alone_on_a_topic_is_welcome() -> None:
    bench = Bench()
    bench.connect("/stranger")
    bench.stream(200, node="/stranger")
    assert bench.failures == [] and bench.state("/stranger") == "healthy"


def test_how_many_bad_messages_make_a_failure_is_tuned() -> None:
    bench = bench_with(not_a_number=True, bad=1, of=1, recovery=1)
    bench.stream(1, value=nan)
    bench.stream(1)
    bench.stream(1, value=nan)
    assert bench.kinds() == [(NODE, "not_a_number")] * 2
    bench = bench_with(not_a_number=True, bad=4, of=4)
    for _ in range(10):
        bench.stream(3, value=nan)
        bench.stream(1)
    assert bench.failures == []


def test_the_deadline_is_tuned_exactly() -> None:
    bench = Bench(service(deadline=2.0))
    bench.connect()
    bench.message()
    bench.wait(2 * PERIOD - 0.001)
    assert bench.failures == []
    bench.wait(0.001)
    assert bench.kinds() == [(NODE, "silent")]


def test_each_field_of_a_topic_is_checked() -> None:
    bench = Bench(
        service(property="speed", field="x", range=(0.0, 1.0)),
        service(property="turn", field="z", range=None, checks=Checks(jump=0.1)),
    )
    bench.connect()
    for _ in range(10):
        bench.send(Message(bench.now, TOPIC, NODE, (0.5, 0.0)))
    for _ in range(3):
        bench.send(Message(bench.now, TOPIC, NODE, (0.5, 0.2)))
    assert bench.failures[0].kind == "jump" and "turn went" in bench.failures[0].detail


def test_the_defaults_find_gross_faults_only() -> None:
    bench = Bench(service(range=None))
    bench.connect()
    for step in range(400):
        bench.stream(1, value=1.0 if step % 100 < 50 else -1e6, age=100.0)
    assert bench.failures == []


@pytest.mark.parametrize("key", ["jump", "stuck", "rate_high", "unknown_publisher"])
@pytest.mark.parametrize("value", [0, -1, "yes", [1], {"limit": 1}, float("nan"), float("inf")])
def test_bad_limits_are_refused(key: str, value: object) -> None:
    with pytest.raises(ModelError, match=key):
        read_checks(from_parameters({key: value}, "checks"), "checks")


@pytest.mark.parametrize(
    "value, words",
    [
        ({"out_of_range": 3}, "out_of_range must be true or false"),
        ({"jump": True}, "no usual limit"),
        ({"bad": 0}, "from 1 to 1000"),
        ({"of": 2.5}, "whole number"),
        ({"bad": 11}, "at most of"),
        ({"jmp": 1}, "Did you mean 'jump'"),
        ("on", "must be a mapping"),
    ],
)
def test_bad_checks_are_refused(value: object, words: str) -> None:
    with pytest.raises(ModelError, match=words):
        read_checks(from_parameters(value, "checks"), "checks")


def test_true_switches_on_with_the_usual_limit() -> None:
    read = read_checks(from_parameters({"stuck": True, "rate_low": False}, "checks"), "checks")
    assert (read.stuck, read.rate_low, read.rate_high) == (1.0, None, 1.5)


@pytest.mark.parametrize("checks", [Checks(), OFF, Checks(jump=2.5, bad=1, of=1)])
def test_checks_survive_the_parameter_server(checks: Checks) -> None:
    som = Som([service(checks=checks, deadline=3.0)])
    assert som_from_parameters(som.parameters()) == som


def test_what_a_topic_must_be_decoded_for() -> None:
    off = TopicChecks((service(checks=OFF),))
    assert not off.of_values and not off.of_stamps
    for checks in (Checks(), Checks(stuck=1.0), Checks(jump=1.0), Checks(not_a_number=False)):
        assert TopicChecks((service(checks=checks),)).of_values
    unlimited = service(range=None, checks=Checks(not_a_number=False))
    assert not TopicChecks((unlimited,)).of_values
    for checks in (Checks(stale_stamp=1.0), Checks(future_stamp=1.0)):
        assert TopicChecks((service(checks=checks),)).of_stamps


def test_the_period_of_a_topic_is_the_longest_of_its_services() -> None:
    assert TopicChecks((service(), service(property="b", period=0.1))).period == 0.1
