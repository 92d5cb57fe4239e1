"""The time that the monitor waits for nodes: at the start, and after another monitor."""
from typing import List

import pytest

from monitor_bench import NODE, PERIOD, SETTINGS, TOPIC, Bench, service
from shsa_core.model.kinds import Kind
from shsa_core.model.log import Log
from shsa_core.monitoring.events import ClockTicked, Command, Ending, FormerlyHealthy
from shsa_core.monitoring.events import Subscribed, Tick

OTHERS = [(f"/topic_{number}", f"/node_{number}") for number in range(4)]


def awaited(commands: List[Command]) -> List[str]:
    return [each.text for each in commands if isinstance(each, Log)]


def test_a_robot_that_is_not_there_is_awaited_and_nobody_has_failed() -> None:
    bench = Bench(alone=True)
    bench.wait(14.0)
    told: List[str] = []
    for _ in range(100):
        bench.now += 1.0
        told += awaited(bench.send(Tick(bench.now)))
    assert bench.failures == []
    assert told == [f"No node of the SOM is there yet. Waiting for: {TOPIC} from {NODE}"]


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
    assert failure.since - 100.0 <= 0.8


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


def test_who_was_well_is_missed_though_another_one_is_heard_first() -> None:
    """A substitute that fills in may be heard before the table says that it is one."""
    bench = Bench(alone=True)
    bench.send(FormerlyHealthy(bench.now, ((TOPIC, NODE),)))
    bench.connect("/substitute_1")
    bench.stream(10, node="/substitute_1")
    bench.substitutes(("/substitute_1", False))
    bench.wait(1.0)
    assert [each.publisher for each in bench.failures] == [NODE]


@pytest.mark.parametrize(
    "share, there, after", [(0.9, True, 15.0), (0.1, True, 1.0), (0.9, False, 1.0)]
)
def test_who_was_well_and_is_there_has_longer_to_be_heard_on_a_busy_computer(
    share: float, there: bool, after: float
) -> None:
    bench = Bench(alone=True)
    bench.send(FormerlyHealthy(bench.now, ((TOPIC, NODE),)))
    if there:
        bench.connect()
    began = bench.now
    while not bench.failures and bench.now < began + 20.0:
        bench.wait(PERIOD)
        bench.send(ClockTicked(bench.now, bench.now, waited=(("", share * bench.now),)))
    assert after - 0.5 <= bench.failures[0].since - began <= after + 0.1


def test_who_was_well_and_is_gone_before_it_is_heard_has_died() -> None:
    bench = Bench(alone=True)
    bench.send(FormerlyHealthy(bench.now, ((TOPIC, NODE),)))
    bench.connect()
    bench.disconnect()
    assert bench.kinds() == [(NODE, "node_gone")]


def test_who_is_gone_before_it_is_told_that_it_was_well_is_missed_soon() -> None:
    bench = Bench()
    bench.connect()
    bench.disconnect()
    bench.send(FormerlyHealthy(bench.now, ((TOPIC, NODE),)))
    bench.wait(1.0)
    assert bench.kinds() == [(NODE, "never_published")]


def test_several_that_are_not_heard_are_not_connected_yet() -> None:
    bench = Bench(
        *(service(name=node, topic=topic, node=node) for topic, node in OTHERS), alone=True
    )
    bench.send(FormerlyHealthy(bench.now, tuple(OTHERS)))
    bench.wait(SETTINGS.startup_grace - 0.1)
    assert bench.failures == []
    bench.wait(1.0)
    assert len(bench.failures) == 4


def test_what_the_reconfigurator_says_later_changes_nothing() -> None:
    bench = Bench()
    bench.connect()
    bench.stream(10)
    bench.send(FormerlyHealthy(bench.now, ((TOPIC, NODE), ("/unknown", "/nobody"))))
    bench.stream(100)
    assert bench.failures == []


@pytest.mark.parametrize("told_first", [True, False])
def test_who_was_well_and_is_gone_is_missed_though_a_substitute_was_heard(told_first: bool) -> None:
    """It had filled in, and nobody had told yet that it is one."""
    bench = Bench(alone=True)
    bench.connect("/substitute_1")
    bench.stream(20, "/substitute_1")
    if told_first:
        bench.substitutes(("/substitute_1", False))
    bench.send(FormerlyHealthy(bench.now, ((TOPIC, NODE),)))
    bench.substitutes(("/substitute_1", False))
    bench.wait(1.0)
    assert bench.kinds() == [(NODE, "never_published")]


def test_who_was_well_and_was_ended_with_its_launch_is_not_missed() -> None:
    bench = Bench()
    bench.connect()
    bench.stream(60)
    bench.send(Ending(bench.now, (NODE,)))
    bench.disconnect()
    bench.send(FormerlyHealthy(bench.now, ((TOPIC, NODE),)))
    bench.wait(20.0)
    assert bench.failures == []


def slowly_subscribed(bench: Bench) -> None:
    """The topics of OTHERS are watched, and are subscribed one each 20 s."""
    services = (service(name=node, topic=topic, node=node) for topic, node in OTHERS)
    bench.watch(*services, unheard=tuple(topic for topic, _ in OTHERS))


def test_nobody_is_missed_on_a_topic_that_is_not_subscribed_yet() -> None:
    bench = Bench()
    slowly_subscribed(bench)
    for topic, node in OTHERS:
        bench.wait(20.0)
        assert bench.failures == [], "how should anybody be heard?"
        bench.send(Subscribed(bench.now, topic))
        bench.connect(node, topic)
        bench.stream(1, node, topic=topic, period=14.0)
        bench.disconnect(node, topic)
        bench.failures.clear()


def test_who_is_not_heard_once_its_topic_is_subscribed_is_missed_after_the_grace() -> None:
    bench = Bench()
    slowly_subscribed(bench)
    bench.wait(100.0)
    topic, node = OTHERS[2]
    bench.send(Subscribed(bench.now, topic))
    bench.wait(14.9)
    assert bench.failures == []
    bench.wait(0.2)
    assert [each.topic for each in bench.failures] == [topic]


def test_who_was_well_before_is_missed_soon_after_its_topic_is_subscribed() -> None:
    bench = Bench()
    slowly_subscribed(bench)
    topic, node = OTHERS[1]
    bench.send(FormerlyHealthy(bench.now, ((topic, node),)))
    bench.wait(100.0)
    assert bench.failures == []
    bench.send(Subscribed(bench.now, topic))
    bench.wait(1.0)
    (failure,) = bench.failures
    assert (failure.publisher, failure.kind) == (node, Kind.NEVER_PUBLISHED)
    assert "for 0." in failure.detail


def test_a_topic_that_is_subscribed_stays_so_when_others_come() -> None:
    bench = Bench()
    bench.connect()
    bench.stream(10)
    topic, node = OTHERS[0]
    bench.watch(service(), service(name=node, topic=topic, node=node), unheard=(topic,))
    bench.send(Subscribed(bench.now, TOPIC))
    bench.stream(2000)
    assert bench.failures == [] and bench.state() == "healthy"
    bench.send(Subscribed(bench.now, "/unknown"))
