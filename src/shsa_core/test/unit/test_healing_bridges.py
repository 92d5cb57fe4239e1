"""Rows that let a muted substitute fill in for a late original, and when."""
from dataclasses import replace
from typing import Any, Tuple

import pytest
from core_robot import SOM, A, Robot, has, last_incident, only

from shsa_core.healing import events
from shsa_core.healing.incident import State
from shsa_core.model.health import PublisherHealth, PublisherState
from shsa_core.model.kinds import Kind, Policy, Standby
from shsa_core.model.service import Service
from shsa_core.model.som import Som

PERIOD = 0.02


def som(*more: Service, **of: Any) -> Som:
    first, *rest = SOM
    return Som([replace(first, **{"standby": Standby.HOT, **of}), *rest, *more])


def bridges(robot: Robot) -> Tuple[Tuple[bool, float], ...]:
    """Return whether each substitute publishes, and how long it waits otherwise."""
    return tuple((row.publishing, row.bridge) for row in robot.working())


@pytest.mark.parametrize(
    "of, periods",
    [
        ({}, 2.5),
        ({"bridge": 4.0}, 4.0),
        ({"bridge": 0.0}, 0.0),
        ({"period": None}, 0.0),
        ({"policy": Policy.ADVISE}, 0.0),
    ],
)
def test_a_hot_substitute_bridges_unless_the_som_says_otherwise(of: Any, periods: float) -> None:
    robot = Robot(som(**of))
    assert all(bridge == pytest.approx(periods * PERIOD) for _, bridge in bridges(robot))
    assert bridges(robot) or of.get("policy") is Policy.ADVISE


def test_warm_and_cold_have_no_usual_bridge() -> None:
    hot, warm = som(), som(standby=Standby.WARM)
    assert (hot.services["a"].bridges, warm.services["a"].bridges) == (2.5, None)
    assert som(standby=Standby.WARM, bridge=3.0).services["a"].bridges == 3.0


def test_on_a_shared_topic_nobody_bridges() -> None:
    other = replace(SOM.services["a"], name="other", node="/other", needed=False)
    assert all(bridge == 0.0 for _, bridge in bridges(Robot(som(other))))


def test_a_row_bridges_while_its_node_may_speak() -> None:
    robot = Robot(som())
    assert bridges(robot) == ((False, 2.5 * PERIOD),)
    commands = robot.failure("/a", A, 10.0, "silent", "no message for 0.25 s", 9.75)
    assert bridges(robot) == ((True, 0.0),)
    row = only(commands, events.ShowSubstitutions).rows[0]
    assert (row.publishing, row.bridge) == (True, 0.0)  # in one word: no gap, and no second one
    robot.killed(10.1, A)
    assert bridges(robot) == ((True, 0.0),)
    robot.row("/a", A, "healthy", 15.0)
    commands = robot.table(15.1)
    assert last_incident(commands).state is State.RETURNING
    assert bridges(robot) == ((False, 2.5 * PERIOD),)  # it counts how steady that is
    robot = Robot(som())
    robot.failure("/a", A, 10.0, "out_of_range", "1000 is not in it", 9.95)
    assert bridges(robot) == ((False, 2.5 * PERIOD),)  # it still babbles, perhaps seldom
    gone = PublisherHealth(
        "/a", A, PublisherState.FAILED, 10.0, 1.0, 9.95, Kind.NODE_GONE, "its connection was lost"
    )
    robot.rows["/a", A] = gone
    robot.table(10.02)  # its process may take a while longer
    assert bridges(robot) == ((True, 0.0),)


def test_where_another_node_carries_on_that_one_is_filled_in_for() -> None:
    """The row names the node of the SOM as the provider only while that does well."""
    robot = Robot(som())
    robot.row("/a", "/spare", "healthy", 2.0)
    robot.table(2.0)
    assert [row.provider for row in robot.working()] == [A]
    commands = robot.failure("/a", A, 10.0, "silent", "no message for 0.25 s", 9.75)
    assert "/spare carries on" in str(commands)
    robot.row("/a", A, "failed", 10.0)
    robot.table(10.0)
    assert bridges(robot) == ((False, 2.5 * PERIOD),)
    assert [row.provider for row in robot.working()] == [""]
    robot.row("/a", A, "healthy", 11.0)
    robot.table(11.0)
    assert [row.provider for row in robot.working()] == [A]


def test_a_bridge_that_is_heard_before_the_node_is_known_to_be_gone_goes_on() -> None:
    """A substitute sees the end of a connection itself, and may be heard before we are told."""
    robot = Robot(som())
    (row,) = robot.working()
    robot.failure("/a", A, 10.0, "rate_low", "too few came", 9.95)
    robot.row("/a", row.node, "healthy", 10.012, first=10.012)
    commands = robot.table(10.014)
    assert last_incident(commands).state is State.HEALED
    assert bridges(robot) == ((False, 2.5 * PERIOD),)  # its process is yet to be ended
    robot.rows["/a", A] = PublisherHealth(
        "/a", A, PublisherState.FAILED, 10.0, 1.0, 9.95, Kind.NODE_GONE, "its connection was lost"
    )
    robot.table(10.02)
    assert bridges(robot) == ((True, 0.0),)
    robot.killed(10.1, A)
    assert bridges(robot) == ((True, 0.0),)


def test_a_substitute_that_is_only_slow_goes_on_where_there_is_no_other() -> None:
    """On a busy computer: what it computes is right, and to end it would leave nothing."""
    robot = Robot(som())
    (row,) = robot.working()
    robot.failure("/a", A, 10.0, "node_gone", "its connection was lost", 9.95)
    robot.row("/a", row.node, "healthy", 10.012, first=10.012)
    assert last_incident(robot.table(10.014)).state is State.HEALED
    slow = robot.failure("/a", row.node, 12.0, "rate_low", "too few came", 11.99)
    assert has(slow, events.StopNode), "there is another"
    (other,) = robot.working()
    robot.row("/a", other.node, "healthy", 12.3, first=12.3)
    assert last_incident(robot.table(12.4)).state is State.HEALED
    slow = robot.failure("/a", other.node, 14.0, "rate_low", "too few came", 13.99)
    assert not has(slow, events.StopNode) and bridges(robot) == ((True, 0.0),)
    stuck = robot.failure("/a", other.node, 15.0, "stuck", "it stands", 14.9)
    assert has(stuck, events.StopNode)


@pytest.mark.parametrize("first", (10.01, 9.99999))
def test_what_a_bridge_said_before_its_row_had_it_publish_is_its_first_message(
    first: float,
) -> None:
    """A moment is never quite the same through two clocks."""
    robot = Robot(som())
    (row,) = robot.working()
    robot.row("/a", row.node, "healthy", first, first=first)
    robot.rows["/a", A] = PublisherHealth(
        "/a", A, PublisherState.FAILED, 10.0, 1.0, 9.98, Kind.NODE_GONE, "its connection was lost"
    )
    incident = last_incident(robot.table(10.02))
    assert incident.state is State.HEALED
    assert incident.outage == pytest.approx(first - 9.98)
