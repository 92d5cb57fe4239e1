"""What the SOM does not call needed is healed while a node outside healing subscribes to it."""
from dataclasses import replace
from typing import Optional, Tuple

import pytest
from core_robot import A, B, Robot, has, last_incident, service

from shsa_core.healing import events
from shsa_core.healing.incident import State
from shsa_core.model.cost import Host
from shsa_core.model.som import Som

CONSUMERS = ("/planner", "/logger")


def robot_of(needed: Optional[bool] = None) -> Robot:
    return Robot(Som([replace(service("a", A), needed=needed), service("b", B)]))


def subscribe(robot: Robot, time: float, *nodes: str) -> None:
    robot.handle(events.GraphSeen(time, (("/a", nodes), ("/no_service", nodes))))


@pytest.mark.parametrize(
    "needed, nodes, healed",
    [
        (None, CONSUMERS, True),
        (None, (), False),
        (None, ("/monitor", "/substitute_x_3", "/rostopic_1_2", "/record_5"), False),
        (True, (), True),
        (False, CONSUMERS, False),
    ],
)
def test_who_subscribes_decides_where_the_som_says_nothing(
    needed: Optional[bool], nodes: Tuple[str, ...], healed: bool
) -> None:
    robot = robot_of(needed)
    subscribe(robot, 5.0, *nodes)
    assert has(robot.fail("/a", A, 10.0), events.StartSubstitute) is healed
    state = robot.core.robot.availability.states.rows["a"]
    assert (state.service.needed, len(state.consumers)) == (healed, len({*nodes} & {*CONSUMERS}))


def test_the_monitors_of_other_computers_rely_on_nothing() -> None:
    services = replace(service("a", A), needed=None), service("b", B)
    robot = Robot(Som(services, [Host("pi")]))
    subscribe(robot, 5.0, "/monitor_pi")
    assert not has(robot.fail("/a", A, 10.0), events.StartSubstitute)
    robot = Robot(Som(services, [Host("pi")]))
    subscribe(robot, 5.0, "/monitor_arm")
    assert has(robot.fail("/a", A, 10.0), events.StartSubstitute)


def test_a_consumer_that_starts_anew_meanwhile_still_finds_its_topic_healed() -> None:
    robot = robot_of()
    subscribe(robot, 5.0, *CONSUMERS)
    robot.fail("/a", A, 10.0)
    subscribe(robot, 11.0)
    assert last_incident(robot.said).state is not State.ENDED
    assert robot.core.robot.som.services["a"].needed
