"""A node that is kept, kept out or awaited: what else happens to it, and to its topic."""
from dataclasses import replace

from core_robot import A, ONTOLOGY, SOM, Robot, changed, has
from shsa_core.healing import events
from shsa_core.healing.events import AskToLeave, FindNode, NodeFound, Where
from shsa_core.healing.incident import State
from shsa_core.model.kinds import Kind, Policy

NOTHING_REPLACES = replace(ONTOLOGY, functions=[])


def wrong(robot: Robot, time: float) -> None:
    robot.row("/a", A, "failed", time)
    robot.rows["/a", A] = replace(robot.rows["/a", A], kind=Kind.OUT_OF_RANGE)
    robot.table(time)


def ticks(robot: Robot, begin: float, end: float) -> None:
    while begin < end:
        robot.handle(events.Tick(begin))
        begin += 0.5


def kept_out() -> Robot:
    """Return a robot whose node came back, and failed at once again: it is gone."""
    robot = Robot(switches=1)
    robot.heal(10.0)
    robot.back(20.0)
    robot.fail("/a", A, 21.0)
    robot.killed(21.01, A)
    return robot


def test_a_stranger_does_not_cancel_the_start_of_a_node() -> None:
    robot = Robot(changed(SOM, "a", policy=Policy.RESTART))
    robot.fail("/a", A, 10.0)
    robot.killed(10.01, A)
    robot.failure("/a", "/stranger", 10.2, "unknown_publisher", "nobody names it", None)
    ticks(robot, 11.0, 30.0)
    assert has(robot.said, events.RestartNode)


def test_a_wrong_node_that_was_kept_is_ended_once_another_publishes() -> None:
    robot = Robot(SOM, NOTHING_REPLACES)
    robot.row("/a", "/other", "failed", 5.0)
    robot.rows["/a", "/other"] = replace(robot.rows["/a", "/other"], kind=Kind.SILENT)
    robot.table(5.0)
    wrong(robot, 10.0)
    assert not has(robot.said, FindNode)
    robot.row("/a", "/other", "healthy", 20.0)
    assert has(robot.table(20.0), FindNode)


def test_a_refused_node_that_may_not_be_ended_is_let_in() -> None:
    robot = kept_out()
    assert has(robot.back(30.0), FindNode)
    robot.handle(NodeFound(30.05, A, Where.PROTECTED, "it manages nodelets"))
    ticks(robot, 31.0, 40.0)
    incident = robot.core.incident("a")
    assert incident is None or incident.state is not State.HEALED


def test_a_late_word_starts_no_node_beside_its_own_end() -> None:
    robot = Robot(changed(SOM, "a", policy=Policy.RESTART_AND_SUBSTITUTE))
    robot.fail("/a", A, 10.0)
    robot.killed(10.01, A)
    robot.handle(events.Tick(10.6))
    robot.back(11.0)
    wrong(robot, 11.5)
    robot.said.clear()
    robot.handle(events.RestartFailed(11.6, A, "no answer"))
    ticks(robot, 11.8, 13.0)
    assert not has(robot.said, events.RestartNode)


def test_a_node_whose_launch_has_ended_is_not_ended_to_be_started_again() -> None:
    robot = Robot(changed(SOM, "a", policy=Policy.RESTART_AND_SUBSTITUTE), NOTHING_REPLACES)
    robot.handle(events.GraphSeen(2.0, (), ((A, ("takes /cmd_vel",)),)))
    robot.handle(events.StarterEnded(5.0, A))
    wrong(robot, 10.0)
    assert not has(robot.said, FindNode)


def test_a_kept_node_is_not_shown_as_kept_out() -> None:
    robot = Robot(SOM, NOTHING_REPLACES)
    for time in (10.0, 11.5, 13.0, 14.5, 16.0):
        wrong(robot, time)
        robot.back(time + 1.0)
    incident = robot.core.incident("a")
    assert incident is not None and not incident.kept_out
    assert not has(robot.said, AskToLeave)
