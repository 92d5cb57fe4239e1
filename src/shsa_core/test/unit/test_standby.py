"""Warm and hot: what the reconfigurator has ready before a failure."""
from dataclasses import replace
from math import inf
from typing import Sequence

import pytest

from core_robot import (
    A,
    B,
    C,
    Robot,
    assigned,
    has,
    last_incident,
    only,
    program_of,
    publishing,
    reads,
    service,
)
from shsa_core.healing import events
from shsa_core.healing.incident import State
from shsa_core.model.kinds import Others, Standby
from shsa_core.model.som import Som


def standby(mode: str) -> Som:
    first = service("a", A, needed=True, standby=Standby(mode))
    return Som([first, service("b", B), service("c", C)])


def test_a_warm_topic_takes_an_idle_process_and_the_pool_is_refilled() -> None:
    robot = Robot(standby("warm"))
    idle = only(robot.said, events.StartSubstitute)
    assert idle.program is None
    commands = robot.fail("/a", A, 10.0)
    assert assigned(commands) == idle.node
    row = robot.shown[idle.node]
    assert (row.service, row.topics, row.publishing) == ("a", ("/a",), True)
    assert robot.core.deadline == 11.0
    commands = robot.handle(events.Tick(11.0))
    refill = only(commands, events.StartSubstitute)
    assert refill.program is None and refill.node != idle.node
    assert [row.node for row in robot.idle_rows()] == [refill.node]


def test_a_plan_has_all_that_an_idle_process_needs_without_a_reconfigurator() -> None:
    first = service("a", A, needed=True, standby=Standby.WARM, others=Others.LAST)
    robot = Robot(Som([first, service("b", B), service("c", C)]))
    plan = robot.shown["a"]
    (idle,) = robot.idle_rows()
    robot.fail("/a", A, 10.0)
    given = robot.shown[idle.node]
    row = replace(plan, node=idle.node, publishing=True)
    assert row == replace(given, original="", last_message=b"", template=b"")


@pytest.mark.parametrize("late", [0.0, 0.5])
def test_who_ends_starts_no_idle_process_that_is_due_then_or_later(late: float) -> None:
    robot = Robot(standby("warm"))
    robot.fail("/a", A, 10.0)
    end = 11.0 - late  # the pool is refilled 1 s after the takeover
    assert not has(robot.handle(events.ShuttingDown(end)), events.StartSubstitute)
    assert robot.handle(events.Tick(30.0)) == []


def test_a_warm_takeover_that_finds_the_pool_empty_says_that_it_is_a_cold_one() -> None:
    robot = Robot(standby("warm"), pool=0)
    commands = robot.fail("/a", A, 10.0)
    assert has(commands, events.StartSubstitute)
    assert "No idle process is left: this is a cold start." in last_incident(commands).detail


def test_idle_processes_are_started_one_after_the_other() -> None:
    robot = Robot(standby("warm"), pool=3)
    assert len([each for each in robot.said if isinstance(each, events.StartSubstitute)]) == 1
    assert len(robot.idle_rows()) == 1
    for count, time in ((2, 2.0), (3, 3.0), (3, 9.0)):
        robot.handle(events.Tick(time))
        assert len(robot.idle_rows()) == count


def test_a_warm_process_that_does_not_publish_soon_makes_room_for_another_with_the_same_plan() -> (
    None
):
    robot = Robot(standby("warm"))
    silent = only(robot.said, events.StartSubstitute).node
    robot.connects(2.0, "/a", silent)
    assert assigned(robot.fail("/a", A, 10.0)) == silent
    robot.killed(10.01, A)
    assert not has(robot.handle(events.Tick(11.9)), events.StopNode)
    commands = robot.handle(events.Tick(12.0))
    assert events.StopNode(silent) in commands
    assert last_incident(commands).state is State.HEALING
    assert last_incident(commands).relations == ("good",)


@pytest.mark.parametrize("mode", ("warm", "hot"))
def test_a_process_that_is_still_starting_is_given_the_time_of_a_start(mode: str) -> None:
    robot = Robot(standby(mode))
    node = only(robot.said, events.StartSubstitute).node  # at 1.0
    assert assigned(robot.fail("/a", A, 2.0)) == node
    robot.killed(2.01, A)
    assert not has(robot.handle(events.Tick(5.9)), events.StopNode)
    robot.connects(5.95, "/a", node)
    assert events.StopNode(node) in robot.handle(events.Tick(6.0))


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


def test_idle_processes_end_once_no_service_is_warm_and_are_back_at_once() -> None:
    robot = Robot(standby("warm"))
    (idle,) = robot.idle_rows()
    said = robot.handle(events.SomChanged(5.0, standby("cold")))
    assert only(said, events.StopNode).node == idle.node and not robot.idle_rows()
    assert not has(robot.handle(events.Tick(30.0)), events.StartSubstitute)
    assert has(robot.handle(events.SomChanged(31.0, robot.som)), events.StartSubstitute)


def test_an_idle_process_that_dies_is_replaced_after_a_pause() -> None:
    robot = Robot(standby("warm"))
    idle = only(robot.said, events.StartSubstitute)
    assert not has(
        robot.handle(events.ProcessExited(5.0, idle.node, "status 1")), events.StartSubstitute
    )
    assert robot.core.deadline == 7.0
    assert has(robot.handle(events.Tick(7.0)), events.StartSubstitute)


def test_the_pause_grows_no_more_once_one_was_set_to_work() -> None:
    robot = Robot(standby("warm"))
    for time, pause in ((2.0, 2.0), (5.0, 4.0)):
        (idle,) = robot.idle_rows()
        robot.handle(events.ProcessExited(time, idle.node, "status 1"))
        assert robot.core.deadline == time + pause
        robot.handle(events.Tick(time + pause))
    robot.heard(assigned(robot.fail("/a", A, 30.0)), 30.1)
    robot.handle(events.Tick(31.0))
    (idle,) = robot.idle_rows()
    robot.handle(events.ProcessExited(32.0, idle.node, "status 1"))
    assert not has(robot.handle(events.Tick(33.9)), events.StartSubstitute)
    assert has(robot.handle(events.Tick(34.0)), events.StartSubstitute)


def test_a_hot_topic_has_a_muted_substitute_that_publishes_at_once() -> None:
    robot = Robot(standby("hot"))
    start = only(robot.said, events.StartSubstitute)
    assert start.program is not None and start.program.inputs == ("/b/data",)
    assert publishing(robot) == (False,)
    commands = robot.fail("/a", A, 10.0)
    assert assigned(commands) == start.node
    assert not has(commands, events.StartSubstitute)
    assert isinstance(commands[0], events.ShowSubstitutions)
    assert publishing(robot) == (True,)


def test_a_hot_substitute_follows_the_plan_in_the_same_process() -> None:
    robot = Robot(standby("hot"))
    node = only(robot.said, events.StartSubstitute).node
    robot.row("/b", B, "failed", 5.0)
    commands = robot.table(5.0) + robot.idle(5.0)
    assert assigned(commands) == node
    assert reads(robot, node) == ("/c/data",) and publishing(robot) == (False,)


def test_what_fails_with_the_original_is_no_input() -> None:
    robot = Robot(standby("cold"))
    for topic, node in (("/a", A), ("/b", B)):
        robot.row(topic, node, "failed", 10.0)
    assert program_of(robot.table(10.0)).inputs == ("/c/data",)


def test_a_hot_substitute_whose_input_died_with_the_original_is_not_used_as_it_is() -> None:
    robot = Robot(standby("hot"))
    robot.rows.pop(("/b", B))
    robot.row("/b", B, "failed", 10.0)
    robot.table(10.0)
    robot.fail("/a", A, 10.001)
    (row,) = robot.working()
    assert reads(robot, row.node) == ("/c/data",)


def no_value(robot: Robot, node: str, time: float) -> Sequence[events.Command]:
    return robot.failure("/a", node, time, "no_value", "it has no value", None)


def test_a_hot_substitute_whose_law_does_not_hold_follows_the_next_and_later_looks_again() -> None:
    robot = Robot(standby("hot"), retry_limit=60.0)
    node = only(robot.said, events.StartSubstitute).node
    commands = no_value(robot, node, 5.0)
    assert assigned(commands) == node
    assert reads(robot, node) == ("/c/data",) and publishing(robot) == (False,)
    robot.handle(events.Tick(66.0))
    assert reads(robot, node) == ("/b/data",)


@pytest.mark.parametrize("mode", ("hot", "warm", "cold"))
def test_a_law_that_ceases_to_hold_makes_room_for_the_next_in_the_same_process(mode: str) -> None:
    robot = Robot(standby(mode))
    robot.fail("/a", A, 10.0)
    robot.killed(10.01, A)
    (row,) = robot.working()
    robot.row("/a", row.node, "healthy", 10.05, first=10.05)
    assert last_incident(robot.table(10.06)).state is State.HEALED
    commands = no_value(robot, row.node, 11.0)
    assert assigned(commands) == row.node
    assert not has(commands, events.StopNode)
    assert last_incident(commands).state is State.HEALED
    assert reads(robot, row.node) == ("/c/data",) and publishing(robot) == (True,)


def test_a_process_that_is_none_of_ours_cannot_tell_of_its_law() -> None:
    robot = Robot(standby("hot"))
    assert no_value(robot, "/substitute_hot_77", 5.0) == []
    assert no_value(robot, A, 5.0) == []
    assert not robot.working()[0].publishing


def test_without_another_law_the_process_goes_on_as_its_law_may_hold_again() -> None:
    robot = Robot(standby("hot"))
    node = only(robot.said, events.StartSubstitute).node
    robot.row("/c", C, "failed", 5.0)
    robot.table(5.0)
    robot.fail("/a", A, 10.0)
    commands = no_value(robot, node, 11.0)
    assert only(commands, events.Log).text.endswith("and there is no other.")
    assert robot.working()[0].node == node and publishing(robot) == (True,)


def test_a_hot_substitute_stays_muted_after_the_original_returned() -> None:
    robot = Robot(standby("hot"))
    node = only(robot.said, events.StartSubstitute).node
    robot.fail("/a", A, 10.0)
    robot.killed(10.01, A)
    robot.row("/a", node, "healthy", 10.02, first=10.02)
    robot.table(10.03)
    robot.back(20.0)
    commands = robot.handle(events.Tick(22.5))
    assert last_incident(commands).state is State.ENDED
    assert not has(commands, events.StopNode)
    assert robot.core._processes.nodes == (node,) and publishing(robot) == (False,)


def test_a_hot_substitute_that_dies_unused_is_started_again_after_a_pause() -> None:
    robot = Robot(standby("hot"))
    node = only(robot.said, events.StartSubstitute).node
    commands = robot.handle(events.ProcessExited(5.0, node, "status 1"))
    assert not has(commands, events.StartSubstitute)
    assert has(robot.handle(events.Tick(7.0)), events.StartSubstitute)


def test_nothing_is_started_again_for_a_service_that_left_the_som() -> None:
    robot = Robot(standby("hot"))
    node = only(robot.said, events.StartSubstitute).node
    robot.handle(events.ProcessExited(5.0, node, "status 1"))
    rest = [each for each in robot.som if not each.needed]
    robot.handle(events.SomChanged(5.1, Som(rest)))
    assert robot.core.deadline == inf


@pytest.mark.parametrize("moved", [True, False], ids=["another topic", "another publisher"])
def test_a_hot_substitute_reads_by_the_som_of_now(moved: bool) -> None:
    robot = Robot(standby("hot"))
    (row,) = robot.working()
    assert [each.node for each in row.inputs] == [""], "whoever publishes it"
    others = [each for each in robot.som if each.name != "b"]
    beside = [service("b", B), service("other", "/other_node", topic="/b")]
    if moved:
        beside = [service("b", B, topic="/b2")]
    robot.row("/b2", B, "healthy", 1.0)
    robot.table(1.5)
    robot.handle(events.SomChanged(2.0, Som([*others, *beside])))
    (row,) = robot.working()
    (read,) = row.inputs
    assert (read.topic, read.node) == (("/b2", "") if moved else ("/b", B))


def test_no_plan_is_made_ahead_once_the_launch_ends() -> None:
    robot = Robot()
    robot.row("/b", B, "failed", 9.0)
    robot.table(9.0)
    robot.handle(events.LaunchEnding(9.1))
    assert not robot.core.plans_ahead, "none would be made, again and again"


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


def test_a_process_that_was_heard_is_set_to_work_rather_than_one_that_was_not() -> None:
    robot = Robot(standby("warm"), pool=2)
    robot.handle(events.Tick(5.0))
    _, second = (row.node for row in robot.idle_rows())
    robot.handle(events.ProcessPulse(6.0, second, True))
    assert assigned(robot.fail("/a", A, 30.0)) == second


def test_one_that_hung_before_its_first_sign_of_life_makes_room_for_one_that_was_heard() -> None:
    robot = Robot(standby("warm"), pool=1)
    (hung,) = (row.node for row in robot.idle_rows())
    assert assigned(robot.fail("/a", A, 10.0)) == hung
    robot.killed(10.01, A)
    refill = only(robot.handle(events.Tick(11.0)), events.StartSubstitute).node
    assert not has(robot.handle(events.Tick(12.0)), events.StopNode)
    robot.handle(events.ProcessPulse(12.5, refill, True))
    commands = robot.handle(events.Tick(14.0))
    assert events.StopNode(hung) in commands
    assert assigned(commands) == refill


def test_an_idle_process_that_hangs_is_ended_and_replaced() -> None:
    robot = Robot(standby("warm"), pool=1)
    (row,) = robot.idle_rows()
    commands = robot.handle(events.ProcessPulse(30.0, row.node, False))
    assert only(commands, events.StopNode).node == row.node
    assert not has(robot.handle(events.Tick(31.9)), events.StartSubstitute)
    start = only(robot.handle(events.Tick(32.0)), events.StartSubstitute)
    assert [each.node for each in robot.idle_rows()] == [start.node]


def test_a_takeover_by_a_process_that_hangs_goes_to_the_next_at_once() -> None:
    robot = Robot(standby("warm"), pool=2)
    robot.handle(events.Tick(5.0))
    first, second = (row.node for row in robot.idle_rows())
    assert assigned(robot.fail("/a", A, 30.0)) == first
    commands = robot.handle(events.ProcessPulse(30.2, first, False))
    assert only(commands, events.StopNode).node == first
    assert assigned(commands) == second
    assert publishing(robot) == (True,)


def test_one_that_publishes_and_hangs_is_ended() -> None:
    robot = Robot()
    node = robot.heal(10.0)
    assert only(robot.handle(events.ProcessPulse(21.0, node, False)), events.StopNode).node == node
