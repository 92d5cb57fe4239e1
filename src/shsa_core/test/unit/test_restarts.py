"""A node is started again if it was ended for that, once, and while it is not there."""
import hosts_robot
import pytest
from core_robot import SOM, A, Robot, changed, has
from hosts_robot import BOARD, PI, WAIT, lost, steady

from shsa_core.healing import events
from shsa_core.healing.incident import State
from shsa_core.model.kinds import Policy

RESTARTED = changed(SOM, "a", policy=Policy.RESTART_AND_SUBSTITUTE)


def starts(robot: Robot, *times: float) -> int:
    """Return how often the node of /a is started as time passes."""
    mark = len(robot.said)
    for time in times:
        robot.handle(events.Tick(time))
    return sum(isinstance(each, events.RestartNode) for each in robot.said[mark:])


def died(robot: Robot, time: float) -> None:
    """The node of /a dies, and is known to be gone."""
    robot.fail("/a", A, time)
    robot.killed(time + 0.01, A)


def test_a_late_word_that_the_start_failed_starts_no_second_one() -> None:
    robot = Robot(RESTARTED)
    died(robot, 10.0)
    assert starts(robot, 10.6) == 1
    robot.back(11.0)
    robot.handle(events.RestartFailed(11.1, A, "its computer did not answer"))
    incident = robot.core.incident("a")
    assert incident is not None and incident.state is State.RETURNING
    assert starts(robot, 11.5, 12.0, 12.9) == 0


def test_nor_is_it_started_twice_as_it_comes_up() -> None:
    robot = Robot(RESTARTED)
    died(robot, 10.0)
    assert starts(robot, 10.6) == 1
    robot.connects(11.0, "/a", A)
    assert robot.handle(events.RestartFailed(11.5, A, "the agent was not heard")) == []
    assert starts(robot, 12.6, 15.0, 20.0) == 0
    assert has(robot.handle(events.Tick(20.7)), events.FindNode), "it did not come back in time"


def test_a_node_beside_another_publisher_is_not_ended_to_be_started_again() -> None:
    robot = Robot(RESTARTED)
    robot.handle(events.GraphSeen(2.0, (), ((A, ("takes /cmd_vel",)),)))
    robot.connects(4.0, "/a", "/other")
    robot.row("/a", "/other", "healthy", 5.0)
    robot.table(5.0)
    commands = robot.fail("/a", A, 10.0, "out_of_range")
    assert not has(commands, events.FindNode), "nothing would start it again"


def test_a_node_is_started_again_though_another_one_publishes_by_then() -> None:
    robot = Robot(RESTARTED)
    died(robot, 10.0)
    robot.row("/a", "/other", "healthy", 10.2)
    robot.table(10.21)
    assert starts(robot, 10.6) == 1
    robot.back(11.0)
    assert starts(robot, 11.5, 12.1, 13.0) == 0
    assert robot.core.incident("a") is None


def test_what_is_started_beside_another_publisher_is_not_ended_as_late() -> None:
    robot = Robot(RESTARTED, hold_off=30.0)
    died(robot, 10.0)
    robot.row("/a", "/other", "healthy", 10.2)
    robot.table(10.21)
    assert starts(robot, 10.6) == 1
    robot.back(11.0)
    assert not has(robot.handle(events.Tick(25.0)), events.FindNode)


def test_a_node_is_started_again_that_its_policy_did_not_start_when_it_was_killed() -> None:
    robot = Robot()
    robot.heal(10.0)
    robot.handle(events.SomChanged(12.0, RESTARTED))
    assert starts(robot, 12.6) == 1


def test_a_start_that_was_called_off_by_another_policy_is_due_again() -> None:
    robot = Robot(RESTARTED)
    died(robot, 10.0)
    robot.handle(events.SomChanged(10.2, SOM))
    assert starts(robot, 10.6, 11.0) == 0
    robot.handle(events.SomChanged(11.0, RESTARTED))
    assert starts(robot, 11.9, 12.5) == 1


def test_a_start_that_was_due_as_its_computer_was_lost_is_made_up_for() -> None:
    waits = hosts_robot.som(policy=Policy.RESTART_AND_SUBSTITUTE, on_partition=WAIT)
    robot = Robot(waits)
    steady(robot, 1.0, 10.0, PI, BOARD)
    died(robot, 10.0)
    lost(robot, 10.3, PI)
    assert starts(robot, 10.6) == 0
    steady(robot, 10.7, 20.0, PI, BOARD)
    assert [each for each in robot.said if isinstance(each, events.RestartNode)]


@pytest.mark.parametrize("policy", [Policy.RESTART, Policy.RESTART_AND_SUBSTITUTE])
def test_a_node_that_is_released_is_started_again_as_often_as_before(policy: Policy) -> None:
    robot = Robot(changed(SOM, "a", policy=policy), node_restarts=1)
    died(robot, 10.0)
    assert starts(robot, 10.6) == 1
    robot.handle(events.RestartFailed(10.7, A, "no such file"))
    assert starts(robot, 12.0, 40.0) == 0
    robot.handle(events.Released(50.0, "a"))
    assert starts(robot, 50.6) == 1
    robot.handle(events.RestartFailed(50.7, A, "no such file"))
    assert starts(robot, 52.0, 90.0) == 0


@pytest.mark.parametrize("policy", [Policy.RESTART, Policy.RESTART_AND_SUBSTITUTE])
def test_what_ends_with_its_launch_is_not_started_again(policy: Policy) -> None:
    robot = Robot(changed(SOM, "a", policy=policy))
    died(robot, 10.0)
    assert starts(robot, 10.6) == 1
    robot.handle(events.NodeRestarted(10.7, A))
    robot.back(12.0)
    robot.handle(events.Tick(15.0))
    assert has(robot.handle(events.StarterEnded(100.0, A)), events.StopNode)
    died(robot, 100.1)
    assert starts(robot, 101.0, 150.0) == 0
    robot.back(200.0)  # in another launch
    robot.handle(events.NodeLearned(200.1, A, True, starts=True))
    robot.handle(events.Tick(205.0))
    died(robot, 300.0)
    assert starts(robot, 300.6) == 1


def test_nothing_is_started_beside_what_is_still_being_ended() -> None:
    robot = Robot(RESTARTED)
    robot.handle(events.GraphSeen(2.0, (), ((A, ("takes /cmd_vel",)),)))
    robot.row("/a", "/other", "healthy", 9.0)
    robot.connects(9.0, "/a", A)
    robot.fail("/a", "/other", 10.0)
    robot.killed(10.1, "/other")
    assert has(robot.fail("/a", A, 11.0, "out_of_range"), events.FindNode)
    robot.handle(events.SomChanged(11.1, changed(RESTARTED, "a", prefer=("/b",))))
    assert starts(robot, 11.7, 12.0) == 0
    robot.killed(12.5, A)
    assert starts(robot, 13.1) == 1
