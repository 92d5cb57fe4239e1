"""Beside substitution: nodes started again, trusted less, kept out.

And what is done when nothing is left.
"""
import math
from dataclasses import replace
from math import inf
from typing import List

import pytest

from core_robot import (
    assigned,
    A,
    ONTOLOGY,
    SOM,
    Robot,
    function,
    has,
    last_incident,
    only,
    program_of,
    publishing,
    service,
)
from shsa_core.healing import events
from shsa_core.healing.incident import State
from shsa_core.files.parameters import read_settings
from shsa_core.healing.settings import Settings
from shsa_core.model.health import PublisherHealth, PublisherState
from shsa_core.model.kinds import Kind, Policy
from shsa_core.model.ontology import Ontology
from shsa_core.model.service import LastResort
from shsa_core.model.som import Som


def som(policy: str = "substitute", last: LastResort = LastResort()) -> Som:
    first, *others = SOM
    return Som([replace(first, policy=Policy(policy), last_resort=last), *others])


def back(robot: Robot, time: float) -> List[events.Command]:
    """The original publishes again."""
    robot.row("/a", A, "healthy", time)
    return robot.table(time + 0.01)


def test_a_node_is_started_again_with_growing_pauses_and_then_given_up() -> None:
    robot = Robot(som("restart"), node_restarts=2, restart_pause=1.0)
    assert not has(robot.fail("/a", A, 10.0), events.StartSubstitute)
    robot.killed(10.1, A)
    assert not has(robot.handle(events.Tick(11.0)), events.RestartNode)
    assert only(robot.handle(events.Tick(11.2)), events.RestartNode).node == A
    robot.handle(events.RestartFailed(11.3, A, "no such file"))
    assert not has(robot.handle(events.Tick(13.2)), events.RestartNode)
    assert has(robot.handle(events.Tick(13.4)), events.RestartNode)
    commands = robot.handle(events.RestartFailed(13.5, A, "no such file"))
    incident = last_incident(commands)
    assert incident.state is State.UNHEALED and incident.restarts == 2
    assert "2 times in vain" in incident.detail
    assert not has(robot.said, events.StartSubstitute)


def test_no_node_is_started_again_once_the_launch_ends() -> None:
    robot = Robot(som("restart"), restart_pause=1.0)
    robot.fail("/a", A, 10.0)
    robot.killed(10.1, A)
    robot.handle(events.LaunchEnding(10.5))
    assert robot.core.deadline == inf, "a tick does nothing: it would be due for good"
    assert not has(robot.handle(events.Tick(11.2)), events.RestartNode)


def test_a_node_that_does_not_come_back_in_time_is_killed_and_tried_again() -> None:
    robot = Robot(som("restart"), restart_pause=1.0, restart_timeout=5.0)
    robot.fail("/a", A, 10.0)
    robot.killed(10.0, A)
    robot.handle(events.Tick(11.0))
    assert only(robot.handle(events.Tick(16.0)), events.FindNode).node == A
    robot.killed(16.1, A)
    assert has(robot.handle(events.Tick(18.2)), events.RestartNode)


def test_a_node_that_needs_long_to_start_has_twice_as_long_the_next_time() -> None:
    robot = Robot(som("restart"), restart_pause=1.0, restart_timeout=5.0)
    robot.fail("/a", A, 10.0)
    robot.killed(10.0, A)
    robot.handle(events.Tick(11.0))
    robot.handle(events.Tick(16.0))
    robot.killed(16.1, A)
    assert has(robot.handle(events.Tick(18.2)), events.RestartNode)
    assert not has(robot.handle(events.Tick(28.1)), events.FindNode)
    assert has(robot.handle(events.Tick(28.3)), events.FindNode)


@pytest.mark.parametrize("kind", ["silent", "never_published"])
def test_who_cannot_be_started_again_is_not_ended_for_that(kind: str) -> None:
    unknown = Robot(som("restart"), learned=False)
    theirs = Robot(som("restart"))
    theirs.handle(events.NodeLearned(2.0, A, True, starts=False))
    for robot in (unknown, theirs):
        robot.failure("/a", A, 10.0, kind, "it is late.", 9.98)
        for time in (10.1, 12.1, 15.0):
            robot.handle(events.Tick(time))
        assert not has(robot.said, events.FindNode)
        incident = last_incident(robot.said)
        assert incident.state is State.KEPT, incident


def test_who_has_died_and_was_never_learned_is_told_to_be_started_again_in_vain() -> None:
    robot = Robot(som("restart"), learned=False, restart_pause=1.0)
    robot.fail("/a", A, 10.0)
    robot.handle(events.NodeFound(10.1, A, events.Where.DEAD))
    assert has(robot.handle(events.Tick(11.2)), events.RestartNode)


def test_who_closed_a_connection_is_not_ended_where_nobody_can_start_it() -> None:
    robot = Robot(som("restart"), learned=False)
    robot.fail("/a", A, 10.0)
    assert not has(robot.handle(events.NodeFound(10.1, A, events.Where.HERE)), events.AskToLeave)


@pytest.mark.parametrize("kind,state", [("out_of_range", "kept"), ("requested", "ended")])
def test_who_is_found_to_be_protected_is_kept_and_nobody_speaks_beside_it(
    kind: str, state: str
) -> None:
    robot = Robot(learned=False)
    robot.failure("/a", A, 10.0, kind, "it is to go.", 9.98)
    why = "its process is a nodelet manager"
    robot.handle(events.NodeFound(10.1, A, events.Where.PROTECTED, why))
    incident = last_incident(robot.said)
    assert (incident.state, incident.decision) == (state, f"{A} is kept: {why}")
    assert publishing(robot) in ((), (False,))


def test_who_only_trickles_is_ended_as_silent() -> None:
    robot = Robot(som("restart"))
    robot.failure("/a", A, 10.0, "silent", "no message for 5 s.", 5.0)
    found: List[float] = []
    for time in map(float, range(11, 30)):
        row = PublisherHealth("/a", A, PublisherState.FAILED, 10.0, 0.0, time, Kind.SILENT)
        robot.rows["/a", A] = row
        robot.table(time)
        if has(robot.handle(events.Tick(time)), events.FindNode):
            found.append(time)
    assert found and found[0] < 20.0


def test_a_node_that_speaks_again_is_not_ended_as_silent() -> None:
    robot = Robot(som("restart"))
    robot.failure("/a", A, 10.0, "silent", "no message for 5 s.", 5.0)

    def heard(time: float) -> None:
        row = PublisherHealth("/a", A, PublisherState.FAILED, 10.0, 0.0, time, Kind.SILENT)
        robot.rows["/a", A] = row
        robot.table(time)

    heard(10.5)
    assert not has(robot.handle(events.Tick(12.1)), events.FindNode)
    heard(13.5)
    assert not has(robot.handle(events.Tick(14.2)), events.FindNode)
    assert has(robot.handle(events.Tick(16.3)), events.FindNode), "it is silent again"


def test_a_node_that_was_started_again_ends_the_incident_after_its_hold_off() -> None:
    robot = Robot(som("restart"), restart_pause=1.0)
    robot.fail("/a", A, 10.0)
    robot.killed(10.0, A)
    robot.handle(events.Tick(11.0))
    assert last_incident(back(robot, 12.0)).state is State.RETURNING
    ended = last_incident(robot.handle(events.Tick(14.1)))
    assert ended.state is State.ENDED and ended.detail == "/a: /a_node is back."
    assert not has(robot.handle(events.Tick(30.0)), events.FindNode)


def test_restarts_are_forgotten_once_the_node_was_well_for_long() -> None:
    robot = Robot(som("restart"), restart_pause=1.0, node_restarts=1, stable=60.0)
    for time, restarts in ((10.0, True), (30.0, False), (200.0, True)):
        robot.fail("/a", A, time)
        robot.killed(time, A)
        assert has(robot.handle(events.Tick(time + 1.0)), events.RestartNode) == restarts
        back(robot, time + 2.0)
        robot.handle(events.Tick(time + 5.0))


def test_a_node_that_is_told_gone_twice_has_failed_once() -> None:
    robot = Robot(som("restart"), restart_pause=1.0)
    robot.fail("/a", A, 8.0, "silent")
    robot.handle(events.Tick(10.0))
    robot.killed(10.1, A)
    assert has(robot.fail("/a", A, 10.11), events.FindNode)
    robot.killed(10.2, A)
    assert last_incident(robot.said).restarts == 1
    assert has(robot.handle(events.Tick(11.1)), events.RestartNode)


def test_a_substitute_bridges_while_the_node_is_started_again() -> None:
    robot = Robot(som("restart_and_substitute"), restart_pause=1.0)
    node = robot.heal(10.0)
    commands = robot.handle(events.Tick(11.1))
    assert only(commands, events.RestartNode).node == A and publishing(robot) == (True,)
    back(robot, 12.0)
    assert publishing(robot) == (False,)
    assert only(robot.handle(events.Tick(14.1)), events.StopNode).node == node


def test_a_node_that_publishes_two_lost_topics_is_started_once() -> None:
    two = [service("a", A, True), service("b", A, True), service("c", "/c_node")]
    robot = Robot(Som([replace(each, policy=Policy.RESTART) for each in two]), restart_pause=1.0)
    robot.fail("/a", A, 10.0)
    robot.fail("/b", A, 10.1)
    robot.killed(10.2, A)
    commands = robot.handle(events.Tick(11.3))
    assert only(commands, events.RestartNode).node == A


def test_a_node_that_may_be_silent_is_not_ended_because_a_link_was_cut() -> None:
    first, *others = som("restart").services.values()
    robot = Robot(Som([replace(first, period=None), *others]))
    commands = robot.fail("/a", A, 10.0, kind=Kind.SILENT)
    assert not has(commands, events.FindNode)
    assert not has(robot.handle(events.Tick(60.0)), events.FindNode)
    robot.fail("/a", A, 61.0)
    robot.killed(61.1, A)
    assert only(robot.handle(events.Tick(70.0)), events.RestartNode).node == A


def test_an_event_driven_node_that_nobody_has_met_is_looked_for_and_started() -> None:
    """As where it has ended while the monitor was away."""
    first, *others = som("restart").services.values()
    robot = Robot(Som([replace(first, period=None), *others]))
    robot.fail("/a", A, 10.0, "never_published")
    robot.handle(events.Tick(15.0))
    robot.handle(events.NodeFound(15.1, A, events.Where.NOWHERE))
    assert only(robot.handle(events.Tick(25.0)), events.RestartNode).node == A


def test_a_node_that_may_still_run_is_not_started_a_second_time() -> None:
    robot = Robot(som("restart"))
    robot.fail("/a", A, 10.0)
    commands = robot.killed(10.1, A, certain=False)
    assert last_incident(commands).state is State.UNHEALED
    assert not has(robot.handle(events.Tick(60.0)), events.RestartNode)


def test_the_hold_off_grows_while_the_original_fails_within_it() -> None:
    robot = Robot(switches=9, hold_off_limit=5.0)
    robot.heal(10.0)
    for time, hold_off in ((20.0, 2.0), (30.0, 4.0), (40.0, 5.0), (50.0, 5.0)):
        back(robot, time)
        assert robot.core.deadline == pytest.approx(time + 0.01 + hold_off)
        robot.fail("/a", A, time + 1.0)
        robot.killed(time + 1.01, A)
    back(robot, 60.0)
    robot.handle(events.Tick(70.0))
    robot.heal(80.0)
    back(robot, 90.0)
    assert robot.core.deadline == pytest.approx(92.01)


def test_where_relapses_do_not_count_the_hold_off_stays_as_it_is() -> None:
    robot = Robot(switches=0)
    robot.heal(10.0)
    for time in (20.0, 30.0, 40.0):
        back(robot, time)
        assert robot.core.deadline == pytest.approx(time + 0.01 + 2.0)
        robot.fail("/a", A, time + 1.0)
        robot.killed(time + 1.01, A)


def flap(robot: Robot, time: float) -> None:
    back(robot, time)
    robot.fail("/a", A, time + 1.0)
    robot.killed(time + 1.01, A)


def test_an_original_that_keeps_failing_is_kept_out_until_it_is_released() -> None:
    robot = Robot(switches=2)
    robot.heal(10.0)
    flap(robot, 20.0)
    assert not last_incident(robot.said).kept_out
    flap(robot, 30.0)
    assert last_incident(robot.said).kept_out
    commands = back(robot, 40.0)
    assert only(commands, events.FindNode) == events.FindNode(A, topic="/a")
    assert publishing(robot) == (True,)  # nothing is muted for it
    assert has(robot.handle(events.NodeFound(40.1, A, events.Where.HERE)), events.EndProcess)
    robot.handle(events.NodeLeft(40.11, A))
    assert publishing(robot) == (True,)
    assert last_incident(robot.said).state is State.HEALED
    assert not last_incident(robot.handle(events.Released(50.0, "a"))).kept_out
    assert last_incident(back(robot, 51.0)).state is State.RETURNING


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
    assert last_incident(back(robot, 30.0)).state is State.RETURNING


def test_ten_failures_and_returns_in_a_row_are_all_healed() -> None:
    robot = Robot()
    for number in range(10):
        time = 10.0 + 12.0 * number
        robot.heal(time)
        back(robot, time + 1.0)
        incident = last_incident(robot.handle(events.Tick(time + 4.0)))
        assert (incident.state, incident.id) == (State.ENDED, number + 1)


@pytest.mark.parametrize("lives", [0.9, 1.6, 3.7, 9.9])
def test_an_original_that_fails_soon_after_each_return_is_heard_no_more_after_three(
    lives: float,
) -> None:
    robot = Robot()
    time, returns = 10.0, 0
    node = robot.heal(time)
    for _ in range(20):
        time += 1.0
        killed = [each for each in back(robot, time) if isinstance(each, events.FindNode)]
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
        back(robot, time + 1.0)
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
        back(robot, time + 1.0)
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
    back(robot, 30.0)
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
    assert last_incident(back(robot, 30.1)).state is State.RETURNING


def nothing_left(last: LastResort) -> Robot:
    robot = Robot(som(last=last))
    for name in "bc":
        robot.rows.pop((f"/{name}", f"/{name}_node"))
    robot.table(5.0)
    return robot


def test_the_safe_value_is_published_when_nothing_is_left() -> None:
    robot = nothing_left(LastResort(values=(("a", -1.5),)))
    commands = robot.fail("/a", A, 10.0)
    start = only(commands, events.StartSubstitute)
    assert program_of([start]).inputs == () and program_of([start]).outputs == ("/a/data",)
    assert "-1.5" in program_of([start]).code
    robot.killed(10.1, A)
    incident = last_incident(robot.said)
    assert incident.state is State.SAFE and incident.missing == ("b", "c")
    assert incident.substitute == start.node and publishing(robot) == (True,)
    robot.row("/c", "/c_node", "healthy", 20.0)
    commands = robot.table(20.0)
    assert assigned(commands) == start.node
    incident = last_incident(commands)
    assert incident.state is State.HEALED and incident.relations == ("poor",)


def test_safe_values_whose_process_dies_are_published_again() -> None:
    robot = nothing_left(LastResort(values=(("a", 1.0),)))
    first = only(robot.fail("/a", A, 10.0), events.StartSubstitute).node
    commands = robot.handle(events.ProcessExited(11.0, first, "exit status 1"))
    second = only(commands, events.StartSubstitute).node
    assert last_incident(commands).substitute == second != first


def test_safe_values_may_end_where_nodes_are_only_started_again_by_now() -> None:
    robot = nothing_left(LastResort(values=(("a", 1.0),)))
    node = only(robot.fail("/a", A, 10.0), events.StartSubstitute).node
    changed = [replace(each, policy=Policy.RESTART) for each in robot.som if each.name == "a"]
    others = [each for each in robot.som if each.name != "a"]
    robot.handle(events.SomChanged(11.0, Som([*changed, *others])))
    robot.handle(events.ProcessExited(12.0, node, "exit status 1"))
    assert robot.core.deadline < inf
    robot.handle(events.Tick(robot.core.deadline))


def test_safe_values_yield_to_an_original_that_may_speak_again() -> None:
    robot = nothing_left(LastResort(values=(("a", 1.0),)))
    robot.failure("/a", A, 10.0, "silent", "no message for 0.25 s.", 9.8)
    (row,) = robot.working()
    assert row.publishing and row.yields
    robot.failure("/a", row.node, 12.0, "silent", "no message for 0.25 s.", 11.8)
    incident = robot.core.incident("a")
    assert incident is not None and incident.state is State.SAFE and robot.working() == [row]


def test_the_original_takes_safe_values_over() -> None:
    robot = nothing_left(LastResort(values=(("a", 1.0),)))
    node = only(robot.fail("/a", A, 10.0), events.StartSubstitute).node
    robot.killed(10.1, A)
    back(robot, 20.0)
    assert publishing(robot) == (False,)
    robot.fail("/a", A, 21.0)
    assert last_incident(robot.said).state is State.SAFE and publishing(robot) == (True,)
    robot.killed(21.1, A)
    back(robot, 30.0)
    commands = robot.handle(events.Tick(40.0))
    assert only(commands, events.StopNode).node == node


def test_the_command_is_run_once_when_nothing_is_left() -> None:
    robot = nothing_left(LastResort(command=("stop", "now")))
    commands = robot.fail("/a", A, 10.0)
    assert only(commands, events.RunCommand) == events.RunCommand("a", ("stop", "now"))
    assert last_incident(commands).state is State.SAFE
    robot.killed(10.1, A)
    assert not has(robot.handle(events.Tick(12.0)), events.RunCommand)


def test_a_substitute_that_dies_in_the_hold_off_does_not_keep_the_incident_open() -> None:
    robot = Robot()
    node = robot.heal(10.0)
    back(robot, 20.0)
    robot.handle(events.ProcessExited(20.5, node, "exit status 1"))
    assert last_incident(robot.handle(events.Tick(22.1))).state is State.ENDED


def test_settings_are_read_and_bad_ones_named() -> None:
    given = {"hold_off": 1, "switches": 2.0, "method": "orr", "minimum_deadline": 0.5}
    settings, errors = read_settings(Settings, given, "/reconfigurator")
    read = Settings(hold_off=1.0, switches=2, method="orr", minimum_deadline=0.5)
    assert settings == read and not errors
    bad = {"hold_off": -1, "switches": 1.5, "method": "guess", "pool": "2", "hot_hosts": math.nan}
    bad.update({"retry": 0.5, "som": "file"})  # an internal number, and no number of this node
    settings, errors = read_settings(Settings, bad, "/r")
    assert settings == Settings() and len(errors) == 7
    for name in bad:
        assert any(f"/r/{name}" in str(error) for error in errors)


def test_a_substitute_goes_on_while_a_node_that_did_not_come_back_is_killed() -> None:
    robot = Robot(som("restart_and_substitute"), restart_pause=1.0, restart_timeout=5.0)
    robot.heal(10.0)
    robot.handle(events.Tick(11.1))
    assert has(robot.handle(events.Tick(16.2)), events.FindNode)
    assert publishing(robot) == (True,)


def test_a_substitute_is_muted_while_its_node_publishes_nonsense_again() -> None:
    robot = Robot()
    robot.heal(10.0)
    assert has(robot.fail("/a", A, 20.0, "out_of_range"), events.FindNode)
    assert publishing(robot) == (False,)
    robot.killed(20.1, A)
    assert publishing(robot) == (True,)


def test_a_policy_that_changes_while_the_node_is_awaited_counts_at_once() -> None:
    robot = Robot(som("restart"), restart_pause=1.0)
    robot.fail("/a", A, 10.0)
    robot.killed(10.1, A)
    assert only(robot.handle(events.SomChanged(10.2, som())), events.StartSubstitute)
    assert not has(robot.handle(events.Tick(12.0)), events.RestartNode)


def test_a_node_that_was_killed_under_another_policy_is_started_again() -> None:
    robot = Robot(restart_pause=1.0)
    node = robot.heal(10.0)
    robot.handle(events.SomChanged(11.0, som("restart")))
    assert publishing(robot) == (True,)
    commands = robot.handle(events.ProcessExited(12.0, node, "status 1"))
    assert not has(commands, events.StartSubstitute)
    assert last_incident(commands).substitute == ""
    assert only(robot.handle(events.Tick(13.1)), events.RestartNode).node == A


def test_what_leaves_the_som_is_not_started_again() -> None:
    robot = Robot(som("restart"), restart_pause=1.0)
    robot.fail("/a", A, 10.0)
    robot.killed(10.1, A)
    first, *others = som("restart")
    robot.handle(events.SomChanged(10.2, Som([replace(first, needed=False), *others])))
    assert robot.core.deadline == inf
    assert not has(robot.handle(events.Tick(12.0)), events.RestartNode)


def test_a_node_that_is_given_up_is_not_awaited_any_more() -> None:
    robot = Robot(som("restart"), node_restarts=1, restart_pause=1.0, restart_timeout=5.0)
    robot.fail("/a", A, 10.0)
    robot.killed(10.1, A)
    assert has(robot.handle(events.Tick(11.2)), events.RestartNode)
    robot.handle(events.RestartFailed(11.3, A, "no such file"))
    assert not has(robot.handle(events.Tick(17.0)), events.FindNode)
