"""Learning from a healthy stream: how still a value is, and how old its stamps are."""
import os
from math import nan
from random import Random
from typing import Iterator, List

import pytest
from monitor_bench import NODE, PERIOD, TOPIC, Bench, provision, service, stamped, table

from shsa_core.model.checks import Checks, default_checks
from shsa_core.model.health import PublisherHealth
from shsa_core.model.service import Service
from shsa_core.monitoring.events import ClockTicked, Command, Message, Tick
from shsa_testing.failures import failures_in
from shsa_testing.thorough import many

Values = Iterator[float]


def noise(random: Random, mean: float = 8.0, sigma: float = 0.05) -> Values:
    while True:
        yield random.gauss(mean, sigma)


def quantised(values: Values, step: float) -> Values:
    return (round(value / step) * step for value in values)


def wide() -> Service:
    """A service with the checks that hold where the SOM says nothing."""
    return service(provision(range=(-100.0, 100.0)))


def feed(bench: Bench, values: Values, count: int, age: float = 0.002) -> None:
    for _ in range(count):
        bench.stream(1, value=next(values), age=age)


def bench_with(values: Values, count: int = 500) -> Bench:
    bench = Bench(wide())
    bench.connect()
    feed(bench, values, count)
    assert bench.failures == [] and bench.state() == "healthy"
    return bench


def hold(bench: Bench, value: float, seconds: float) -> None:
    feed(bench, iter([value] * round(seconds / PERIOD)), round(seconds / PERIOD))


# Stuck


def test_a_noisy_signal_that_repeats_its_last_value_is_stuck() -> None:
    random = Random(1)
    for _ in range(many(40)):
        values = noise(random)
        bench = bench_with(values, random.randrange(300, 600))
        hold(bench, next(values), 12.0)  # it may be the highest value so far
        assert bench.kinds() == [(NODE, "stuck")]
    assert "it was never the same in more than 1 before" in bench.failures[0].detail


def test_it_is_stuck_after_a_second() -> None:
    values = noise(Random(2))
    bench = bench_with(values)
    hold(bench, 8.0, 1.0)
    assert bench.failures == []
    hold(bench, 8.0, 0.1)
    assert bench.kinds() == [(NODE, "stuck")]
    feed(bench, values, 10)
    assert bench.state() == "healthy"


def test_what_is_not_known_yet_is_not_judged() -> None:
    bench = bench_with(noise(Random(3)), 100)
    hold(bench, 8.0, 60.0)
    assert bench.failures == []


@pytest.mark.parametrize("steps", [0.5, 1.0, 2.0])
def test_noise_of_few_steps_may_stand_still(steps: float) -> None:
    """With less of it, as at rest, it may do so for ever."""
    bench = bench_with(quantised(noise(Random(4)), 0.05 / steps), 3000)
    hold(bench, 8.0, 600.0)
    assert bench.failures == []


def test_noise_of_many_steps_may_not() -> None:
    values = quantised(noise(Random(5)), 0.05 / 10)
    bench = bench_with(values, 3000)
    hold(bench, 8.0, 5.0)
    assert bench.kinds() == [(NODE, "stuck")]


def test_a_robot_that_stands_may_read_exactly_0() -> None:
    """An encoder has noise while the robot drives, and none while it stands."""
    random = Random(6)
    bench = bench_with(noise(random, 0.5, 0.01), 3000)
    hold(bench, 0.0, 600.0)
    feed(bench, noise(random, -0.5, 0.01), 100)
    hold(bench, 0.0, 600.0)
    assert bench.failures == []


def test_rest_that_was_seen_is_rest_though_the_signal_goes_through_0() -> None:
    bench = Bench(wide())
    bench.connect()
    hold(bench, 0.0, 3.0)
    feed(bench, noise(Random(7), 0.0), 3000)
    hold(bench, 0.0, 600.0)
    assert bench.failures == []


def test_0_is_stuck_for_what_is_noisy_about_0() -> None:
    bench = bench_with(noise(Random(8), 0.0), 1000)
    hold(bench, 0.0, 3.0)
    assert bench.kinds() == [(NODE, "stuck")]


def test_what_moves_without_noise_may_stand_still() -> None:
    """A joint that turns and rests, a simulator without noise."""
    ramp = iter([0.01 * step for step in range(1, 2000)])
    bench = bench_with(ramp, 1500)
    hold(bench, 15.0, 600.0)
    assert bench.failures == []


def test_a_long_rest_that_was_seen_is_remembered_when_the_node_starts_again() -> None:
    random = Random(9)
    bench = Bench(wide())
    bench.connect()
    hold(bench, 3.0, 60.0)
    feed(bench, noise(random), 500)
    bench.disconnect()
    bench.connect()
    feed(bench, noise(random), 30_000)
    bench.failures.clear()
    hold(bench, 8.0, 300.0)
    assert bench.failures == []


def test_a_sensor_at_its_limit_may_stay_there_for_longer() -> None:
    values = noise(Random(10))
    bench = bench_with(values)
    hold(bench, 20.0, 5.0)
    assert bench.failures == []
    hold(bench, 20.0, 10.0)
    assert bench.kinds() == [(NODE, "stuck")]


@pytest.mark.parametrize("limit", [-5.0, 60.0])
def test_what_saturates_at_a_limit_of_its_range_may_stay_there(limit: float) -> None:
    """A motor at full power has no noise, for as long as that is asked of it."""
    bench = Bench(service(provision(range=(-5.0, 60.0))))
    bench.connect()
    feed(bench, noise(Random(10)), 500)
    hold(bench, limit, 60.0)
    assert bench.failures == []


def test_nothing_in_reach_is_no_fault_of_a_lidar() -> None:
    distance = provision(field="ranges[0]", range=None, checks=default_checks(True, True))
    bench = Bench(service(distance))
    bench.connect()
    feed(bench, noise(Random(11)), 500)
    hold(bench, 7.0, 100.0)
    assert bench.failures == []


# Bad now and then


@pytest.mark.parametrize("seed", range(20))
def test_one_in_ten_is_found_and_stays_found(seed: int) -> None:
    random = Random(seed)
    bench = bench_with(noise(random))
    for _ in range(1000):
        value = nan if random.random() < 0.1 else random.gauss(8.0, 0.05)
        bench.stream(1, value=value, age=0.002)
    assert bench.kinds() and set(bench.kinds()) == {(NODE, "not_a_number")}
    assert len(bench.failures) <= 5, "it does not fail anew at every other message"


def test_exactly_one_in_ten_is_found_in_a_second_and_a_half() -> None:
    values = noise(Random(12))
    bench = bench_with(values)
    for step in range(75):
        bench.stream(1, value=nan if step % 10 == 0 else next(values))
    assert bench.kinds() == [(NODE, "not_a_number")]
    for step in range(75, 3000):
        bench.stream(1, value=nan if step % 10 == 0 else next(values))
    assert len(bench.failures) == 1 and bench.state() == "failed"
    feed(bench, values, 50)
    assert bench.state() == "healthy"


def test_one_in_a_hundred_is_noise() -> None:
    values = noise(Random(13))
    bench = bench_with(values)
    for step in range(20_000):
        bench.stream(1, value=nan if step % 100 == 0 else next(values))
    assert bench.failures == []


# Rate


@pytest.mark.parametrize("period", [0.005, 0.02, 0.1, 1.0])
def test_exactly_half_the_rate_is_found(period: float) -> None:
    bench = Bench(service(period=period))
    bench.connect()
    bench.stream(400, period=period)
    began = bench.now
    bench.stream(200, period=2 * period)
    assert bench.kinds() == [(NODE, "rate_low")]
    assert bench.failures[0].since - began <= max(2.0, 50 * period)


def test_three_quarters_of_the_rate_are_no_fault() -> None:
    bench = Bench()
    bench.connect()
    bench.stream(5000, period=PERIOD / 0.75)
    assert bench.failures == []


# Stamps


STALE, FUTURE = (2.0, "stale_stamp"), (-2.0, "future_stamp")


@pytest.mark.parametrize(
    "usual, change, kind",
    [
        *((usual, *STALE) for usual in (0.002, 0.3, 3600.0, -3600.0)),
        *((usual, *FUTURE) for usual in (0.002, 0.3, -3600.0)),
    ],
)
def test_stamps_that_change_their_age_are_found(usual: float, change: float, kind: str) -> None:
    values = noise(Random(14))
    bench = Bench(wide())
    bench.connect()
    feed(bench, values, 300, usual)
    assert bench.failures == []
    feed(bench, values, 3, usual + change)
    assert bench.kinds() == [(NODE, kind)]
    feed(bench, values, 10, usual)
    assert bench.state() == "healthy"


def test_what_waited_before_the_monitor_came_is_no_usual_age() -> None:
    values = noise(Random(22))
    bench = Bench(wide())
    bench.connect()
    for step in range(600):
        late = max(0.0, 3.8 - step * 0.01)
        message = Message(bench.now + step * 0.01, TOPIC, NODE, (next(values),), age=0.002 + late)
        bench.send(message)
    bench.now += 6.0
    bench.failures.clear()  # the rate of what had waited
    feed(bench, values, 300)
    assert bench.failures == []
    feed(bench, values, 5, 2.002)
    assert bench.kinds() == [(NODE, "stale_stamp")]


def jump(bench: Bench, ahead: float) -> None:
    """Our own wall clock is set."""
    bench.send(ClockTicked(bench.now, bench.now + ahead))


def test_a_jump_of_our_own_clock_is_nobodys_fault() -> None:
    values = noise(Random(16))
    bench = Bench(wide())
    jump(bench, 1e9)
    bench.connect()
    feed(bench, values, 300, 0.002)
    for ahead in (60.0, -60.0, 0.0, 3600.0):
        jump(bench, 1e9 + ahead)
        feed(bench, values, 300, 0.002 + ahead)  # of a node on another computer
    assert bench.failures == []
    feed(bench, values, 3, 3602.002)
    assert bench.kinds() == [(NODE, "stale_stamp")]


def test_the_same_stamp_again_is_found_where_stamps_always_grew() -> None:
    """Each message twice, at the usual rate: its data comes at half of it."""
    values = noise(Random(17))
    bench = bench_with(values)
    for _ in range(10):
        bench.stream(1, value=next(values), age=0.002)
        bench.stream(1, value=next(values), age=0.002 + PERIOD)
    assert bench.kinds() == [(NODE, "stale_stamp")]


def test_stamps_in_coarse_steps_are_no_fault() -> None:
    values = noise(Random(18))
    bench = Bench(wide())
    bench.connect()
    for step in range(3000):
        bench.stream(1, value=next(values), age=0.002 + (step % 5) * PERIOD)
    assert bench.failures == []


def test_what_a_node_catches_up_with_in_a_burst_may_have_stamps_as_near_as_that() -> None:
    values = noise(Random(3))
    bench = bench_with(values)
    for _ in range(20):
        bench.wait(4 * PERIOD)
        for step in range(4):
            message = Message(bench.now, TOPIC, NODE, (next(values),), age=0.002 - step * 4e-6)
            bench.send(message)
    assert bench.failures == []


@pytest.mark.parametrize("apart", [4e-6, 1e-9])
def test_a_burst_that_comes_in_parts_has_stamps_as_near_all_the_same(apart: float) -> None:
    """A node is not scheduled while it sends: its last messages come later than stamped."""
    values = noise(Random(4))
    bench = bench_with(values)
    for _ in range(20):
        bench.wait(3 * PERIOD)
        first = round(1e9 * bench.now)
        for step in range(4):
            bench.wait(0.0 if step < 2 else 0.6 * PERIOD)
            stamp = first + round(1e9 * step * apart)
            age = bench.now - 1e-9 * stamp
            bench.send(Message(bench.now, TOPIC, NODE, (next(values),), age=age, stamp=stamp))
        bench.wait(PERIOD)
    assert bench.failures == []


def test_what_was_held_up_on_its_way_is_neither_good_nor_evidence() -> None:
    """A link that was down: what was sent meanwhile comes at once."""
    values = noise(Random(19))
    bench = Bench(service(checks=Checks(tuple(c for c in Checks().each if c.kind != "rate_high"))))
    bench.connect()
    feed(bench, values, 300)
    heard = table(bench.core)[0].last_good
    bench.now += 2.0
    for step in range(100):
        age = 2.0 - step * PERIOD
        message = Message(bench.now + step * 1e-4, TOPIC, NODE, (next(values),), age=age)
        bench.send(message)
        assert table(bench.core)[0].last_good == heard
    assert bench.failures == []


def test_what_comes_after_a_silence_is_as_old_as_it_is() -> None:
    """A link that was down for longer than is allowed: nothing stale is taken for good."""
    values = noise(Random(20))
    bench = bench_with(values)
    bench.wait(20.0)
    assert bench.kinds() == [(NODE, "silent")]
    for step in range(900):
        age = 20.0 - step * PERIOD
        bench.now += 1e-4
        bench.send(Message(bench.now, TOPIC, NODE, (next(values),), age=age))
    assert bench.state() == "failed"
    assert {kind for _, kind in bench.kinds()} <= {"silent", "rate_high"}
    feed(bench, values, 100)
    assert bench.state() == "healthy"


def test_of_a_substitute_nothing_is_learned() -> None:
    """Its program may become one of slower inputs, or of such as stand still."""
    values = noise(Random(21))
    bench = Bench(wide())
    bench.substitutes(("/substitute_1", True))
    bench.connect("/substitute_1")
    for step in range(600):
        bench.stream(1, "/substitute_1", next(values), age=0.002)
    bench.stream(600, "/substitute_1", 8.0, age=1.5)
    assert bench.failures == []


def test_stamps_of_an_event_driven_service_are_not_judged() -> None:
    bench = Bench(service(period=None))
    bench.connect()
    for age in (0.0, 3000.0):
        bench.stream(300, age=age)
    assert bench.failures == []


# No false alarms


def lateness(random: Random, period: float) -> Iterator[float]:
    """As at a busy computer: now and then a gap of up to 2.9 periods; what was due comes after."""
    late = 0.0
    while True:
        late = max(0.0, late - 0.95 * period)
        if random.random() < 0.01:
            late = random.uniform(0.5, 1.9) * period
        yield late


def drives(random: Random) -> Values:
    """A robot that drives with noise and stands without, in legs of seconds to minutes."""
    while True:
        for _ in range(random.randrange(100, 2000)):
            yield random.gauss(0.5, 0.01)
        for _ in range(random.randrange(100, 4000)):
            yield 0.0


STREAMS = {
    "noise": lambda random: noise(random),
    "three steps": lambda random: quantised(noise(random), 0.016),
    "one step": lambda random: quantised(noise(random), 0.05),
    "a fifth of a step": lambda random: quantised(noise(random), 0.25),
    "drives and stands": drives,
    "about 0": lambda random: noise(random, 0.0),
}


HOURS = float(os.environ.get("SHSA_HOURS", "1"))
"""Hours' worth of messages at 50 Hz; they take so many half minutes."""


@pytest.mark.parametrize("name", sorted(STREAMS))
def test_healthy_messages_of_each_kind_make_no_failure(name: str) -> None:
    random = Random(name)
    bench = Bench(wide())
    bench.connect()
    core, values, late = bench.core, STREAMS[name](random), lateness(random, PERIOD)
    failures: List[PublisherHealth] = []
    for number in range(round(HOURS * 3600 / PERIOD / len(STREAMS))):
        age = 0.002 + next(late)
        now = 100.0 + number * PERIOD + age
        if core.next_deadline <= now:
            failures += told(core.handle(Tick(now)))
        message = stamped(Message(now, TOPIC, NODE, (next(values),), age=age))
        failures += told(core.handle(message))
    assert failures == []


def told(said: List[Command]) -> List[PublisherHealth]:
    return failures_in(said)
