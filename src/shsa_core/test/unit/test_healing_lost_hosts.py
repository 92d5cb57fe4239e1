"""The reconfigurator and computers that are lost, and come back."""
from dataclasses import replace

import pytest

from core_robot import A, B, C, Robot, has, last_incident, only, publishing, service
from hosts_robot import (
    BOARD,
    PI,
    WAIT,
    cut,
    distributed,
    lost,
    seen,
    silent,
    som,
    steady,
    stopped,
    takes_over,
)
from shsa_core.errors import ShsaError
from shsa_core.healing import events
from shsa_core.healing.incident import State
from shsa_core.model.kinds import Contain, OnPartition, Policy, Standby
from shsa_core.model.som import Som
from shsa_core.planning.settings import CERTAIN_S

# A computer is lost


@pytest.mark.parametrize("standby", [Standby.HOT, Standby.WARM])
def test_what_stands_by_on_a_lost_computer_stands_by_elsewhere(standby: Standby) -> None:
    robot = distributed(standby=standby)
    (row,) = robot.working() + robot.idle_rows()
    commands = lost(robot, 10.0, BOARD)
    assert stopped(commands) == [row.node]  # by its agent, once that is heard
    start = only(commands, events.StartSubstitute)
    assert start.host == "" and f"{BOARD} is lost: its agent is silent." in str(commands)


def test_a_substitute_that_is_lost_with_its_computer_has_a_successor_elsewhere() -> None:
    robot = distributed()
    robot.fail("/a", A, 10.0)
    robot.killed(10.1, A)
    first = takes_over(robot, 10.5)
    commands = robot.failure("/a", first, 20.0, "silent", "no message", 19.7)
    second = only(commands, events.StartSubstitute)
    assert second.host == ""  # it is not known yet that the computer is lost, but it may be
    assert second.program is not None and second.program.inputs == ("/b/data",)
    assert stopped(commands) == [first]
    lost(robot, 20.5, BOARD)
    takes_over(robot, 21.0)
    assert last_incident(robot.said).state is State.HEALED
    assert publishing(robot) == (True,)
    assert stopped(seen(robot, 30.0, BOARD)) == [] and publishing(robot) == (True,)


def test_a_substitute_that_starts_on_a_computer_that_is_lost_starts_elsewhere() -> None:
    robot = distributed()
    assert only(robot.fail("/a", A, 10.0), events.StartSubstitute).host == BOARD
    start = only(lost(robot, 10.3, BOARD), events.StartSubstitute)
    assert start.host == "" and start.program is not None
    assert start.program.inputs == ("/b/data",)  # the plan is not to blame


def test_a_substitute_that_is_heard_goes_on_though_its_agent_is_not() -> None:
    robot = distributed()
    robot.fail("/a", A, 10.0)
    robot.killed(10.1, A)
    node = takes_over(robot, 10.5)
    assert not has(lost(robot, 20.0, BOARD), events.StartSubstitute)
    commands = robot.failure("/a", node, 25.0, "silent", "no message", 24.7)
    assert only(commands, events.StartSubstitute).host == "" and stopped(commands) == [node]


def test_a_substitute_whose_messages_are_due_at_no_time_has_a_successor_at_once() -> None:
    robot = distributed(standby=Standby.COLD)
    changed = [replace(each, period=None) for each in robot.core.robot.som]
    robot.handle(events.SomChanged(4.0, robot.core.robot.som.with_services(changed)))
    robot.fail("/a", A, 10.0)
    robot.killed(10.1, A)
    takes_over(robot, 10.5)
    start = only(lost(robot, 20.0, BOARD), events.StartSubstitute)
    assert start.program is not None and start.program.inputs == ("/c/data",)  # /b is there no more


def test_what_has_ended_by_itself_is_not_told_to() -> None:
    robot = distributed()
    robot.fail("/a", A, 10.0)
    node = takes_over(robot, 10.5)
    robot.failure("/a", node, 20.0, "silent", "no message", 19.7)
    robot.handle(events.ProcessExited(20.1, node, "status 0"))
    lost(robot, 20.8, BOARD)
    assert stopped(seen(robot, 25.0, BOARD)) == []


def test_a_hot_substitute_elsewhere_is_not_taken_for_one_here_by_the_next() -> None:
    robot = distributed(standby=Standby.HOT)
    (row,) = robot.working()
    heir = Robot(som(standby=Standby.HOT))
    heir.handle(events.Started(20.0, (), (), tuple(robot.written.values()), (row.node,)))
    assert (row.node, BOARD) in [(each.node, each.host) for each in heir.working()]
    assert only(lost(heir, 25.0, BOARD), events.StartSubstitute).host == ""


def test_what_no_warm_service_needs_any_more_does_not_stay_on_another_computer() -> None:
    robot = distributed(standby=Standby.WARM)
    (row,) = robot.idle_rows()
    assert row.node in stopped(robot.handle(events.SomChanged(5.0, som())))
    assert robot.idle_rows() == []


# The node's computer is lost


def test_a_node_that_is_silent_with_its_computer_is_taken_over_and_not_killed() -> None:
    robot = distributed(standby=Standby.HOT)
    cut(robot, 10.0)
    assert not has(robot.said, events.FindNode)
    assert last_incident(robot.said).state is State.HEALED and publishing(robot) == (True,)
    seen(robot, 18.0, PI)
    assert last_incident(robot.back(18.1)).state is State.RETURNING
    assert publishing(robot) == (False,)
    robot.handle(events.Tick(20.2))
    assert robot.core.incident("a") is None
    for time in (20.5, 21.0, 25.0):
        seen(robot, time, PI)
    assert not has(robot.said, events.FindNode)


def test_a_node_that_is_silent_beside_its_computer_is_killed() -> None:
    robot = distributed(standby=Standby.HOT, contain=Contain.NODE)
    steady(robot, 3.0, 10.0, PI)
    silent(robot, 10.0)
    takes_over(robot, 10.1)
    assert not has(steady(robot, 10.0, 10.1 + CERTAIN_S, PI), events.FindNode)
    assert only(seen(robot, 10.1 + CERTAIN_S, PI), events.FindNode).node == A


def test_a_node_that_hangs_on_a_computer_that_is_back_is_killed_there() -> None:
    robot = distributed(standby=Standby.HOT, contain=Contain.NODE)
    cut(robot, 10.0)
    assert not has(seen(robot, 18.0, PI), events.FindNode)
    assert not has(seen(robot, 19.0, PI), events.FindNode)
    assert only(seen(robot, 20.1, PI), events.FindNode).node == A
    robot.killed(20.2, A)
    incident = robot.core.incident("a")
    assert incident is not None and incident.killed == 20.2


def test_a_wrong_node_on_a_lost_computer_may_still_run_and_is_killed_when_it_is_back() -> None:
    robot = distributed(standby=Standby.HOT)
    lost(robot, 9.9, PI)
    robot.failure("/a", A, 10.0, "out_of_range", "99 is out of range.", 9.0)
    commands = robot.handle(events.NodeFound(10.1, A, events.Where.UNREACHABLE, "it is cut off"))
    assert "/a_node may still run: it is cut off." in str(commands)
    assert publishing(robot) == (True,)  # it is not heard here
    incident = last_incident(commands)
    assert incident.killed is None and "may still run" in incident.detail
    assert only(steady(robot, 18.0, 20.6, PI), events.FindNode).node == A


def test_a_kill_that_is_under_way_when_the_computer_is_lost_is_finished_later() -> None:
    robot = distributed(standby=Standby.HOT)
    robot.failure("/a", A, 10.0, "out_of_range", "99 is out of range.", 9.0)
    assert publishing(robot) == (False,)
    commands = lost(robot, 10.5, PI)
    assert "/a_node may still run: pi is lost: its agent is silent." in str(commands)
    assert publishing(robot) == (True,)
    assert only(steady(robot, 18.0, 20.6, PI), events.FindNode).node == A


def test_a_node_that_is_to_start_again_on_a_lost_computer_is_waited_for() -> None:
    robot = distributed(policy=Policy.RESTART)
    robot.failure("/a", A, 10.0, "out_of_range", "99 is out of range.", 9.0)
    lost(robot, 10.5, PI)
    incident = robot.core.incident("a")
    assert incident is not None and incident.state is State.HEALING
    steady(robot, 18.0, 20.6, PI)
    robot.killed(20.6, A)
    assert only(robot.handle(events.Tick(21.2)), events.RestartNode).node == A


def test_where_nobody_says_on_which_computer_a_node_is_it_is_left_alone() -> None:
    robot = Robot()
    robot.fail("/a", A, 10.0, "out_of_range")
    commands = robot.handle(events.NodeFound(10.1, A, events.Where.UNREACHABLE, "as told"))
    assert "/a_node may still be running: as told" in str(commands)
    assert publishing(robot) == (True,)


@pytest.mark.parametrize("length", [2.0, 8.0, 20.0])
def test_a_link_that_drops_again_and_again_ends_with_one_publisher_and_no_punishment(
    length: float,
) -> None:
    robot = distributed(standby=Standby.HOT)
    time = 10.0
    for _ in range(6):
        seen(robot, time - 0.1, PI)
        cut(robot, time)
        assert publishing(robot) == (True,)
        time += length
        seen(robot, time, PI)
        incident = last_incident(robot.back(time + 0.1))
        assert incident.state is State.RETURNING and not incident.kept_out
        robot.handle(events.Tick(time + 1.0))
        time += 2.0
        assert publishing(robot) == (False,)
    seen(robot, time - 0.5, PI)
    robot.handle(events.Tick(time + robot.core.robot.settings.hold_off_limit))
    assert robot.core.incident("a") is None and publishing(robot) == (False,)
    assert not has(robot.said, events.FindNode)


def test_a_cut_that_is_shorter_than_a_loss_is_no_failure_of_the_node_either() -> None:
    robot = distributed(standby=Standby.HOT)
    time = 10.0
    for _ in range(5):
        seen(robot, time, PI)
        silent(robot, time + 0.3)
        takes_over(robot, time + 0.4)
        seen(robot, time + 1.9, PI)
        incident = last_incident(robot.back(time + 2.0))
        assert not incident.kept_out
        time += 2.5
    seen(robot, time, PI)
    assert not has(seen(robot, time + 0.5, PI), events.FindNode)


# on_partition: wait


@pytest.mark.parametrize("standby", [Standby.COLD, Standby.WARM, Standby.HOT])
def test_where_the_som_says_wait_nothing_is_done_while_the_computer_is_lost(
    standby: Standby,
) -> None:
    robot = distributed(on_partition=WAIT, standby=standby)
    commands = silent(robot, 10.0)
    incident = last_incident(commands)
    assert incident.state is State.KEPT
    assert "nothing is done, as pi was not heard since, and on_partition is wait" in incident.detail
    commands = lost(robot, 10.7, PI)
    told = "nothing is done, as pi cannot be reached, and on_partition is wait"
    assert told in last_incident(commands).detail
    assert not any(publishing(robot)) and not has(robot.said, events.FindNode)
    seen(robot, 18.0, PI)
    assert last_incident(robot.back(18.1)).state is State.RETURNING
    robot.handle(events.Tick(20.2))
    seen(robot, 20.5, PI)
    robot.idle(20.6)
    assert robot.core.incident("a") is None and not has(robot.said, events.FindNode)
    assert len(robot.working()) == (1 if standby is Standby.HOT else 0)


def test_where_the_som_says_wait_a_node_that_fails_alone_is_healed() -> None:
    robot = distributed(on_partition=WAIT)
    assert last_incident(silent(robot, 10.0)).state is State.KEPT
    assert only(seen(robot, 10.4, PI), events.StartSubstitute).host == BOARD
    takes_over(robot, 10.9)
    assert last_incident(robot.said).state is State.HEALED


def test_where_the_som_says_wait_a_node_that_stays_silent_after_the_cut_is_healed() -> None:
    robot = distributed(on_partition=WAIT)
    silent(robot, 10.0)
    lost(robot, 10.7, PI)
    for time in (18.0, 19.0, 20.0):
        assert not has(seen(robot, time, PI), events.StartSubstitute)
    assert has(seen(robot, 20.1, PI), events.StartSubstitute)


def test_where_the_som_says_wait_a_node_that_is_gone_or_wrong_is_healed_at_once() -> None:
    robot = distributed(on_partition=WAIT)
    commands = robot.failure("/a", A, 10.0, "out_of_range", "99 is out of range.", 9.9)
    assert has(commands, events.StartSubstitute) and has(commands, events.FindNode)


def test_a_broken_invariant_of_computers_is_told() -> None:
    robot = distributed(standby=Standby.HOT)
    robot.core.robot.computers._known[BOARD].detail = "silent"
    with pytest.raises(ShsaError, match="is idle for a on board, which is lost"):
        robot.core.validate()
    robot = distributed(standby=Standby.WARM)
    robot.core.robot.computers._known[BOARD].detail = "silent"
    with pytest.raises(ShsaError, match="is idle on a computer that is lost"):
        robot.core.validate()


# Who yields at the reunion


def test_a_substitute_yields_to_an_original_that_was_only_silent_on_another_computer() -> None:
    robot = distributed(standby=Standby.HOT)
    (row,) = robot.working()
    assert row.on_partition is OnPartition.HEAL and not row.yields
    cut(robot, 10.0)
    (row,) = robot.working()
    assert row.publishing and row.yields
    commands = robot.failure("/a", row.node, 18.0, "silent", "no message", 17.7)
    assert not stopped(commands)  # it may have heard the original before we do
    assert last_incident(robot.back(18.1)).state is State.RETURNING
    (row,) = robot.working()
    assert not row.publishing and not row.yields


def test_a_substitute_yields_to_nobody_where_the_original_is_wrong_or_gone() -> None:
    robot = distributed(standby=Standby.HOT)
    robot.fail("/a", A, 10.0)
    node = takes_over(robot, 10.1)
    robot.killed(10.2, A)
    assert [row.yields for row in robot.working()] == [False]
    assert stopped(robot.failure("/a", node, 12.0, "silent", "no message", 11.7)) == [node]


def test_on_one_computer_a_substitute_yields_to_a_spared_node_alone_on_its_topic() -> None:
    hot = service("a", A, needed=True, standby=Standby.HOT)
    for more, yields in (((), True), ((service("c", C, topic="/a"),), False)):
        robot = Robot(Som([hot, service("b", B), *more]))
        assert [row.on_partition for row in robot.working()] == [OnPartition.WAIT]
        robot.failure("/a", A, 10.0, "silent", "no message", 9.7)
        assert [row.yields for row in robot.working()] == [yields]
        assert [row.provider for row in robot.working()] == [A if yields else ""]
        robot.failure("/a", A, 11.0, "out_of_range", "a is 9", 9.7)
        assert [row.yields for row in robot.working()] in ([], [False])


def test_an_event_driven_service_of_a_lost_computer_is_said_not_to_be_healed() -> None:
    robot = distributed()
    changed = [replace(each, period=None) for each in robot.core.robot.som]
    robot.handle(events.SomChanged(4.0, robot.core.robot.som.with_services(changed)))
    commands = lost(robot, 10.0, PI)
    assert "/a cannot be told by its silence: it is not healed while pi is lost" in str(commands)
    assert robot.core.incident("a") is None
    assert "cannot be told" not in str(lost(distributed(), 10.0, PI))


def test_a_gateway_of_a_lost_computer_is_healed_elsewhere_and_never_started_again() -> None:
    """Its serial line is there: only a substitute elsewhere can stand in."""
    robot = distributed(policy=Policy.RESTART_AND_SUBSTITUTE, standby=Standby.HOT)
    cut(robot, 10.0)
    (row,) = robot.working()
    assert row.publishing and row.host != PI
    for time in (12.0, 20.0, 40.0):
        seen(robot, time, BOARD)
        robot.handle(events.Tick(time))
    assert not has(robot.said, events.RestartNode)
    assert not has(robot.said, events.FindNode)
