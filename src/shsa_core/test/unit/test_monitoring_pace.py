"""Time that is simulated: slow, paused, fast and jumping; and launches that end."""
from random import Random

import pytest
from monitor_bench import DEADLINE, NODE, PERIOD, SETTINGS, TOPIC, Bench, service

from shsa_core.monitoring.events import ClockTicked, Ending, Message, Tick

CLOCK_S = 0.01


class Simulated:
    """A bench under simulated time: one node follows /clock, another one does not."""

    def __init__(self) -> None:
        self.bench = Bench(service(), service(name="wall", topic="/wall", node="/wall"))
        self.random, self.ros, self.real = Random(0), 50.0, 100.0
        self.tick()
        self.bench.connect()
        self.bench.connect("/wall", "/wall")
        self.due = {TOPIC: self.ros, "/wall": self.real}

    def tick(self) -> None:
        self.bench.send(ClockTicked(self.real, self.ros, True))

    def run(self, seconds: float, rate: float, follows: bool = True, faster: float = 1.0) -> None:
        """Real seconds pass; `follows`: the node that follows the clock lives."""
        for _ in range(round(seconds / CLOCK_S)):
            self.real, self.ros = self.real + CLOCK_S, self.ros + CLOCK_S * rate
            self.bench.now = self.real
            if rate or self.random.random() < 0.1:
                self.tick()
            while follows and self.due[TOPIC] <= self.ros:
                self.due[TOPIC] += PERIOD / faster
                self.send(TOPIC, NODE)
            while self.due["/wall"] <= self.real:
                self.due["/wall"] += PERIOD
                self.send("/wall", "/wall")
            if self.bench.core.next_deadline <= self.real:
                self.bench.send(Tick(self.real))
                assert self.bench.core.next_deadline > self.real

    def send(self, topic: str, node: str) -> None:
        value = self.random.gauss(8.0, 0.1)
        age = self.ros - self.real if topic == "/wall" else 0.0
        self.bench.send(Message(self.real, topic, node, (value,), age=age))


@pytest.mark.parametrize("rate", [0.0, 0.1, 0.45, 1.0, 3.0])
def test_the_rate_of_the_clock_is_nobodys_fault(rate: float) -> None:
    robot = Simulated()
    for each in (1.0, rate, 1.0, rate):
        robot.run(10.0, each)
    assert robot.bench.failures == []
    assert robot.bench.state() == robot.bench.state("/wall", "/wall") == "healthy"


def test_a_clock_that_jumps_is_nobodys_fault() -> None:
    robot = Simulated()
    for jump in (3600.0, -30.0, 0.3):
        robot.run(5.0, 1.0)
        robot.ros += jump
        robot.due[TOPIC] = robot.ros
    robot.run(5.0, 1.0)
    assert robot.bench.failures == []


@pytest.mark.parametrize("rate", [0.45, 1.0, 3.0])
def test_who_is_silent_by_the_clock_is_found(rate: float) -> None:
    robot = Simulated()
    robot.run(10.0, rate)
    began = robot.real
    robot.run(2.0, rate, follows=False)
    assert robot.bench.kinds() == [(NODE, "silent")]
    failure = robot.bench.failures[0]
    assert failure.since - began <= DEADLINE / min(rate, 1.0) + 0.1
    assert failure.last_good is not None and 0.0 < failure.since - failure.last_good <= 0.15


def test_a_paused_clock_hides_silence_and_no_death() -> None:
    robot = Simulated()
    robot.run(10.0, 0.45)
    robot.run(60.0, 0.0, follows=False)
    assert robot.bench.failures == []
    robot.bench.disconnect()
    assert robot.bench.kinds() == [(NODE, "node_gone")]
    assert robot.bench.failures[0].since == robot.real


def test_who_babbles_by_both_clocks_is_found() -> None:
    robot = Simulated()
    robot.run(10.0, 0.45)
    robot.run(10.0, 0.45, faster=8.0)
    assert robot.bench.kinds() == [(NODE, "rate_high")]


@pytest.mark.parametrize("rate, stall", [(2.0, 0.6), (3.0, 0.4), (3.0, 0.6)])
def test_what_waited_for_us_came_by_the_faster_clock(rate: float, stall: float) -> None:
    """All of a rate's messages may come at once: by /clock they waited for longer than by ours."""
    robot = Simulated()
    robot.run(10.0, rate)
    robot.real, robot.ros = robot.real + stall, robot.ros + stall * rate
    robot.bench.now = robot.real
    robot.tick()
    while robot.due[TOPIC] <= robot.ros:
        robot.due[TOPIC] += PERIOD
        value = robot.random.gauss(8.0, 0.1)
        robot.bench.send(Message(robot.real, TOPIC, NODE, (value,), age=0.0, waited=stall))
    assert robot.bench.failures == []


def test_half_the_rate_by_the_clock_is_found() -> None:
    robot = Simulated()
    robot.run(10.0, 0.45)
    robot.run(10.0, 0.45, faster=0.5)
    assert robot.bench.kinds() == [(NODE, "rate_low")]


def test_rows_and_failures_are_told_in_our_time() -> None:
    robot = Simulated()
    robot.run(10.0, 0.0)
    robot.bench.substitutes(("/substitute_1", True))
    robot.bench.connect("/substitute_1")
    row = robot.bench.rows[TOPIC, "/substitute_1"]
    assert row.since == robot.real


# Launches that end


def ending_bench() -> Bench:
    bench = Bench(service(), service(name="other", topic="/other", node="/other"))
    for node, topic in ((NODE, TOPIC), ("/other", "/other")):
        bench.connect(node, topic)
        bench.stream(3, node, topic=topic)
    return bench


def test_who_stops_with_its_launch_has_not_failed_and_is_not_awaited() -> None:
    bench = ending_bench()
    bench.send(Ending(bench.now, (NODE,)))
    bench.wait(2 * DEADLINE)  # it falls silent first
    bench.disconnect()
    bench.wait(10 * SETTINGS.startup_grace)
    assert bench.kinds() == [("/other", "silent")]


def test_who_is_started_again_is_watched_again() -> None:
    bench = ending_bench()
    bench.send(Ending(bench.now, (NODE, "/other")))
    bench.disconnect()
    bench.disconnect("/other", "/other")
    bench.wait(10 * SETTINGS.startup_grace)
    bench.connect()
    bench.stream(3)
    assert bench.state() == "healthy"
    bench.disconnect()
    assert bench.kinds() == [(NODE, "node_gone")]


def test_a_node_of_another_launch_is_no_excuse() -> None:
    bench = ending_bench()
    bench.send(Ending(bench.now, ("/other",)))
    bench.disconnect()
    assert bench.kinds() == [(NODE, "node_gone")]
