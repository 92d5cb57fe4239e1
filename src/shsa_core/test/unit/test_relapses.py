"""A node that fails again soon after its return: a longer hold-off, and kept out in the end."""
from dataclasses import replace
from typing import List

import pytest

from core_robot import (
    A,
    ONTOLOGY,
    SHARED,
    SOM,
    WITH_D,
    Robot,
    changed,
    function,
    has,
    last_incident,
    only,
    publishing,
    service,
)
from shsa_core.healing import events, repair
from shsa_core.healing.incident import State
from shsa_core.healing.service import ServiceMachine
from shsa_core.model.kinds import Policy
from shsa_core.model.ontology import Ontology
from shsa_core.model.som import Som


def test_the_hold_off_grows_while_the_original_fails_within_it() -> None:
    robot = Robot(switches=9, hold_off_limit=5.0)
    robot.heal(10.0)
    for time, hold_off in ((20.0, 2.0), (30.0, 4.0), (40.0, 5.0), (50.0, 5.0)):
        robot.back(time)
        assert robot.core.deadline == pytest.approx(time + hold_off)
        robot.fail("/a", A, time + 1.0)
        robot.killed(time + 1.01, A)
    robot.back(60.0)
    robot.handle(events.Tick(70.0))
    robot.heal(80.0)
    robot.back(90.0)
    assert robot.core.deadline == pytest.approx(92.0)


def test_where_relapses_do_not_count_the_hold_off_stays_as_it_is() -> None:
    robot = Robot(switches=0)
    robot.heal(10.0)
    for time in (20.0, 30.0, 40.0):
        robot.back(time)
        assert robot.core.deadline == pytest.approx(time + 2.0)
        robot.fail("/a", A, time + 1.0)
        robot.killed(time + 1.01, A)


def test_a_relapse_is_searched_for_once(monkeypatch: pytest.MonkeyPatch) -> None:
    robot = Robot()
    node = robot.heal(10.0)
    robot.back(12.0)
    robot.handle(events.ProcessExited(12.1, node, "status 1"))
    searches: List[str] = []
    search = repair.search

    def counted(service: ServiceMachine) -> object:
        searches.append(service.spec.name)
        return search(service)

    monkeypatch.setattr(repair, "search", counted)
    start = only(robot.fail("/a", A, 13.0), events.StartSubstitute)
    assert searches == ["a"] and [row.node for row in robot.working()] == [start.node]


def flap(robot: Robot, time: float) -> List[str]:
    """Return what is said of it as the node is gone again."""
    robot.back(time)
    robot.fail("/a", A, time + 1.0)
    said = robot.killed(time + 1.01, A)
    return [each.text for each in said if isinstance(each, events.Log)]


def test_an_original_that_keeps_failing_is_kept_out_until_it_is_released() -> None:
    robot = Robot(switches=2)
    robot.heal(10.0)
    assert flap(robot, 20.0) == [] and not last_incident(robot.said).kept_out
    (text,) = flap(robot, 30.0)
    assert "/a_node keeps failing, and is kept out. Repair it, and restart healing or, with" in text
    assert last_incident(robot.said).kept_out
    commands = robot.back(40.0)
    assert only(commands, events.FindNode) == events.FindNode(A, topic="/a")
    assert publishing(robot) == (True,)  # nothing is muted for it
    assert has(robot.handle(events.NodeFound(40.1, A, events.Where.HERE)), events.EndProcess)
    robot.handle(events.NodeLeft(40.11, A))
    assert publishing(robot) == (True,)
    assert last_incident(robot.said).state is State.HEALED
    assert not last_incident(robot.handle(events.Released(50.0, "a"))).kept_out
    assert last_incident(robot.back(51.0)).state is State.RETURNING


def test_a_node_relapses_once_whatever_it_publishes() -> None:
    services = [service("a", A, True), service("b", A, True), service("c", "/c_node")]
    laws = [function("p", "a", "c + 1", 0.9), function("q", "b", "c + 2", 0.9)]
    robot = Robot(Som(services), Ontology(ONTOLOGY.properties, {}, laws), switches=2)
    for time in (10.0, 13.0, 16.0):
        for topic in ("/a", "/b"):
            robot.fail(topic, A, time)
        robot.killed(time + 0.1, A)
        incidents = [robot.core.incident(name) for name in "ab"]
        assert [each and each.kept_out for each in incidents] == [time == 16.0] * 2
        robot.row("/a", A, "healthy", time + 1.0)
        robot.row("/b", A, "healthy", time + 1.0)
        robot.table(time + 1.01)


def test_an_original_that_keeps_failing_is_better_than_nothing() -> None:
    robot = Robot(switches=1)
    robot.heal(10.0)
    flap(robot, 20.0)
    robot.rows.pop(("/b", "/b_node"))
    robot.rows.pop(("/c", "/c_node"))
    incident = last_incident(robot.table(25.0))
    assert incident.state is State.UNHEALED and not incident.kept_out
    assert last_incident(robot.back(30.0)).state is State.RETURNING


@pytest.mark.parametrize("lives", [0.9, 1.6, 3.7, 9.9])
def test_an_original_that_fails_soon_after_each_return_is_heard_no_more_after_three(
    lives: float,
) -> None:
    robot = Robot()
    time, returns = 10.0, 0
    node = robot.heal(time)
    for _ in range(20):
        time += 1.0
        killed = [each for each in robot.back(time) if isinstance(each, events.FindNode)]
        if killed:
            assert publishing(robot) == (True,)
            robot.killed(time + 0.05, A)
            continue
        returns += 1
        time += lives
        for each in (2.0, 4.0, 8.0):
            if each < lives:
                robot.handle(events.Tick(time - lives + each + 0.1))
        robot.fail("/a", A, time)
        robot.killed(time + 0.01, A)
        node = robot.working()[0].node
        robot.row("/a", node, "healthy", time + 0.5, first=time + 0.5)
        robot.table(time + 0.51)
    assert returns == 3 and last_incident(robot.said).kept_out
    assert last_incident(robot.said).state is State.HEALED and publishing(robot) == (True,)


def test_a_node_that_was_told_to_leave_after_its_hold_off_has_not_relapsed() -> None:
    robot = Robot(switches=1)
    for number in range(5):
        time = 10.0 + 5.0 * number
        robot.heal(time)
        robot.handle(events.NodeUnregistered(time + 0.6, A))
        assert not last_incident(robot.said).kept_out
        robot.back(time + 1.0)
        robot.handle(events.Tick(time + 4.0))
    robot.heal(40.0)
    robot.handle(events.NodeUnregistered(40.6, A))
    flap(robot, 50.0)
    robot.handle(events.NodeUnregistered(51.1, A))  # within its hold-off it counts
    assert last_incident(robot.said).kept_out


def test_a_relapse_counts_only_in_a_row() -> None:
    robot = Robot(switches=2)
    time = 10.0
    robot.heal(time)
    for lives in (3.0, 30.0, 3.0, 30.0, 3.0):
        robot.back(time + 1.0)
        robot.handle(events.Tick(time + min(lives, 10.0)))
        time += 1.0 + lives
        robot.fail("/a", A, time)
        robot.killed(time + 0.01, A)
        assert not last_incident(robot.said).kept_out


def test_who_is_kept_out_is_killed_as_it_registers_and_whoever_starts_it_is_named() -> None:
    robot = Robot(switches=1)
    robot.heal(10.0)
    flap(robot, 20.0)
    told = []
    for number in range(40):
        time = 30.0 + number
        robot.row("/a", A, "unknown", time)
        assert only(robot.table(time), events.FindNode).node == A
        assert publishing(robot) == (True,)
        where = events.NodeFound(time + 0.01, A, events.Where.HERE, "", "roslaunch, process 7")
        assert only(robot.handle(where), events.EndProcess).node == A
        said = robot.handle(events.NodeLeft(time + 0.02, A))
        told += [each.text for each in said if isinstance(each, events.Log)]
        robot.rows.pop(("/a", A))
        robot.table(time + 0.03)
    assert 3 < len(told) < 8  # ever more seldom
    assert "/a_node is kept out, and was started again once by roslaunch, process 7" in told[0]
    assert "rosservice call /shsa/release /a" in told[0]
    assert last_incident(robot.said).state is State.HEALED


def test_who_is_kept_out_and_cannot_be_killed_is_let_in() -> None:
    robot = Robot(switches=1)
    robot.heal(10.0)
    flap(robot, 20.0)
    robot.back(30.0)
    assert publishing(robot) == (True,)
    commands = robot.killed(30.1, A, certain=False)
    assert last_incident(commands).state is State.RETURNING and publishing(robot) == (False,)


def test_who_is_kept_out_and_may_bring_what_nothing_else_gives_is_let_in() -> None:
    two = replace(service("x", A, needed=True), name="x")
    robot = Robot(Som([*SOM, two]), switches=1)
    robot.fail("/x", A, 9.99)
    robot.heal(10.0)
    flap(robot, 20.0)
    robot.row("/a", A, "unknown", 30.0)
    assert not has(robot.table(30.0), events.FindNode)
    assert last_incident(robot.back(30.1)).state is State.RETURNING


def test_one_that_still_runs_is_not_called_kept_out() -> None:
    """It takes its time to shut down, and its successor returns."""
    robot = Robot(switches=1)
    robot.heal(10.0)
    robot.back(20.0)
    robot.fail("/a", A, 21.0)
    robot.handle(events.NodeFound(22.0, A, events.Where.ANOTHER, "it closed its address"))
    assert not any("kept out" in e.text for e in robot.said if isinstance(e, events.Log))
    assert last_incident(robot.back(23.0)).state is State.RETURNING


def test_who_is_kept_out_is_watched_for_by_one_word() -> None:
    robot = Robot(switches=1)
    robot.heal(10.0)
    robot.back(20.0)
    robot.fail("/a", A, 21.0)
    robot.killed(21.1, A)
    for time in (22.0, 23.0):
        robot.handle(events.Tick(time))
    assert only(robot.said, events.WatchNodes).nodes == (A,)


def test_a_node_that_alone_gives_another_topic_is_let_in() -> None:
    som = changed(Som([*SHARED, SOM.services["c"]]), "d", policy=Policy.ADVISE)
    robot = Robot(som, WITH_D, switches=1)

    def dies(time: float) -> None:
        for topic in ("/a", "/d"):
            robot.row(topic, A, "failed", time)
            robot.failure(topic, A, time, "node_gone", "died", time - 0.02)
        robot.killed(time + 0.01, A)

    dies(10.0)
    robot.heard(robot.working()[0].node, 10.5)
    robot.row("/d", A, "healthy", 20.0)
    robot.back(20.0)
    dies(21.0)
    incident = robot.core.incident("a")
    assert incident is not None and incident.kept_out
    assert not has(robot.handle(events.NodeCameUp(30.0, A)), events.FindNode)


def refused(switches: int = 1) -> Robot:
    """The node of /a is kept out, has come up, and its process is searched for."""
    robot = Robot(switches=switches)
    robot.heal(10.0)
    flap(robot, 20.0)
    assert only(robot.back(30.0), events.FindNode).node == A
    return robot


def test_a_node_that_is_released_while_its_process_is_searched_for_is_spared() -> None:
    robot = refused()
    robot.handle(events.Released(30.01, "a"))
    commands = robot.handle(events.NodeFound(30.02, A, events.Where.HERE))
    assert not has(commands, events.EndProcess) and not has(commands, events.AskToLeave)
    assert last_incident(commands).state is State.RETURNING
    assert not has(robot.handle(events.Tick(32.05)), events.FindNode)


def test_a_node_is_spared_that_nothing_replaces_any_more_while_it_is_searched_for() -> None:
    robot = refused()
    for node in ("b", "c"):
        robot.row(f"/{node}", f"/{node}_node", "failed", 30.005)
    assert last_incident(robot.table(30.01)).state is State.UNHEALED
    commands = robot.handle(events.NodeFound(30.02, A, events.Where.HERE))
    assert not has(commands, events.EndProcess)
    assert last_incident(commands).state is State.RETURNING


def test_the_process_of_a_released_node_that_is_being_ended_is_ended() -> None:
    robot = refused()
    assert has(robot.handle(events.NodeFound(30.01, A, events.Where.HERE)), events.EndProcess)
    robot.handle(events.Released(30.02, "a"))
    assert last_incident(robot.handle(events.NodeLeft(30.03, A))).killed == 30.03
