"""The silence that a substitute is allowed: at its start, and while its program changes."""

from math import inf
import pytest

from core_robot import (
    assigned,
    A,
    B,
    C,
    Robot,
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
from shsa_core.model.kinds import Standby
from shsa_core.model.som import Som


def test_a_substitute_without_a_first_message_makes_room_for_the_next_best() -> None:
    robot = Robot()
    first = only(robot.fail("/a", A, 10.0), events.StartSubstitute)
    robot.killed(10.01, A)
    robot.connects(12.0, "/a", first.node)
    assert not has(robot.handle(events.Tick(14.9)), events.StartSubstitute)
    commands = robot.handle(events.Tick(15.1))
    assert only(commands, events.StopNode).node == first.node
    assert program_of(commands).inputs == ("/c/data",)


def test_a_process_that_is_not_up_yet_is_not_replaced_by_another_that_takes_as_long() -> None:
    robot = Robot()
    first = only(robot.fail("/a", A, 10.0), events.StartSubstitute)
    robot.killed(10.01, A)
    for time in (15.0, 20.0, 25.0):
        assert not has(robot.handle(events.Tick(time)), events.StopNode)
    commands = robot.handle(events.Tick(30.0))
    assert only(commands, events.StopNode).node == first.node


def test_a_lost_input_is_replaced_before_the_substitute_falls_silent() -> None:
    robot = Robot()
    node = robot.heal(10.0)
    robot.row("/b", B, "failed", 15.0)
    commands = robot.table(15.01)
    assert assigned(commands) == node
    assert reads(robot, node) == ("/c/data",)
    assert last_incident(commands).state is State.HEALED


def test_silence_while_the_program_changes_is_no_failure_of_the_substitute() -> None:
    robot = Robot()
    node = robot.heal(10.0)
    robot.row("/b", B, "failed", 15.0)
    robot.table(15.01)
    commands = robot.failure("/a", node, 15.1, "silent", "no message.", 14.99)
    assert not has(commands, events.StopNode)
    assert last_incident(robot.said).state is State.HEALING
    robot.row("/a", node, "healthy", 15.3, first=10.5)
    incident = last_incident(robot.table(15.3))
    assert incident.state is State.HEALED
    assert (incident.last_good, incident.first_message) == (14.99, 15.3)


def test_a_program_that_yields_nothing_after_the_change_makes_room() -> None:
    robot = Robot()
    node = robot.heal(10.0)
    robot.row("/b", B, "failed", 15.0)
    robot.table(15.01)
    robot.failure("/a", node, 15.1, "silent", "no message.", 14.99)
    commands = robot.handle(events.Tick(20.1))
    assert only(commands, events.StopNode).node == node
    assert last_incident(commands).state is State.UNHEALED


def test_a_failure_that_is_told_late_leaves_its_substitute_the_usual_time() -> None:
    robot = Robot()
    robot.handle(events.Tick(100.0))
    robot.fail("/a", A, 10.0)
    deadline = robot.core.deadline
    assert 100.0 <= deadline < inf
    assert not any(isinstance(each, events.StopNode) for each in robot.handle(events.Tick(101.0)))


def test_a_monitor_that_starts_again_ends_no_substitute_whose_inputs_it_has_not_heard_yet() -> None:
    robot = Robot()
    node = robot.heal(10.0)
    healed, robot.said = dict(robot.rows), []
    robot.handle(events.HealthSeen(20.0, (), whole=True, began=2))
    robot.rows = {}
    robot.row("/b", B, "unknown", 20.1)
    robot.handle(events.HealthSeen(20.1, tuple(robot.rows.values())))
    assert not robot.said and node in robot.shown
    robot.handle(events.HealthSeen(20.2, tuple(healed.values())))
    robot.handle(events.Tick(30.0))
    assert not has(robot.said, events.StopNode) and publishing(robot) == (True,)


def test_an_input_that_a_new_monitor_never_hears_is_lost() -> None:
    robot = Robot()
    robot.heal(10.0)
    robot.handle(events.HealthSeen(20.0, (), whole=True, began=2))
    robot.row("/b", B, "unknown", 20.1)
    robot.handle(events.HealthSeen(20.1, tuple(r for k, r in robot.rows.items() if k[1] != C)))
    assert robot.core.deadline <= 25.0
    assert last_incident(robot.handle(events.Tick(25.1))).state is State.UNHEALED


def two_losses(robot: Robot) -> str:
    """A fails, and the input of its substitute right after; the process has another program."""
    robot.fail("/a", A, 10.0)
    (row,) = robot.working()
    robot.rows.pop(("/b", B))
    robot.table(10.06)
    assert reads(robot, row.node) == ("/c/data",)
    return row.node


@pytest.mark.parametrize("standby", list(Standby))
def test_a_first_message_counts_that_was_sent_before_the_program_changed(standby: Standby) -> None:
    som = [service("a", A, needed=True, standby=standby), service("b", B), service("c", C)]
    robot = Robot(Som(som))
    node = two_losses(robot)
    robot.row("/a", node, "healthy", 10.05, first=10.05)  # it is told late
    assert last_incident(robot.table(10.1)).state is State.HEALED
    commands = robot.handle(events.Tick(16.0))
    assert not has(commands, events.StopNode) and publishing(robot) == (True,)


def test_a_substitute_that_speaks_again_before_its_silence_is_told_is_not_ended() -> None:
    robot = Robot(Som([service("a", A, True), service("b", B), service("c", C)]))
    node = robot.heal(10.0)
    robot.rows.pop(("/b", B))
    robot.table(12.0)  # another program
    robot.row("/a", node, "healthy", 12.5, first=10.5)
    robot.table(12.5)
    assert robot.failure("/a", node, 12.4, "silent", "no message.", 12.0) is not None
    assert last_incident(robot.said).state is State.HEALED
    assert not has(robot.handle(events.Tick(20.0)), events.StopNode)
