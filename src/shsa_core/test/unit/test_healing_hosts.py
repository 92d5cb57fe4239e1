"""What the reconfigurator makes of a robot of several computers."""
from dataclasses import replace
from typing import Any, List, Optional, Sequence

import pytest

from core_robot import A, B, C, Robot, has, last_incident, only, publishing, service
from shsa_core.errors import ShsaError
from shsa_core.healing import events
from shsa_core.healing.awaited_kills import CERTAIN_S
from shsa_core.healing.incident import Incident, State
from shsa_core.healing.strays import HEARD_S
from shsa_core.model.cost import cores
from shsa_core.model.host import Host, Placement
from shsa_core.model.kinds import Contain, OnPartition, Policy, Standby
from shsa_core.model.som import Som

PI, BOARD = "pi", "board"


def som(**more: Any) -> Som:
    """A runs on the Pi; what it can be computed from on the board, or on a computer not said."""
    a = service("a", A, needed=True, host=PI, **more)
    b, c = service("b", B, host=BOARD), service("c", C)
    return Som([a, b, c], [Host(PI, 4.0), Host(BOARD, 4.0)])


def seen(robot: Robot, time: float, *hosts: str, load: float = 0.5) -> List[events.Command]:
    """Some computers are heard."""
    commands: List[events.Command] = []
    for host in hosts:
        commands += robot.handle(events.HostSeen(time, host, load, 4.0))
    return commands


def steady(robot: Robot, begin: float, end: float, *hosts: str) -> List[events.Command]:
    """Some computers are heard all the time."""
    commands: List[events.Command] = []
    while begin < end:
        commands += seen(robot, begin, *hosts)
        begin += 0.5
    return commands


def lost(robot: Robot, time: float, host: str) -> List[events.Command]:
    return robot.handle(events.HostLost(time, host, "its agent is silent."))


def stopped(commands: Sequence[events.Command]) -> List[str]:
    return [each.node for each in commands if isinstance(each, events.StopSubstitute)]


def distributed(*hosts: str, healings: int = 0, **more: Any) -> Robot:
    """A robot whose computers are heard, and have settled."""
    robot = Robot(som(**more), healings=healings)
    seen(robot, 1.0, *(hosts or (PI, BOARD)))
    robot.handle(events.Tick(3.0))
    robot.idle(3.0)
    return robot


def takes_over(robot: Robot, time: float, node: str = "") -> str:
    """The substitute of A publishes."""
    (row,) = [row for row in robot.working() if row.service == "a"]
    robot.row("/a", row.node, "healthy", time, first=time)
    robot.table(time)
    return row.node


def silent(robot: Robot, time: float, node: str = A) -> List[events.Command]:
    """A is silent, as it is when its computer is cut off."""
    robot.row("/a", node, "failed", time)
    return robot.failure("/a", node, time, "silent", "no message for 0.25 s.", time - 0.25)


def back(robot: Robot, time: float) -> List[events.Command]:
    robot.row("/a", A, "healthy", time)
    return robot.table(time)


# Where it runs


def test_a_substitute_starts_beside_its_inputs_and_the_incident_says_so() -> None:
    robot = distributed()
    commands = robot.fail("/a", A, 10.0)
    start = only(commands, events.StartSubstitute)
    assert start.host == BOARD
    assert last_incident(commands).detail.endswith(" from /b/data. It runs on board.")
    assert robot.shown[start.node].host == BOARD


def test_computers_that_are_not_heard_are_not_used() -> None:
    robot = Robot(som())
    assert only(robot.fail("/a", A, 10.0), events.StartSubstitute).host == ""


def test_what_the_som_does_not_name_is_no_computer_of_the_robot() -> None:
    robot = distributed(placement=Placement(prefer=("stranger",)))
    assert seen(robot, 3.5, "stranger") == [] == lost(robot, 3.6, "stranger")
    assert only(robot.fail("/a", A, 10.0), events.StartSubstitute).host == BOARD


def test_a_full_computer_is_passed_over_with_the_sum_in_the_incident() -> None:
    robot = distributed()
    seen(robot, 9.9, BOARD, load=3.995)
    commands = robot.fail("/a", A, 10.0)
    assert only(commands, events.StartSubstitute).host == ""
    detail = last_incident(commands).detail
    assert "It runs on the reconfigurator's computer. board has no room: 3.995 busy + " in detail


def test_where_it_fits_nowhere_the_service_is_unhealed_and_tried_again() -> None:
    services = som(placement=Placement(forbid=(PI, "own")))
    hosts = [Host(PI), Host(BOARD, 4.0), Host("own")]
    robot = Robot(Som(list(services), hosts), host="own")
    seen(robot, 9.9, BOARD, load=4.0)
    incident = last_incident(robot.fail("/a", A, 10.0))
    assert incident.state is State.UNHEALED and "board has no room: 4 busy + " in incident.detail
    seen(robot, 11.0, BOARD, load=1.0)
    due = robot.core.deadline
    assert due is not None
    assert only(robot.handle(events.Tick(12.1)), events.StartSubstitute).host == BOARD


def test_what_was_just_placed_counts_before_the_load_shows_it() -> None:
    a, b, c = som(placement=Placement(prefer=(BOARD,)))
    hosts = [Host(PI), Host(BOARD, 1.5 * cores([b], a))]
    two = replace(a, name="a2", topic="/a2", node="/a2_node")
    robot = Robot(Som([a, two, b, c], hosts))
    seen(robot, 9.9, BOARD, load=0.0)
    assert only(robot.fail("/a", A, 10.0), events.StartSubstitute).host == BOARD
    commands = robot.fail("/a2", "/a2_node", 10.1)
    assert only(commands, events.StartSubstitute).host == ""
    told = [each.incident for each in commands if isinstance(each, events.ShowIncident)]
    assert "placed lately" in [each for each in told if each.service == "a2"][-1].detail


def test_our_own_computer_has_no_name_in_commands() -> None:
    robot = Robot(som(), host=BOARD)
    assert only(robot.fail("/a", A, 10.0), events.StartSubstitute).host == ""


# What stands by


def test_a_hot_substitute_stands_by_where_it_belongs_once_the_computers_are_there() -> None:
    robot = Robot(som(standby=Standby.HOT))
    (row,) = robot.working()
    assert row.host == ""
    seen(robot, 1.0, PI, BOARD)
    assert robot.working() == [row]
    commands = robot.handle(events.Tick(3.0))
    assert stopped(commands) == [row.node]
    assert only(commands, events.StartSubstitute).host == BOARD
    assert [row.host for row in robot.working()] == [BOARD]


def test_idle_processes_are_where_the_plans_of_warm_services_are_placed() -> None:
    robot = Robot(som(standby=Standby.WARM))
    (first,) = robot.idle_rows()
    assert first.host == ""
    seen(robot, 1.0, PI, BOARD)
    commands = robot.handle(events.Tick(3.0))
    assert stopped(commands) == [first.node]
    (row,) = robot.idle_rows()
    assert row.host == BOARD and robot.shown["a"].host == BOARD
    robot.handle(events.ProcessHeard(3.5, row.node))
    assign = only(robot.fail("/a", A, 10.0), events.AssignSubstitute)
    assert assign.node == row.node and robot.shown[row.node].host == BOARD
    refill = only(robot.handle(events.Tick(11.0)), events.StartSubstitute)
    assert refill.host == BOARD and refill.program is None


def test_each_computer_has_its_own_idle_processes() -> None:
    a, b, c = som(standby=Standby.WARM)
    two = replace(service("c", C, needed=True), name="c2", topic="/c2", node="/c2_node")
    two = replace(two, standby=Standby.WARM, placement=Placement(prefer=(PI,)))
    robot = Robot(Som([a, b, c, two], [Host(PI), Host(BOARD)]), pool=2)
    seen(robot, 1.0, PI, BOARD)
    for time in (3.0, 4.0, 5.0):
        robot.handle(events.Tick(time))
        robot.idle(time)
    assert sorted(row.host for row in robot.idle_rows()) == [BOARD, BOARD, PI, PI]


def test_a_computer_on_which_nothing_starts_holds_up_no_other() -> None:
    a, b, c = som(standby=Standby.WARM)
    two = replace(service("c", C, needed=True), name="c2", topic="/c2", node="/c2_node")
    two = replace(two, standby=Standby.WARM, placement=Placement(prefer=(PI,)))
    robot = Robot(Som([a, b, c, two], [Host(PI), Host(BOARD)]))
    seen(robot, 1.0, PI, BOARD)
    robot.handle(events.Tick(3.0))
    robot.idle(3.0)
    on = {row.host: row.node for row in robot.idle_rows()}
    robot.handle(events.ProcessExited(4.0, on[BOARD], "it cannot start"))
    robot.handle(events.ProcessExited(4.1, on[PI], "killed"))
    starts = robot.handle(events.Tick(6.1))
    assert [each.host for each in starts if isinstance(each, events.StartSubstitute)] == [BOARD, PI]


# A computer is lost


@pytest.mark.parametrize("standby", [Standby.HOT, Standby.WARM])
def test_what_stands_by_on_a_lost_computer_stands_by_elsewhere(standby: Standby) -> None:
    robot = distributed(standby=standby)
    (row,) = robot.working() + robot.idle_rows()
    commands = lost(robot, 10.0, BOARD)
    assert stopped(commands) == []  # nobody would hear it
    start = only(commands, events.StartSubstitute)
    assert start.host == "" and f"{BOARD} is lost: its agent is silent." in str(commands)
    commands = seen(robot, 20.0, BOARD)
    assert commands[0] == events.StopSubstitute(row.node)


def test_a_substitute_that_is_lost_with_its_computer_has_a_successor_elsewhere() -> None:
    robot = distributed()
    robot.fail("/a", A, 10.0)
    robot.killed(10.1, A)
    first = takes_over(robot, 10.5)
    commands = robot.failure("/a", first, 20.0, "silent", "no message", 19.7)
    second = only(commands, events.StartSubstitute)
    assert second.host == ""  # it is not known yet that the computer is lost, but it may be
    assert second.program is not None and second.program.inputs == ("/b/data",)
    lost(robot, 20.5, BOARD)
    takes_over(robot, 21.0)
    assert last_incident(robot.said).state is State.HEALED
    assert publishing(robot) == (True,)
    commands = seen(robot, 30.0, BOARD)
    assert first in stopped(commands)
    assert publishing(robot) == (True,) and second.node not in stopped(commands)


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
    assert only(commands, events.StartSubstitute).host == "" and stopped(commands) == []
    assert stopped(seen(robot, 30.0, BOARD)) == [node]


def test_a_substitute_whose_messages_are_due_at_no_time_has_a_successor_at_once() -> None:
    robot = distributed(standby=Standby.COLD)
    changed = [replace(each, period=None) for each in robot.core._som]
    robot.handle(events.SomChanged(4.0, robot.core._som.with_services(changed)))
    robot.fail("/a", A, 10.0)
    robot.killed(10.1, A)
    takes_over(robot, 10.5)
    start = only(lost(robot, 20.0, BOARD), events.StartSubstitute)
    assert start.program is not None and start.program.inputs == ("/c/data",)  # /b is there no more


def test_a_stop_that_may_not_have_been_heard_is_said_again() -> None:
    robot = distributed()
    robot.fail("/a", A, 10.0)
    robot.killed(10.1, A)
    node = takes_over(robot, 10.5)
    commands = robot.failure("/a", node, 20.0, "silent", "no message", 19.7)
    assert stopped(commands) == [node]  # the link is down, and nobody knows it yet
    lost(robot, 20.8, BOARD)
    assert stopped(seen(robot, 25.0, BOARD)) == [node]
    assert "stray " + node in robot.written
    steady(robot, 25.5, 25.6 + HEARD_S, BOARD)
    assert "stray " + node not in robot.written
    lost(robot, 40.0, BOARD)
    assert stopped(seen(robot, 50.0, BOARD)) == []


def test_what_has_ended_by_itself_is_not_told_to() -> None:
    robot = distributed()
    robot.fail("/a", A, 10.0)
    node = takes_over(robot, 10.5)
    robot.failure("/a", node, 20.0, "silent", "no message", 19.7)
    robot.handle(events.ProcessExited(20.1, node, "status 0"))
    lost(robot, 20.8, BOARD)
    assert stopped(seen(robot, 25.0, BOARD)) == []


def test_the_next_reconfigurator_knows_whom_it_has_to_end_on_a_lost_computer() -> None:
    robot = distributed(standby=Standby.HOT)
    (row,) = robot.working()
    lost(robot, 10.0, BOARD)
    records = tuple(robot.written.values())
    (ours,) = [each.node for each in robot.working()]
    heir = Robot(som(standby=Standby.HOT))
    heir.handle(events.Started(20.0, (), (), records, (ours,)))
    assert row.node in stopped(seen(heir, 21.0, BOARD))


def test_a_hot_substitute_elsewhere_is_not_taken_for_one_here_by_the_next() -> None:
    robot = distributed(standby=Standby.HOT)
    (row,) = robot.working()
    heir = Robot(som(standby=Standby.HOT))
    heir.handle(events.Started(20.0, (), (), tuple(robot.written.values()), (row.node,)))
    assert (row.node, BOARD) in [(each.node, each.host) for each in heir.working()]
    assert only(lost(heir, 25.0, BOARD), events.StartSubstitute).host == ""


def test_what_no_warm_service_needs_any_more_does_not_stay_on_a_lost_computer() -> None:
    robot = distributed(standby=Standby.WARM)
    (row,) = robot.idle_rows()
    robot.handle(events.SomChanged(5.0, som()))
    lost(robot, 10.0, BOARD)
    assert robot.idle_rows() == [] and row.node in stopped(seen(robot, 20.0, BOARD))


def test_a_substitute_that_has_ended_on_a_lost_computer_is_not_told_to() -> None:
    robot = distributed()
    robot.fail("/a", A, 10.0)
    robot.killed(10.1, A)
    node = takes_over(robot, 10.5)
    lost(robot, 20.0, BOARD)
    assert stopped(robot.handle(events.ProcessExited(20.1, node, "status 0"))) == []
    assert node not in stopped(seen(robot, 30.0, BOARD))


# The node's computer is lost


def cut(robot: Robot, time: float) -> None:
    """The Pi is cut off: A is silent, it is taken over, and then the loss is known."""
    silent(robot, time + 0.25)
    takes_over(robot, time + 0.3)
    robot.table(time + 0.31)
    lost(robot, time + 1.0, PI)


def test_a_node_that_is_silent_with_its_computer_is_taken_over_and_not_killed() -> None:
    robot = distributed(standby=Standby.HOT)
    cut(robot, 10.0)
    assert not has(robot.said, events.FindNode)
    assert last_incident(robot.said).state is State.HEALED and publishing(robot) == (True,)
    seen(robot, 18.0, PI)
    assert last_incident(back(robot, 18.1)).state is State.RETURNING
    assert publishing(robot) == (False,)
    robot.handle(events.Tick(20.2))
    assert robot.core.incident("a") is None
    for time in (20.5, 21.0, 25.0):
        seen(robot, time, PI)
    assert not has(robot.said, events.FindNode)


def test_a_node_that_is_silent_beside_its_computer_is_killed() -> None:
    robot = distributed(standby=Standby.HOT)
    steady(robot, 3.0, 10.0, PI)
    silent(robot, 10.0)
    takes_over(robot, 10.1)
    assert not has(steady(robot, 10.0, 10.1 + CERTAIN_S, PI), events.FindNode)
    assert only(seen(robot, 10.1 + CERTAIN_S, PI), events.FindNode).node == A


def test_a_node_that_hangs_on_a_computer_that_is_back_is_killed_there() -> None:
    robot = distributed(standby=Standby.HOT)
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
    commands = robot.handle(events.NodeFound(10.1, A, events.Where.UNREACHABLE))
    assert "/a_node may still run: its computer cannot be reached." in str(commands)
    assert publishing(robot) == (True,)  # it is not heard here
    incident = last_incident(commands)
    assert incident.killed is None and "may still run" in incident.detail
    assert only(seen(robot, 18.0, PI), events.FindNode).node == A


def test_a_kill_that_is_under_way_when_the_computer_is_lost_is_finished_later() -> None:
    robot = distributed(standby=Standby.HOT)
    robot.failure("/a", A, 10.0, "out_of_range", "99 is out of range.", 9.0)
    assert publishing(robot) == (False,)
    commands = lost(robot, 10.5, PI)
    assert "/a_node may still run: pi is lost: its agent is silent." in str(commands)
    assert publishing(robot) == (True,)
    assert only(seen(robot, 18.0, PI), events.FindNode).node == A


def test_a_node_that_is_to_start_again_on_a_lost_computer_is_waited_for() -> None:
    robot = distributed(policy=Policy.RESTART)
    robot.failure("/a", A, 10.0, "out_of_range", "99 is out of range.", 9.0)
    lost(robot, 10.5, PI)
    incident = robot.core.incident("a")
    assert incident is not None and incident.state is State.HEALING
    seen(robot, 18.0, PI)
    robot.killed(18.1, A)
    assert only(robot.handle(events.Tick(18.7)), events.RestartNode).node == A


def test_where_nobody_says_on_which_computer_a_node_is_it_is_left_alone() -> None:
    robot = Robot()
    robot.fail("/a", A, 10.0, "out_of_range")
    commands = robot.handle(events.NodeFound(10.1, A, events.Where.UNREACHABLE))
    assert "/a_node may still be running: its computer cannot be reached" in str(commands)
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
        incident = last_incident(back(robot, time + 0.1))
        assert incident.state is State.RETURNING and not incident.kept_out
        robot.handle(events.Tick(time + 1.0))
        time += 2.0
    seen(robot, time - 0.5, PI)
    robot.handle(events.Tick(time + 0.2))
    assert robot.core.incident("a") is None and publishing(robot) == (False,)
    assert not has(robot.said, events.FindNode)


def asked(robot: Robot, time: float, rate: Optional[float]) -> List[events.Command]:
    """The Pi is heard beside A's silence, is asked for A, and says what A sends there."""
    commands = steady(robot, time, time + CERTAIN_S + 0.5, PI)
    find = only(commands, events.FindNode)
    assert (find.node, find.topic) == (A, "/a") and find.listen > 0.0
    time += CERTAIN_S + 1.0
    return robot.handle(events.NodeFound(time, A, events.Where.HERE, rate=rate))


@pytest.mark.parametrize("rate", [50.0, 40.0, None])
def test_a_node_that_is_not_silent_on_its_own_computer_is_not_killed(
    rate: Optional[float],
) -> None:
    robot = distributed(standby=Standby.HOT)
    silent(robot, 10.0)
    takes_over(robot, 10.1)
    commands = asked(robot, 10.1, rate)
    incident = last_incident(commands)
    assert not has(commands, events.AskToLeave) and publishing(robot) == (True,)
    assert incident.decision.startswith("/a_node is not killed: ")
    assert "its link" in incident.detail and incident.killed is None
    again = asked(robot, 13.2, rate)  # it may hang by now
    assert not has(again, events.ShowIncident) and not has(again, events.Log)
    assert has(asked(robot, 17.0, 0.0), events.AskToLeave)


def test_a_node_that_is_silent_on_its_own_computer_is_killed() -> None:
    robot = distributed(standby=Standby.HOT)
    silent(robot, 10.0)
    takes_over(robot, 10.1)
    assert has(asked(robot, 10.1, 0.0), events.AskToLeave)


def test_a_computer_that_does_not_say_in_time_how_a_silent_node_does_is_asked_again() -> None:
    robot = distributed(standby=Standby.HOT)
    silent(robot, 10.0)
    takes_over(robot, 10.1)
    steady(robot, 10.1, 13.0, PI)
    commands = robot.handle(events.Tick(16.0))
    assert "may still run: its computer does not say how it does" in str(commands)
    assert publishing(robot) == (True,) and has(asked(robot, 16.0, 0.0), events.AskToLeave)


@pytest.mark.parametrize("kind", ["rate_low", "rate_high"])
def test_a_node_that_sends_at_its_rate_is_not_killed_for_what_the_link_makes_of_it(
    kind: str,
) -> None:
    robot = distributed(standby=Standby.HOT)
    assert only(robot.failure("/a", A, 10.0, kind, "20 in 1 s.", 9.9), events.FindNode).listen
    commands = robot.handle(events.NodeFound(10.6, A, events.Where.HERE, rate=50.0))
    assert not has(robot.said, events.AskToLeave) and publishing(robot) == (True,)
    assert "on its own computer it sends 50 messages/s" in last_incident(commands).detail
    for rate in (10.0, 100.0):
        robot = distributed(standby=Standby.HOT)
        robot.failure("/a", A, 10.0, kind, "20 in 1 s.", 9.9)
        there = events.NodeFound(10.6, A, events.Where.HERE, rate=rate)
        assert only(robot.handle(there), events.AskToLeave).node == A


def test_a_node_here_has_no_link_and_is_killed_by_what_is_heard() -> None:
    robot = Robot()
    find = only(robot.failure("/a", A, 10.0, "rate_low", "20 in 1 s.", 9.9), events.FindNode)
    assert find.listen == 0.0
    assert has(robot.handle(events.NodeFound(10.1, A, events.Where.HERE)), events.AskToLeave)


def test_what_the_som_wants_killed_is_killed_whatever_its_computer_says() -> None:
    robot = distributed(standby=Standby.HOT, contain=Contain.NODE)
    assert only(silent(robot, 10.0), events.FindNode).listen == 0.0
    assert has(robot.handle(events.NodeFound(10.1, A, events.Where.HERE)), events.AskToLeave)


def relapses(robot: Robot, kind: str, count: int) -> Incident:
    """A fails and is back half a second later, again and again; its computer is heard."""
    for number in range(count):
        time = 10.0 + number
        seen(robot, time, PI)
        robot.row("/a", A, "failed", time)
        robot.failure("/a", A, time, kind, "no message for 0.25 s.", time - 0.25)
        takes_over(robot, time + 0.1)
        if kind != "silent":
            robot.killed(time + 0.2, A)
        seen(robot, time + 0.5, PI)
        back(robot, time + 0.5)
    incident = robot.core.incident("a")
    assert incident is not None and incident.id == 1
    return incident


def test_a_lossy_link_keeps_nobody_out_and_the_way_back_takes_ever_longer() -> None:
    robot = distributed(standby=Standby.HOT, healings=1)
    incident = relapses(robot, "silent", 5)
    assert incident.state is State.RETURNING and not incident.kept_out
    assert "It must stay healthy for 32 s" in str(robot.said)
    assert not has(robot.said, events.FindNode)
    robot.handle(events.Tick(14.5 + 31.9))
    assert robot.core.incident("a") is not None
    robot.handle(events.Tick(14.5 + 32.1))
    assert robot.core.incident("a") is None


def test_what_a_link_does_not_cause_keeps_out_as_ever() -> None:
    robot = distributed(standby=Standby.HOT)
    assert relapses(robot, "out_of_range", 4).kept_out


def test_who_is_silent_on_its_own_computer_again_and_again_is_kept_out() -> None:
    robot = distributed(standby=Standby.HOT)
    for time in (10.0, 16.0, 22.0, 28.0):
        silent(robot, time)
        takes_over(robot, time + 0.1)
        asked(robot, time + 0.1, 0.0)
        robot.killed(time + 4.0, A)
        steady(robot, time + 3.0, time + 5.0, PI)
        back(robot, time + 5.0)
        steady(robot, time + 5.0, time + 6.0, PI)
    incident = robot.core.incident("a")
    assert incident is not None and incident.kept_out


def test_a_cut_that_is_shorter_than_a_loss_is_no_failure_of_the_node_either() -> None:
    robot = distributed(standby=Standby.HOT)
    time = 10.0
    for _ in range(5):
        seen(robot, time, PI)
        silent(robot, time + 0.3)
        takes_over(robot, time + 0.4)
        seen(robot, time + 1.9, PI)
        incident = last_incident(back(robot, time + 2.0))
        assert not incident.kept_out
        time += 2.5
    seen(robot, time, PI)
    assert not has(seen(robot, time + 0.5, PI), events.FindNode)


# on_partition: wait

WAIT = OnPartition.WAIT


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
    assert last_incident(back(robot, 18.1)).state is State.RETURNING
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


# The SOM changes


def test_a_substitute_on_a_computer_that_is_forbidden_now_moves() -> None:
    robot = distributed(standby=Standby.HOT)
    (row,) = robot.working()
    commands = robot.handle(
        events.SomChanged(5.0, som(standby=Standby.HOT, placement=Placement(forbid=(BOARD,))))
    )
    assert stopped(commands) == [row.node]
    assert only(commands, events.StartSubstitute).host == ""
    robot.fail("/a", A, 10.0)
    node = takes_over(robot, 10.1)
    robot.killed(10.2, A)
    forbidden = som(standby=Standby.HOT, placement=Placement(forbid=(PI, BOARD)))
    assert not stopped(robot.handle(events.SomChanged(11.0, forbidden)))
    moved = som(standby=Standby.HOT, placement=Placement(prefer=(BOARD,)))
    assert not stopped(robot.handle(events.SomChanged(12.0, moved)))
    assert publishing(robot) == (True,) and robot.shown[node].host == ""


def test_a_broken_invariant_of_computers_is_told() -> None:
    robot = distributed(standby=Standby.HOT)
    robot.core._hosts._known[BOARD].detail = "silent"
    with pytest.raises(ShsaError, match="stands by for a on board, which is lost"):
        robot.core.validate()
    robot = distributed(standby=Standby.WARM)
    robot.core._hosts._known[BOARD].detail = "silent"
    with pytest.raises(ShsaError, match="stands by on a computer that is lost"):
        robot.core.validate()
