"""Beside substitution: nodes started again, advice, and what is done when nothing is left."""
import math
from dataclasses import replace
from math import inf
from typing import Any, List

import pytest

from core_robot import (
    assigned,
    A,
    B,
    ONTOLOGY,
    SOM,
    Robot,
    changed,
    has,
    last_incident,
    only,
    program_of,
    publishing,
    service,
)
from shsa_core.healing import events
from shsa_core.healing.incident import State
from shsa_core.healing.machine import Reconfigurator
from shsa_core.files.parameters import read_settings
from shsa_core.healing.settings import Settings
from shsa_core.model.health import PublisherHealth, PublisherState
from shsa_core.model.kinds import Contain, Kind, Policy, Standby
from shsa_core.model.service import LastResort
from shsa_core.model.som import Som


def som(policy: str = "substitute", last: LastResort = LastResort()) -> Som:
    first, *others = SOM
    return Som([replace(first, policy=Policy(policy), last_resort=last), *others])


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
    assert not has(robot.handle(events.Tick(34.0)), events.FindNode), "it is not awaited any more"


LEFT = SOM.with_services(replace(each, needed=False) for each in som("restart"))


@pytest.mark.parametrize("event", [events.LaunchEnding(10.5), events.SomChanged(10.5, LEFT)])
def test_no_node_is_started_again_once_the_launch_ends_or_nobody_needs_it(event: Any) -> None:
    robot = Robot(som("restart"), restart_pause=1.0)
    robot.fail("/a", A, 10.0)
    robot.killed(10.1, A)
    robot.handle(event)
    assert robot.core.deadline == inf, "a tick does nothing: it would be due for good"
    assert not has(robot.handle(events.Tick(12.0)), events.RestartNode)


def test_a_node_that_does_not_come_back_in_time_is_killed_and_tried_again() -> None:
    robot = Robot(som("restart"), restart_pause=1.0, restart_timeout=5.0)
    robot.fail("/a", A, 10.0)
    robot.killed(10.0, A)
    robot.handle(events.Tick(11.0))
    assert only(robot.handle(events.Tick(16.0)), events.FindNode).node == A
    robot.killed(16.1, A)
    assert has(robot.handle(events.Tick(18.2)), events.RestartNode)
    assert not has(robot.handle(events.Tick(28.1)), events.FindNode), "it has twice as long now"
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
    assert last_incident(robot.back(12.0)).state is State.RETURNING
    ended = last_incident(robot.handle(events.Tick(14.1)))
    assert ended.state is State.ENDED and ended.detail == "/a: /a_node is back."
    assert not has(robot.handle(events.Tick(30.0)), events.FindNode)


def test_restarts_are_forgotten_once_the_node_was_well_for_long() -> None:
    robot = Robot(som("restart"), restart_pause=1.0, node_restarts=1, stable=60.0)
    for time, restarts in ((10.0, True), (30.0, False), (200.0, True)):
        robot.fail("/a", A, time)
        robot.killed(time, A)
        assert has(robot.handle(events.Tick(time + 1.0)), events.RestartNode) == restarts
        robot.back(time + 2.0)
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
    robot.back(12.0)
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
    robot.fail("/a", A, 10.0, "out_of_range")
    commands = robot.killed(10.1, A, certain=False)
    assert last_incident(commands).state is State.UNHEALED
    assert not has(robot.handle(events.Tick(60.0)), events.RestartNode)


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
    robot.back(20.0)
    assert publishing(robot) == (False,)
    robot.fail("/a", A, 21.0)
    assert last_incident(robot.said).state is State.SAFE and publishing(robot) == (True,)
    robot.killed(21.1, A)
    robot.back(30.0)
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
    robot.back(20.0)
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


def acts(commands: List[events.Command]) -> List[events.Command]:
    """Return the commands that do more than tell and learn."""
    telling = (events.Log, events.ShowIncident, events.ShowSom, events.LearnNode)
    return [each for each in commands if not isinstance(each, telling)]


@pytest.mark.parametrize("kind", ["node_gone", "silent", "out_of_range", "requested"])
def test_a_policy_of_advice_plans_and_does_nothing(kind: str) -> None:
    last = LastResort(values=(("a", 1.0),), command=("stop",))
    first, *others = [service("a", A, True), service("b", B)]
    warm = replace(first, policy=Policy.ADVISE, standby=Standby.WARM, last_resort=last)
    robot = Robot(Som([warm, *others]))
    incident = last_incident(robot.fail("/a", A, 10.0, kind))
    assert incident.inputs == ("/b/data",) and incident.kept
    assert incident.state is (State.ENDED if kind == "requested" else State.KEPT)
    assert "nothing is done, as healing advises; else " in incident.decision
    told = [each.text for each in robot.said if isinstance(each, events.Log)]
    assert any("healing advises" in text and "It could be replaced" in text for text in told)
    robot.handle(events.Tick(20.0))
    assert acts(robot.said) == []


@pytest.mark.parametrize("act", [True, False])
def test_healing_advises_in_a_dry_run_and_until_the_som_says_otherwise(act: bool) -> None:
    hot = service("a", A, needed=True, standby=Standby.HOT)
    som = Som([hot, service("b", B)], act=act)
    robot = Robot(som)
    robot.core = Reconfigurator(ONTOLOGY, som, Settings(), dry_run=act)
    robot.said.clear()
    robot.table(1.0)
    robot.idle(1.0)
    robot.fail("/a", A, 10.0, "silent")
    again = changed(som, "a", contain=Contain.NODE, period=0.1)
    robot.handle(events.SomChanged(11.0, again))
    robot.handle(events.SomChanged(12.0, som, ONTOLOGY))
    robot.handle(events.Tick(30.0))
    assert acts(robot.said) == [] and last_incident(robot.said).state is State.KEPT
    robot.handle(events.SomChanged(31.0, Som(som), ONTOLOGY))
    assert bool(acts(robot.said)) is not act
