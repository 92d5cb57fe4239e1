"""How long the monitor waits for somebody to come: at the start, and after another monitor."""
from typing import List

from monitor_bench import NODE, TOPIC, Bench, service
from shsa_core.model.kinds import Kind
from shsa_core.monitoring.events import Command, FormerlyHealthy, RobotAwaited, Tick

OTHERS = [(f"/topic_{number}", f"/node_{number}") for number in range(4)]


def awaited(commands: List[Command]) -> List[RobotAwaited]:
    return [each for each in commands if isinstance(each, RobotAwaited)]


def test_a_robot_that_is_not_there_is_awaited_and_nobody_has_failed() -> None:
    bench = Bench(alone=True)
    bench.wait(14.0)
    told: List[RobotAwaited] = []
    for _ in range(100):
        bench.now += 1.0
        told += awaited(bench.send(Tick(bench.now)))
    assert bench.failures == []
    assert [each.services for each in told] == [((TOPIC, NODE),)]


def test_once_the_robot_comes_the_rest_has_the_grace_from_then_on() -> None:
    topic, node = OTHERS[0]
    bench = Bench(service(), service(name="other", topic=topic, node=node), alone=True)
    bench.wait(100.0)
    bench.connect()
    bench.stream(700)
    assert bench.failures == []
    bench.stream(200)
    assert [each.service for each in bench.failures] == ["other"]


def test_who_was_well_before_has_no_time_to_come_up() -> None:
    bench = Bench(alone=True)
    bench.send(FormerlyHealthy(bench.now, ((TOPIC, NODE),)))
    bench.wait(1.0)
    (failure,) = bench.failures
    assert (failure.publisher, failure.kind) == (NODE, Kind.NEVER_PUBLISHED)
    assert failure.time - 100.0 <= 0.8


def test_who_was_well_and_is_heard_has_not_failed() -> None:
    bench = Bench(alone=True)
    bench.send(FormerlyHealthy(bench.now, ((TOPIC, NODE),)))
    bench.connect()
    bench.stream(200)
    assert bench.failures == []


def test_who_was_well_and_is_connected_but_silent_is_blamed_by_name() -> None:
    bench = Bench(alone=True)
    bench.send(FormerlyHealthy(bench.now, ((TOPIC, NODE),)))
    bench.connect()
    bench.wait(1.0)
    assert [each.publisher for each in bench.failures] == [NODE]


def test_several_that_are_not_heard_are_not_connected_yet() -> None:
    bench = Bench(
        *(service(name=node, topic=topic, node=node) for topic, node in OTHERS), alone=True
    )
    bench.send(FormerlyHealthy(bench.now, tuple(OTHERS)))
    bench.wait(4.0)
    assert bench.failures == []
    bench.wait(2.0)
    assert len(bench.failures) == 4


def test_what_the_reconfigurator_says_later_changes_nothing() -> None:
    bench = Bench()
    bench.connect()
    bench.stream(10)
    bench.send(FormerlyHealthy(bench.now, ((TOPIC, NODE), ("/unknown", "/nobody"))))
    bench.stream(100)
    assert bench.failures == []
