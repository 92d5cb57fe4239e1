"""Hot substitutes are started a few at a time; what a failure needs never waits."""
from math import inf
from typing import List, Tuple

import pytest

from core_robot import B, Robot, function, service
from shsa_core.healing import events
from shsa_core.model.kinds import Standby
from shsa_core.model.ontology import Ontology, Property
from shsa_core.model.som import Som
from shsa_core.planning.pool import Starts
from shsa_core.planning.settings import AT_ONCE, START_S

HOT = ("u", "v", "w", "x", "y")


def started(said: List[events.Command]) -> List[str]:
    return [each.node for each in said if isinstance(each, events.StartSubstitute)]


def test_no_more_than_a_few_come_up_at_a_time() -> None:
    starts = Starts()
    for number in range(AT_ONCE):
        assert starts.may(1.0, f"s{number}")
        starts.began(1.0, f"n{number}")
    assert not starts.may(1.0, "next") and not starts.may(1.0, "last")
    assert starts.due(1.1) == []
    starts.over("n0")
    assert starts.due(1.2) == ["next"] and starts.may(1.2, "next")


def test_one_that_is_never_heard_holds_nobody_up_for_good() -> None:
    starts = Starts()
    for number in range(AT_ONCE):
        starts.began(1.0, f"n{number}")
    assert not starts.may(1.0, "next")
    assert starts.deadline == 1.0 + START_S
    assert starts.due(1.0 + START_S) == ["next"]
    assert not starts.waiting, "each has one turn"
    assert starts.deadline == inf


def test_nobody_wakes_up_for_room_that_is_not_there() -> None:
    starts = Starts()
    for number in range(AT_ONCE):
        starts.began(1.0, f"old_{number}")
    assert not starts.may(1.0, "next")
    later = 1.0 + START_S
    for number in range(AT_ONCE):  # a failure asks for no room
        starts.began(later, f"needed_{number}")
    assert starts.due(later) == [] and starts.deadline == later + START_S


def robot_of(standby: Standby) -> Tuple[Som, Ontology]:
    """Five services, each of a node of its own, and what computes them."""
    lost = [service(name, f"/{name}_node", needed=True, standby=standby) for name in HOT]
    names = [*HOT, "b"]
    functions = [function(f"r_{name}", name, "b + 1", 0.9) for name in HOT]
    ontology = Ontology({name: Property(name) for name in names}, {}, functions)
    return Som([*lost, service("b", B)]), ontology


def hot_robot() -> Robot:
    return Robot(*robot_of(Standby.HOT))


def test_hot_substitutes_are_started_one_after_another_as_they_are_heard() -> None:
    robot = hot_robot()
    robot.said, first = [], started(robot.said)
    assert len(first) == AT_ONCE
    assert robot.core.deadline == 1.0 + START_S
    seen = list(first)
    for node in first:
        (following,) = started(robot.handle(events.ProcessPulse(1.5, node, True)))
        seen.append(following)
    assert started(robot.handle(events.ProcessExited(1.6, seen[-1], "it crashed"))), "its turn"


def test_a_failure_is_taken_over_at_once_by_one_that_waits_for_its_start() -> None:
    robot = hot_robot()
    working = {row.service for row in robot.working()}
    waits = next(name for name in HOT if name not in working)
    commands = robot.fail(f"/{waits}", f"/{waits}_node", 1.1)
    assert len(started(commands)) == 1


def test_in_the_end_every_hot_service_has_its_substitute_though_none_is_ever_heard() -> None:
    robot = hot_robot()
    for step in range(1, len(HOT)):
        robot.handle(events.Tick(1.0 + step * START_S))
    assert {row.service for row in robot.working()} == set(HOT)


@pytest.mark.parametrize("end", [events.ShuttingDown, events.LaunchEnding])
def test_what_still_waits_at_the_end_is_not_started(end: type) -> None:
    robot = hot_robot()
    time = 1.0 + START_S
    assert not started(robot.handle(end(time)))
    assert not started(robot.handle(events.Tick(time + START_S)))


def preparing(som: Som, ontology: Ontology) -> Robot:
    """A robot whose healing has just begun, and is about to have a process to fork from."""
    robot = Robot(Som([]), ontology)
    robot.handle(events.Started(1.0, preparing=True))
    robot.handle(events.SomChanged(1.0, som))
    for each in som:
        robot.row(each.topic, each.node, "healthy", 0.0)
    robot.table(1.1)
    robot.idle(1.1)
    return robot


@pytest.mark.parametrize("standby", [Standby.HOT, Standby.WARM])
def test_what_stands_by_is_started_once_it_can_be_forked(standby: Standby) -> None:
    robot = preparing(*robot_of(standby))
    assert not started(robot.said)
    assert robot.core.deadline == 1.0 + START_S, "nobody asks again and again"
    assert started(robot.handle(events.Prepared(1.5)))


@pytest.mark.parametrize("standby", [Standby.HOT, Standby.WARM])
def test_what_stands_by_is_started_though_it_can_never_be_forked(standby: Standby) -> None:
    robot = preparing(*robot_of(standby))
    assert started(robot.handle(events.Tick(1.0 + START_S)))


@pytest.mark.parametrize("standby", [Standby.HOT, Standby.WARM])
def test_a_failure_does_not_wait_until_its_substitute_can_be_forked(standby: Standby) -> None:
    robot = preparing(*robot_of(standby))
    assert len(started(robot.fail("/u", "/u_node", 1.2))) == 1
