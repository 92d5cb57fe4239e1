"""Warm and hot: what the reconfigurator has ready before a failure."""
from dataclasses import replace

import pytest

from core_robot import A, B, C, Robot, has, last_incident, only, publishing, reads, service
from shsa_core.healing import events
from shsa_core.healing.incident import State
from shsa_core.model.kinds import Standby
from shsa_core.model.som import Som


def standby(mode: str) -> Som:
    first = service("a", A, needed=True, standby=Standby(mode))
    return Som([first, service("b", B), service("c", C)])


def test_a_warm_topic_takes_an_idle_process_and_the_pool_is_refilled() -> None:
    robot = Robot(standby("warm"))
    idle = only(robot.said, events.StartSubstitute)
    assert idle.program is None
    commands = robot.fail("/a", A, 10.0)
    assert only(commands, events.AssignSubstitute).node == idle.node
    row = robot.shown[idle.node]
    assert (row.service, row.topics, row.publishing) == ("a", ("/a",), True)
    assert robot.core.deadline == 11.0
    commands = robot.handle(events.Tick(11.0))
    refill = only(commands, events.StartSubstitute)
    assert refill.program is None and refill.node != idle.node
    assert [row.node for row in robot.idle_rows()] == [refill.node]


def test_a_warm_process_that_does_not_publish_soon_makes_room_for_another_with_the_same_plan() -> (
    None
):
    robot = Robot(standby("warm"))
    silent = only(robot.said, events.StartSubstitute).node
    robot.connects(2.0, "/a", silent)
    assert only(robot.fail("/a", A, 10.0), events.AssignSubstitute).node == silent
    robot.killed(10.01, A)
    assert not has(robot.handle(events.Tick(11.9)), events.StopSubstitute)
    commands = robot.handle(events.Tick(12.0))
    assert events.StopSubstitute(silent) in commands
    assert last_incident(commands).state is State.HEALING
    assert last_incident(commands).relations == ("good",)


@pytest.mark.parametrize("mode", ("warm", "hot"))
def test_a_process_that_is_still_starting_is_given_the_time_of_a_start(mode: str) -> None:
    robot = Robot(standby(mode))
    node = only(robot.said, events.StartSubstitute).node  # at 1.0
    assert only(robot.fail("/a", A, 2.0), events.AssignSubstitute).node == node
    robot.killed(2.01, A)
    assert not has(robot.handle(events.Tick(5.9)), events.StopSubstitute)
    robot.connects(5.95, "/a", node)
    assert events.StopSubstitute(node) in robot.handle(events.Tick(6.0))


def test_the_table_tells_idle_processes_what_the_plans_of_warm_services_read_and_give() -> None:
    first, *others = standby("warm")
    second = replace(others[0], needed=True, standby=Standby.WARM)
    hot = replace(others[1], needed=True, standby=Standby.HOT)
    robot = Robot(Som([first, second, hot]))
    prepared = {row.service: row for row in robot.shown.values() if not row.node}
    assert set(prepared) == {"a", "b"}
    assert [signal.path for signal in prepared["a"].inputs] == ["/b/data"]
    assert prepared["a"].topics == ("/a",) and prepared["b"].topics == ("/b",)
    assert not any(row.publishing for row in prepared.values())
    assert len(robot.idle_rows()) == 1


def test_an_idle_process_that_dies_is_replaced_after_a_pause() -> None:
    robot = Robot(standby("warm"))
    idle = only(robot.said, events.StartSubstitute)
    assert not has(
        robot.handle(events.ProcessExited(5.0, idle.node, "status 1")), events.StartSubstitute
    )
    assert robot.core.deadline == 7.0
    assert has(robot.handle(events.Tick(7.0)), events.StartSubstitute)


def test_a_hot_topic_has_a_muted_substitute_that_publishes_at_once() -> None:
    robot = Robot(standby("hot"))
    start = only(robot.said, events.StartSubstitute)
    assert start.program is not None and start.program.inputs == ("/b/data",)
    assert publishing(robot) == (False,)
    commands = robot.fail("/a", A, 10.0)
    assert only(commands, events.AssignSubstitute).node == start.node
    assert not has(commands, events.StartSubstitute)
    assert isinstance(commands[0], events.ShowSubstitutions)
    assert publishing(robot) == (True,)


def test_a_hot_substitute_follows_the_plan_in_the_same_process() -> None:
    robot = Robot(standby("hot"))
    node = only(robot.said, events.StartSubstitute).node
    robot.row("/b", B, "failed", 5.0)
    commands = robot.table(5.0) + robot.idle(5.0)
    assert only(commands, events.AssignSubstitute).node == node
    assert reads(robot, node) == ("/c/data",) and publishing(robot) == (False,)


def test_a_hot_substitute_whose_input_died_with_the_original_is_not_used_as_it_is() -> None:
    robot = Robot(standby("hot"))
    robot.rows.pop(("/b", B))
    robot.row("/b", B, "failed", 10.0)
    robot.table(10.0)
    robot.fail("/a", A, 10.001)
    (row,) = robot.working()
    assert reads(robot, row.node) == ("/c/data",)


def test_a_hot_substitute_stays_muted_after_the_original_returned() -> None:
    robot = Robot(standby("hot"))
    node = only(robot.said, events.StartSubstitute).node
    robot.fail("/a", A, 10.0)
    robot.killed(10.01, A)
    robot.row("/a", node, "healthy", 10.02, first=10.02)
    robot.table(10.03)
    robot.row("/a", A, "healthy", 20.0)
    robot.table(20.0)
    commands = robot.handle(events.Tick(22.5))
    assert last_incident(commands).state is State.ENDED
    assert not has(commands, events.StopSubstitute)
    assert robot.core.substitutes == (node,) and publishing(robot) == (False,)


def test_a_hot_substitute_that_dies_unused_is_started_again_after_a_pause() -> None:
    robot = Robot(standby("hot"))
    node = only(robot.said, events.StartSubstitute).node
    commands = robot.handle(events.ProcessExited(5.0, node, "status 1"))
    assert not has(commands, events.StartSubstitute)
    assert has(robot.handle(events.Tick(7.0)), events.StartSubstitute)


def test_plans_are_made_ahead_and_a_stale_one_is_never_used() -> None:
    robot = Robot()
    assert not robot.core.plans_ahead
    robot.row("/b", B, "failed", 9.0)
    robot.table(9.0)
    assert robot.core.plans_ahead
    start = only(robot.fail("/a", A, 9.001), events.StartSubstitute)
    assert start.program is not None and start.program.inputs == ("/c/data",)


def test_a_plan_ahead_whose_input_dies_with_the_same_failure_is_not_used() -> None:
    needed = [service("a", A, needed=True), service("b", B, needed=True), service("c", C)]
    robot = Robot(Som(needed))
    # The node of the input fails first; its kill is under way, and the table does not tell of it
    # yet.
    robot.fail("/b", B, 9.0, "silent")
    start = only(robot.fail("/a", A, 9.001), events.StartSubstitute)
    assert start.program is not None and start.program.inputs == ("/c/data",)
