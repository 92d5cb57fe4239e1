"""A node is started again if it was ended for that, once, and while it is not there."""
from core_robot import SOM, A, Robot, changed, has

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
