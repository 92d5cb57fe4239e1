"""A node that lives is not ended for leaving its topic, or for taking its time to shut down."""
from dataclasses import replace
from typing import List, Optional

import pytest

from core_robot import A, SOM, Robot, changed, has, last_incident, only, publishing
from shsa_core.healing import events
from shsa_core.healing.events import AskToLeave, EndProcess, FindNode, NodeFound, Where
from shsa_core.healing.incident import State
from shsa_core.model.kinds import Contain, Kind, Policy
from shsa_core.model.log import Level
from shsa_core.model.som import Som


def logged(said: List[events.Command], text: str) -> bool:
    return any(text in each.text for each in said if isinstance(each, events.Log))


@pytest.mark.parametrize("where", [Where.HERE, Where.STOPPED, Where.ANOTHER, Where.UNKNOWN])
def test_a_node_that_lost_its_connections_and_runs_is_kept_and_healed_beside(where: Where) -> None:
    robot = Robot()
    assert only(robot.fail("/a", A, 10.0), FindNode).node == A
    assert publishing(robot) == (True,)
    robot.handle(NodeFound(10.01, A, where, "it is not the one that failed"))
    assert not has(robot.said, AskToLeave) and not has(robot.said, EndProcess)
    assert not any(isinstance(e, events.Log) and e.level is Level.ERROR for e in robot.said)
    (row,) = robot.working()
    assert row.publishing and row.yields, "it is still as soon as the node is heard again"
    robot.row("/a", A, "healthy", 10.05)
    assert last_incident(robot.table(10.05)).state is State.RETURNING
    assert last_incident(robot.handle(events.Tick(15.0))).state is State.ENDED


def test_one_that_is_to_be_started_again_is_ended_if_it_stays_silent() -> None:
    robot = Robot(changed(SOM, "a", policy=Policy.RESTART_AND_SUBSTITUTE))
    robot.fail("/a", A, 10.0)
    robot.handle(NodeFound(10.01, A, Where.HERE))
    assert not has(robot.said, AskToLeave)
    assert only(robot.handle(events.Tick(12.1)), FindNode).node == A
    assert only(robot.handle(NodeFound(12.11, A, Where.HERE)), AskToLeave).node == A


def test_one_that_the_som_contains_is_ended_as_its_substitute_publishes() -> None:
    robot = Robot(changed(SOM, "a", contain=Contain.NODE))
    robot.fail("/a", A, 10.0)
    robot.handle(NodeFound(10.01, A, Where.HERE))
    assert not has(robot.said, AskToLeave)
    (ready,) = robot.working()
    robot.row("/a", ready.node, "healthy", 10.1, first=10.1)
    said = robot.table(10.1)
    assert only(said, FindNode).node == A
    assert logged(said, "is killed: the SOM says so")


def warming_up() -> Robot:
    """Return a robot whose node was good, and then said what is no number from its start, twice."""
    robot = Robot()
    robot.row("/a", A, "healthy", 0.0, uri="http://here:1/")
    robot.table(2.0)
    wrong = {"kind": Kind.NOT_A_NUMBER, "detail": "a is nan.", "last_good": None}
    for time, uri in ((10.0, "http://here:2/"), (20.0, "http://here:3/")):
        robot.row("/a", A, "failed", time, first=time, uri=uri, **wrong)
        robot.said.clear()
        robot.table(time)
        assert has(robot.said, FindNode) is (time == 10.0)
        if time == 10.0:
            robot.handle(NodeFound(time + 0.1, A, Where.HERE))
            robot.handle(events.NodeLeft(time + 0.2, A))
            del robot.rows["/a", A]
            robot.table(time + 0.3)
    return robot


def test_the_first_bad_successor_of_a_good_process_is_killed_and_the_next_may_warm_up() -> None:
    robot = warming_up()
    assert not has(robot.said, FindNode)
    assert logged(robot.said, "was never good: it may not be ready")
    robot.row("/a", A, "healthy", 22.0)
    assert last_incident(robot.table(22.0)).state is State.RETURNING


def test_a_successor_that_is_not_good_in_a_minute_had_its_time_to_warm_up() -> None:
    """As a sensor that is broken for good, and that its launch starts again."""
    robot = warming_up()
    for time in range(21, 150):
        robot.handle(events.Tick(float(time)))
        if has(robot.said, FindNode):
            break
    assert 80.0 <= time < 145.0


@pytest.mark.parametrize("last_good", [None, 9.9])
def test_a_user_s_monitor_has_nobody_ended_who_may_warm_up(last_good: Optional[float]) -> None:
    """It tells of no life: that is the one that was heard last."""
    robot = Robot()
    robot.row("/a", A, "healthy", 0.0, uri="http://here:1/")
    robot.table(2.0)
    for time, uri in ((10.0, "http://here:2/"), (20.0, "http://here:3/")):
        robot.row("/a", A, "unknown", time, first=time, uri=uri, last_good=None)
        robot.table(time)
        robot.said.clear()
        robot.failure("/a", A, time + 0.1, "not_a_number", "a is nan.", last_good)
        found = [each.uri for each in robot.said if isinstance(each, FindNode)]
        assert found == ([uri] if time == 10.0 else [])
        if time == 10.0:
            robot.killed(time + 0.2, A)


def test_an_event_driven_node_that_ends_later_is_started_again() -> None:
    """It closed its connections, and ran on until its launch ended it."""
    first, *others = SOM.services.values()
    restarts = replace(first, period=None, policy=Policy.RESTART)
    robot = Robot(Som([restarts, *others]), restart_pause=1.0)
    robot.fail("/a", A, 10.0)
    robot.handle(NodeFound(10.1, A, Where.HERE))
    found = [robot.handle(events.Tick(10.0 + time)) for time in range(1, 5)]
    assert any(has(each, FindNode) for each in found)
    robot.handle(NodeFound(14.1, A, Where.DEAD))
    robot.handle(events.NodeLeft(14.2, A))
    assert only(robot.handle(events.Tick(16.0)), events.RestartNode).node == A


def test_what_remains_of_a_node_that_ends_later_is_cleared() -> None:
    robot = Robot()
    robot.fail("/a", A, 10.0)
    robot.handle(NodeFound(10.1, A, Where.HERE))
    assert not has(robot.said, AskToLeave)
    robot.said.clear()
    robot.handle(events.Tick(13.0))
    assert only(robot.said, FindNode).node == A
    robot.handle(NodeFound(13.1, A, Where.DEAD))
    assert has(robot.said, events.ClearNode) and last_incident(robot.said).killed is not None


def test_one_that_runs_on_is_looked_for_ever_more_seldom_until_it_has_ended() -> None:
    robot = Robot()
    robot.fail("/a", A, 10.0, runs=True)
    robot.killed(10.0, A)
    looks = [10]
    for time in range(11, 300):
        if has(robot.handle(events.Tick(float(time))), FindNode):
            looks.append(time)
            robot.killed(float(time), A)
    pauses = [later - former for former, later in zip(looks, looks[1:])]
    assert pauses == sorted(pauses) and pauses[0] <= 2 and 30 < pauses[-1] <= 61
    assert not has(robot.said, AskToLeave)
    robot.gone.add(A)
    assert has(robot.handle(events.Tick(400.0)), FindNode)
    assert has(robot.killed(400.1, A), events.ClearNode)


def test_the_life_of_a_node_that_has_just_come_is_not_ended_for_the_former_one() -> None:
    robot = Robot(changed(SOM, "a", policy=Policy.RESTART_AND_SUBSTITUTE))
    robot.fail("/a", A, 10.0)
    robot.handle(NodeFound(10.01, A, Where.HERE))
    robot.row("/a", A, "unknown", 11.5, uri="http://here:2/", last_good=None)
    robot.table(11.5)
    robot.said.clear()
    robot.handle(events.Tick(12.1))
    assert not has(robot.said, FindNode)
