"""A bad link to a node on another computer: it is asked there before it is ended."""
from typing import List, Optional

import pytest

from core_robot import A, Robot, has, last_incident, only, publishing
from hosts_robot import PI, distributed, seen, silent, steady, takes_over
from shsa_core.healing import events
from shsa_core.healing.incident import Incident, State
from shsa_core.healing.kill import Kills
from shsa_core.model.kinds import Contain, Standby
from shsa_core.planning.settings import CERTAIN_S


def asked(robot: Robot, time: float, rate: Optional[float]) -> List[events.Command]:
    """The Pi is heard beside A's silence, is asked for A, and says what A sends there."""
    late, commands = time + 3.0 * CERTAIN_S, seen(robot, time, PI)
    while not has(commands, events.FindNode) and time < late:
        time += 0.5
        commands = seen(robot, time, PI)
    find = only(commands, events.FindNode)
    assert (find.node, find.topic) == (A, "/a") and find.listen > 0.0
    time += 1.0
    return robot.handle(events.NodeFound(time, A, events.Where.HERE, rate=rate))


@pytest.mark.parametrize("rate", [50.0, 40.0, None])
def test_a_node_that_is_not_silent_on_its_own_computer_is_not_killed(rate: Optional[float]) -> None:
    robot = distributed(standby=Standby.HOT, contain=Contain.NODE)
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
    robot = distributed(standby=Standby.HOT, contain=Contain.NODE)
    silent(robot, 10.0)
    takes_over(robot, 10.1)
    assert has(asked(robot, 10.1, 0.0), events.AskToLeave)


def test_a_computer_that_does_not_say_in_time_how_a_silent_node_does_is_asked_again() -> None:
    robot = distributed(standby=Standby.HOT, contain=Contain.NODE)
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


def test_a_node_that_sends_too_much_on_its_own_computer_is_killed_at_once() -> None:
    robot = distributed(standby=Standby.HOT)
    robot.failure("/a", A, 10.0, "rate_high", "200 in 1 s.", 9.9)
    there = events.NodeFound(10.6, A, events.Where.HERE, rate=200.0)
    assert only(robot.handle(there), events.AskToLeave).node == A


def slow(robot: Robot, load: float = 0.5) -> List[events.Command]:
    """A is slow here, and so it is each time that its computer is asked; what the last led to."""
    find = robot.failure("/a", A, 10.0, "rate_low", "50 in 1.8 s.", 9.9)
    commands: List[events.Command] = []
    for number in range(3):
        assert only(find, events.FindNode) and not has(robot.said, events.AskToLeave)
        time = 10.6 + 3.0 * number
        seen(robot, time, PI, load=load)
        commands = robot.handle(events.NodeFound(time, A, events.Where.HERE, rate=28.0))
        find = [] if number == 2 else steady(robot, time, time + CERTAIN_S + 0.5, PI)
    return commands


def test_a_node_that_stays_slow_on_its_own_computer_is_killed() -> None:
    assert only(slow(distributed(standby=Standby.HOT)), events.AskToLeave).node == A


def test_a_node_is_not_killed_for_being_slow_where_too_much_is_to_be_done() -> None:
    robot = distributed(standby=Standby.HOT)
    assert not has(slow(robot, load=4.0), events.AskToLeave) and publishing(robot) == (True,)
    incident = robot.core.incident("a")
    assert incident is not None and "its computer has too much to do" in incident.decision


def test_who_is_slow_now_and_then_is_not_slow_for_good() -> None:
    looks = Kills(Robot().core.robot)

    def doubted(time: float, rate: float = 28.0) -> bool:
        found = events.NodeFound(time, A, events.Where.HERE, rate=rate)
        return looks.doubt(found, 0.02) is not None

    assert doubted(0.0) and doubted(2.6)
    looks.forget(A)
    assert doubted(20.0) and doubted(22.6)
    assert doubted(25.0, 50.0) and doubted(26.0)
    assert not doubted(30.0)


def test_that_a_node_is_killed_is_not_promised_before_its_computer_was_asked() -> None:
    robot = distributed(standby=Standby.HOT)
    said = last_incident(robot.failure("/a", A, 10.0, "rate_low", "20 in 1 s.", 9.9)).decision
    assert said.endswith("is taken over, unless it does well on its own computer")


def test_a_node_here_has_no_link_and_is_killed_by_what_is_heard() -> None:
    robot = Robot()
    find = only(robot.failure("/a", A, 10.0, "rate_low", "20 in 1 s.", 9.9), events.FindNode)
    assert find.listen == 0.0
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
        robot.back(time + 0.5)
    incident = robot.core.incident("a")
    assert incident is not None and incident.id == 1
    return incident


def test_a_lossy_link_keeps_nobody_out_and_the_way_back_takes_ever_longer() -> None:
    robot = distributed(standby=Standby.HOT)
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
    robot = distributed(standby=Standby.HOT, contain=Contain.NODE)
    for time in (10.0, 16.0, 22.0, 28.0):
        silent(robot, time)
        takes_over(robot, time + 0.1)
        asked(robot, time + 0.1, 0.0)
        robot.killed(time + 4.0, A)
        steady(robot, time + 3.0, time + 5.0, PI)
        robot.back(time + 5.0)
        steady(robot, time + 5.0, time + 6.0, PI)
    incident = robot.core.incident("a")
    assert incident is not None and incident.kept_out
