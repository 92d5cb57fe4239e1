"""Each check of messages: found when on, silent when off, healthy again when over."""
from math import nan
from typing import Any, Dict, List, Optional

import pytest

from monitor_bench import (
    NODE,
    PERIOD,
    SETTINGS,
    TOPIC,
    Bench,
    message_checks,
    provision,
    row,
    service,
    with_value_checks,
)

from shsa_core.model.checks import (
    Checks,
    Frame,
    FutureStamp,
    Jump,
    Length,
    NotANumber,
    OutOfRange,
    REGISTRY,
    RateHigh,
    RateLow,
    StaleStamp,
    Stuck,
    UnknownPublisher,
)
from shsa_core.model.service import Service
from shsa_core.monitoring.events import Message, SubstitutionsChanged
from shsa_core.monitoring.evidence import checked_provisions, checks_header

OF_VALUES = ("not_a_number", "out_of_range", "stuck", "jump")


def only(**limits: Any) -> Service:
    """A service with these checks and no others; `bad` and `of` may be among them."""
    counts = {name: limits.pop(name) for name in ("bad", "of") if name in limits}
    checks = {name: REGISTRY[name](limit) for name, limit in limits.items()}
    of_values = tuple(check for name, check in checks.items() if name in OF_VALUES)
    of_messages = (check for name, check in checks.items() if name not in OF_VALUES)
    value = provision(range=None, checks=of_values)
    return service(value, checks=message_checks(*of_messages, **counts))


def bench_with(**limits: Any) -> Bench:
    """A bench whose topic has no checks but these, after a second of healthy messages."""
    bench = Bench(only(**limits))
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
    bench = Bench(service(with_value_checks(Stuck(1.0))))
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
    bench = Bench(service(provision(checks=(NotANumber(True),))))
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
    bench.stream(50)
    both(bench, 2.0)
    assert bench.kinds() == [("/stranger", "unknown_publisher")]
    bench.watch(service(node="/stranger"))
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
    bench = bench_with(not_a_number=True, bad=1, of=1)
    bench.stream(1, value=nan)
    bench.stream(5)
    bench.stream(1, value=nan)
    assert bench.kinds() == [(NODE, "not_a_number")] * 2


def test_the_deadline_is_tuned_exactly() -> None:
    bench = Bench(service(deadline=2.0))
    bench.connect()
    bench.stream(60)
    bench.wait(2 * PERIOD - 0.001)
    assert bench.failures == []
    bench.wait(0.001)
    assert bench.kinds() == [(NODE, "silent")]


def test_each_field_of_a_topic_is_checked() -> None:
    bench = Bench(
        service(
            provides=(
                provision(property="speed", field="x", range=(0.0, 1.0)),
                with_value_checks(Jump(0.1), property="turn", field="z", range=None),
            )
        )
    )
    bench.connect()
    for _ in range(10):
        bench.send(Message(bench.now, TOPIC, NODE, (0.5, 0.0)))
    for _ in range(3):
        bench.send(Message(bench.now, TOPIC, NODE, (0.5, 0.2)))
    assert bench.failures[0].kind == "jump" and "turn went" in bench.failures[0].detail


def test_the_defaults_find_gross_faults_only() -> None:
    bench = Bench(service(provision(range=None)))
    bench.connect()
    for step in range(400):
        bench.stream(1, value=1.0 if step % 100 < 50 else -1e6, age=100.0)
    assert bench.failures == []


def test_what_a_topic_must_be_decoded_for() -> None:
    assert checked_provisions(only()) == () and not checks_header(only())
    each: List[Dict[str, Any]] = [{"stuck": 1.0}, {"jump": 1.0}, {"not_a_number": True}]
    for limits in each:
        assert len(checked_provisions(only(**limits))) == 1
    unlimited = service(provision(range=None, checks=(OutOfRange(True),)))
    assert checked_provisions(unlimited) == ()
    assert len(checked_provisions(service(provision(checks=(OutOfRange(True),))))) == 1
    for check in (StaleStamp(1.0), FutureStamp(1.0), Frame(True), Length(True)):
        assert checks_header(service(checks=message_checks(check)))
    assert not checks_header(service(checks=message_checks(RateHigh(1.0), RateLow(1.0))))


def test_values_follow_the_provisions_that_are_checked() -> None:
    unchecked = provision(property="speed", field="x", checks=())
    turn = provision(property="turn", field="z", range=(0.0, 1.0))
    bench = Bench(service(provides=(unchecked, turn)))
    assert checked_provisions(service(provides=(unchecked, turn))) == (turn,)
    for _ in range(3):
        bench.send(Message(bench.now, TOPIC, NODE, (2.0,)))
    assert bench.failures[0].detail.startswith("turn is 2, 0 to 1 are allowed; it was never good")


def test_the_first_check_that_finds_something_tells_its_kind() -> None:
    bench = bench_with(not_a_number=True, stale_stamp=0.5, bad=1, of=1)
    bench.stream(1, value=nan, age=9.0)
    assert bench.kinds() == [(NODE, "not_a_number")]


def test_an_event_driven_topic_has_no_rate() -> None:
    checks = message_checks(RateHigh(1.5), RateLow(0.5))
    bench = Bench(service(period=None, checks=checks))
    for _ in range(1000):
        bench.message()
    bench.wait(1000.0)
    bench.stream(100, period=10.0)
    assert bench.failures == []


def test_a_stranger_is_judged_by_any_service_of_its_topic() -> None:
    patient, strict = UnknownPublisher(5.0), UnknownPublisher(0.5)
    bench = Bench(
        service(checks=message_checks(patient)),
        service(name="other", node="/other", checks=message_checks(strict)),
        settings=SETTINGS,
    )
    bench.stream(50)
    both(bench, 1.0)
    assert bench.kinds() == [("/stranger", "unknown_publisher")]
    assert "for 0.5 s" in bench.failures[0].detail


def backwards(**limits: Any) -> Bench:
    """A robot that drives backwards, which nobody saw when its SOM was drafted."""
    names = ("odometry", "left_wheel", "right_wheel")
    services = [
        service(provision(property=each, **limits), name=each, topic="/" + each, node=f"/{each}_n")
        for each in names
    ]
    bench = Bench(*services)
    for each in services:
        bench.connect(each.node, each.topic)
    for step in range(200):
        bench.wait(PERIOD)
        for each in services:
            bench.message(0.2 if step < 50 else -0.35, each.node, each.topic)
    return bench


def test_what_is_not_usual_is_told_once_and_is_no_failure() -> None:
    bench = backwards(range=None, usual=(-0.2, 0.5))
    assert bench.failures == []
    assert len(bench.told) == 3 and "-0.2 to 0.5 are usual" in bench.told[0]
    for health in bench.core.overview():
        assert str(health.condition) == "doubtful" and "is -0.35" in health.detail
    for value, count in ((0.1, Checks.of - 1), (-0.35, 1), (0.1, Checks.of - 1)):
        bench.stream(count, "/odometry_n", value, "/odometry")
        assert "is -0.35" in bench.rows["/odometry", "/odometry_n"].detail
    bench.stream(1, "/odometry_n", 0.1, "/odometry")
    assert bench.rows["/odometry", "/odometry_n"].detail == ""


def test_what_is_not_usual_again_and_again_is_told_once_of_each_value() -> None:
    bench = backwards(range=None, usual=(-0.2, 0.5))
    for number in range(5):
        bench.stream(20, "/odometry_n", 0.1, "/odometry")
        bench.stream(20, "/odometry_n", -0.3 - 0.01 * number, "/odometry")
    assert len(bench.told) == 3


def fed(*names: str) -> Bench:
    """A chain of services, each computed from the one before; all do well."""
    chain = [
        service(
            provision(property=each),
            name=each,
            topic="/" + each,
            node=f"/{each}_n",
            derived_from=tuple(names[place - 1 : place]),
        )
        for place, each in enumerate(names)
    ]
    bench = Bench(*chain)
    for each in chain:
        bench.connect(each.node, each.topic)
    feed(bench, *names)
    return bench


def feed(bench: Bench, *names: str, value: Optional[float] = None, count: int = 100) -> None:
    """Stream a value, else noise, on topics at the same time, the last one first."""
    for number in range(count):
        bench.wait(PERIOD)
        for name in reversed(names):
            given = 1.0 + 1e-3 * (number * 5 % 11) if value is None else value
            bench.message(given, f"/{name}_n", "/" + name)


@pytest.mark.parametrize("value, kind", [(nan, "not_a_number"), (99.0, "out_of_range")])
def test_who_passes_on_what_is_wrong_is_not_blamed(value: float, kind: str) -> None:
    bench = fed("imu", "filtered", "slow")
    feed(bench, "imu", "filtered", "slow", value=value)
    assert bench.kinds() == [("/imu_n", kind)]
    assert "what it is computed from is wrong" in bench.rows["/slow", "/slow_n"].detail
    feed(bench, "imu", "filtered", "slow")
    feed(bench, "slow", value=value, count=5)
    assert bench.kinds()[1:] == [("/slow_n", kind)]


def test_who_passes_on_what_comes_too_seldom_is_not_blamed() -> None:
    bench = fed("imu", "filtered")
    for _ in range(60):
        bench.wait(2 * PERIOD)
        bench.message(1.0, "/filtered_n", "/filtered")
        bench.message(1.0, "/imu_n", "/imu")
    assert bench.kinds() == [("/imu_n", "rate_low")]


def test_who_passes_on_what_a_substitute_holds_is_not_stuck() -> None:
    bench = fed("imu", "filtered")
    feed(bench, "imu", "filtered", count=500)
    bench.disconnect("/imu_n", "/imu")
    bench.connect("/substitute_1", "/imu")
    bench.send(
        SubstitutionsChanged(bench.now, (row("/substitute_1", True, "/imu", service="imu"),))
    )
    for _ in range(400):
        bench.wait(PERIOD)
        bench.message(1.0045, "/substitute_1", "/imu")
        bench.message(1.0045, "/filtered_n", "/filtered")
    assert bench.kinds() == [("/imu_n", "node_gone")]
    assert "is a substitute's" in bench.rows["/filtered", "/filtered_n"].detail


def test_several_nodes_out_of_range_at_once_accuse_the_som_or_the_world() -> None:
    bench = backwards(range=(-0.2, 0.5))
    assert bench.failures == [] and len(bench.told) == 3
    assert "the SOM may be wrong, or the world" in bench.rows["/odometry", "/odometry_n"].detail


def test_services_that_fail_together_are_one_that_is_out_of_range() -> None:
    both = [
        service(name=each, topic="/" + each, node=f"/{each}_n", fails_with=("usb_hub",))
        for each in ("one", "two")
    ]
    bench = Bench(*both)
    for _ in range(3):
        bench.wait(PERIOD)
        for each in both:
            bench.message(99.0, each.node, each.topic)
    assert bench.kinds() == [("/one_n", "out_of_range"), ("/two_n", "out_of_range")]
