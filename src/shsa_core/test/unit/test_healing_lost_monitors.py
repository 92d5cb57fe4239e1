"""A computer is lost, and with it the monitor that watches its services."""
from typing import List

import pytest

from core_robot import A, B, C, ONTOLOGY, Robot, has, last_incident, only, publishing, service
from hosts_robot import BOARD, PI, WAIT, distributed, lost, seen, silent, stopped, takes_over
from shsa_core.healing import events
from shsa_core.healing.settings import ANSWER_S, Settings
from shsa_core.healing.incident import State
from shsa_core.healing.machine import Reconfigurator
from shsa_core.model.cost import Host
from shsa_core.model.service import Placement
from shsa_core.model.kinds import Standby
from shsa_core.model.som import Som


def watched_at_home(robot: Robot, time: float, *hosts: str) -> List[events.Command]:
    """The monitors of these computers tell of the services there."""
    commands: List[events.Command] = []
    for host in hosts:
        own = {each.topic for each in robot.som if each.host == host}
        rows = tuple(row for row in robot.rows.values() if row.topic in own)
        commands += robot.handle(events.HealthSeen(time, rows, whole=True, host=host))
    return commands


def unheard(robot: Robot, time: float, host: str) -> List[events.Command]:
    """A computer is lost, and its monitor does not answer."""
    asked = lost(robot, time, host)
    assert only(asked, events.AskMonitor).host == host
    return asked + robot.handle(events.Tick(time + ANSWER_S))


@pytest.mark.parametrize("standby", [Standby.COLD, Standby.HOT])
def test_what_only_a_lost_monitor_watched_is_healed_and_its_substitute_is_not_replaced(
    standby: Standby,
) -> None:
    robot = distributed(standby=standby)
    watched_at_home(robot, 4.0, PI, BOARD)
    commands = unheard(robot, 10.0, PI)
    incident = last_incident(commands)
    assert incident.faulty_node == A and incident.detected == 10.0 + ANSWER_S
    told = [text for text in map(str, commands) if "pi is lost, and its monitor" in text]
    assert told and publishing(robot) == (True,)
    (row,) = robot.working()
    for time in (12.0, 20.0, 40.0, 90.0):  # nobody can say that it publishes
        seen(robot, time, BOARD)
        assert not stopped(robot.handle(events.Tick(time)))
    assert [each.node for each in robot.working()] == [row.node]
    assert not has(robot.said, events.FindNode)


def test_a_monitor_that_answers_is_not_lost_with_the_agent() -> None:
    robot = distributed(standby=Standby.HOT)
    watched_at_home(robot, 4.0, PI)
    lost(robot, 10.0, PI)
    watched_at_home(robot, 10.2, PI)
    robot.handle(events.Tick(11.0))
    assert robot.core.incident("a") is None
    assert robot.core.deadline > 11.0


def test_who_did_well_all_the_time_is_back_once_its_monitor_is() -> None:
    robot = distributed(standby=Standby.HOT)
    watched_at_home(robot, 4.0, PI)
    unheard(robot, 10.0, PI)
    commands = seen(robot, 18.0, PI)
    assert publishing(robot) == (True,)  # nobody was heard yet
    # What has not changed since it never tells by itself.
    assert only(commands, events.AskMonitor).host == PI
    assert last_incident(watched_at_home(robot, 18.2, PI)).state is State.RETURNING
    assert publishing(robot) == (False,)
    robot.handle(events.Tick(20.4))
    assert robot.core.incident("a") is None and not has(robot.said, events.FindNode)


def test_a_computer_that_is_back_before_its_monitor_was_given_up_changes_nothing() -> None:
    robot = distributed(standby=Standby.HOT)
    watched_at_home(robot, 4.0, PI)
    lost(robot, 10.0, PI)
    seen(robot, 10.3, PI)
    robot.handle(events.Tick(11.0))
    assert robot.core.incident("a") is None


def test_where_the_som_says_wait_a_lost_monitor_changes_nothing() -> None:
    robot = distributed(on_partition=WAIT)
    watched_at_home(robot, 4.0, PI)
    assert last_incident(unheard(robot, 10.0, PI)).state is State.KEPT
    assert not robot.working()


def test_a_substitute_that_only_a_lost_monitor_heard_has_a_successor() -> None:
    """It ran on the computer that was lost, with its monitor."""
    robot = distributed(standby=Standby.HOT, placement=Placement(prefer=(PI,)))
    robot.fail("/a", A, 5.0)
    node = takes_over(robot, 5.1)
    robot.killed(5.2, A)
    watched_at_home(robot, 5.3, PI)
    unheard(robot, 10.0, PI)
    (row,) = robot.working()
    assert row.node != node and row.host != PI and row.publishing


def test_what_a_lost_monitor_told_is_no_input_of_a_plan() -> None:
    b = service("b", B, host=PI)
    robot = Robot(Som([service("a", A, needed=True), b, service("c", C)], [Host(PI), Host(BOARD)]))
    seen(robot, 1.0, PI, BOARD)
    watched_at_home(robot, 4.0, PI)
    unheard(robot, 10.0, PI)
    start = only(robot.fail("/a", A, 11.0), events.StartSubstitute)
    assert start.program is not None and start.program.inputs == ("/c/data",)


def test_one_monitor_for_all_goes_on_when_a_computer_is_lost() -> None:
    robot = distributed(standby=Standby.HOT)
    commands = lost(robot, 10.0, PI)
    assert not has(commands, events.AskMonitor)
    assert robot.core.incident("a") is None  # it is heard, and only its agent is not
    silent(robot, 10.2)
    takes_over(robot, 10.3)
    assert last_incident(robot.said).state is State.HEALED


def test_the_next_reconfigurator_hears_who_did_well_all_the_time_and_kills_nobody() -> None:
    robot = distributed(standby=Standby.HOT)
    watched_at_home(robot, 4.0, PI, BOARD)
    unheard(robot, 10.0, PI)
    (row,) = robot.working()
    heir = Robot(robot.som)
    heir.core = Reconfigurator(ONTOLOGY, robot.som, Settings())
    heir.said.clear()
    heir.handle(events.Started(12.0, (), (), tuple(robot.written.values()), (row.node,)))
    seen(heir, 12.1, BOARD)
    watched_at_home(heir, 12.1, BOARD)
    for time in (14.0, 17.1, 25.0, 31.0, 35.0):
        assert not stopped(heir.handle(events.Tick(time)))  # nobody can say whether it publishes
    seen(heir, 40.0, PI)
    commands = watched_at_home(heir, 40.2, PI)
    assert last_incident(commands).state is State.RETURNING
    for time in (41.0, 42.0, 43.0, 44.0):
        seen(heir, time, PI, BOARD)
        heir.handle(events.Tick(time))
    assert heir.core.incident("a") is None and not has(heir.said, events.FindNode)
