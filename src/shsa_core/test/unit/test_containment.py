"""Containment: which faulty nodes are killed, which are kept, and when it is judged again."""
from dataclasses import replace
from typing import Any, Dict, List

import pytest

from core_robot import (
    A,
    B,
    BOTH,
    C,
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
    reads,
    service,
)
from shsa_core.healing import events
from shsa_core.healing.incident import State
from shsa_core.healing.machine import Reconfigurator
from shsa_core.healing.settings import Settings
from shsa_core.model.cost import Host
from shsa_core.model.health import PublisherState
from shsa_core.model.kinds import Contain, Kind, Policy, Standby
from shsa_core.model.ontology import Ontology, Property
from shsa_core.model.service import LastResort, Service
from shsa_core.model.som import Som


def test_a_wrong_node_that_gives_what_nothing_replaces_is_kept_and_only_advised_on() -> None:
    robot = Robot(SHARED, WITH_D)
    commands = robot.fail("/a", A, 10.0, "out_of_range")
    assert not has(commands, events.FindNode) and not has(commands, events.StartSubstitute)
    incident = last_incident(commands)
    assert incident.state is State.KEPT and incident.kept and incident.substitute == ""
    why = f"{A} is kept: killing it would cost /d, which nothing can replace"
    assert incident.decision == why and why in incident.detail
    assert incident.inputs == ("/b/data",) and "could be replaced: quality 0.9" in incident.detail
    assert any(why in each.text for each in commands if isinstance(each, events.Log))


def test_behind_a_gate_a_wrong_node_is_contained_without_a_kill_and_the_rest_goes_on() -> None:
    gated = dict(topic="/a/raw", beyond_gate="/a", standby=Standby.HOT)
    robot = Robot(changed(SHARED, "a", **gated), WITH_D)
    (ready,) = robot.working()
    assert ready.gated and not ready.publishing
    assert [each.topic for each in ready.outputs] == ["/a/raw"]
    commands = robot.fail("/a/raw", A, 10.0, "out_of_range")
    assert not has(robot.said, events.FindNode)
    incident = last_incident(commands)
    assert incident.kept and incident.decision.startswith(f"{A} is kept: a gate keeps")
    assert incident.substitute == ready.node and publishing(robot) == (True,)
    (row,) = robot.working()
    assert row.original == ""
    assert robot.rows["/d", A].state is PublisherState.HEALTHY
    robot.row("/a/raw", ready.node, "healthy", 10.02, first=10.02)
    assert last_incident(robot.table(10.02)).state is State.HEALED
    robot.row("/a/raw", A, "healthy", 12.0)
    assert last_incident(robot.table(12.0)).state is State.RETURNING
    assert last_incident(robot.handle(events.Tick(15.0))).state is State.ENDED
    assert publishing(robot) == (False,)


def test_it_is_killed_if_all_that_is_needed_of_it_is_taken_over() -> None:
    robot = Robot(SHARED, BOTH)
    commands = robot.fail("/a", A, 10.0, "out_of_range")
    assert only(commands, events.FindNode).node == A
    assert not last_incident(commands).kept
    robot.killed(10.1, A)
    robot.fail("/d", A, 10.11)
    assert publishing(robot) == (True, True)


def never_good() -> Robot:
    """The source is there; A has come up, and publishes what is not a number."""
    robot = Robot()
    robot.core = Reconfigurator(ONTOLOGY, SOM, Settings(hold_off=2.0))
    robot.rows = {key: row for key, row in robot.rows.items() if key[1] != A}
    robot.table(1.0)
    return robot


def test_a_node_that_was_never_good_is_kept_though_it_could_be_replaced() -> None:
    robot = never_good()
    commands = robot.failure("/a", A, 10.0, "not_a_number", "a is nan.", None)
    assert not has(commands, events.FindNode) and not has(commands, events.StartSubstitute)
    assert last_incident(commands).state is State.KEPT
    assert last_incident(robot.back(12.0)).state is State.RETURNING


@pytest.mark.parametrize("kind", ["out_of_range", "not_a_number", "stale_stamp", "rate_high"])
def test_a_node_that_nothing_replaces_is_kept_as_it_may_be_good_again(kind: str) -> None:
    robot = Robot(Som([service("a", A, needed=True)]))
    incident = last_incident(robot.fail("/a", A, 10.0, kind))
    assert incident.state is State.KEPT and "nothing can replace /a" in incident.decision
    assert not has(robot.said, events.FindNode)
    assert last_incident(robot.back(12.0)).state is State.RETURNING


def test_a_node_kept_for_one_topic_is_not_ended_for_another() -> None:
    robot = Robot(SHARED, WITH_D)
    robot.fail("/a", A, 10.0, "out_of_range")
    robot.row("/d", A, "failed", 11.0)  # it may be good again, and nothing replaces it
    robot.rows["/d", A] = replace(robot.rows["/d", A], kind=Kind.STUCK)
    assert not has(robot.table(11.0), events.FindNode)


def test_a_kept_node_is_judged_again_when_a_service_comes() -> None:
    spare = Service("spare", "/spare", "std_msgs/Float64", C, 0.02, ())
    spare = replace(spare, provides=service("d", C).provides)
    robot = Robot(Som([*SHARED, spare]), WITH_D)
    robot.rows.pop(("/spare", C))
    robot.table(5.0)
    robot.idle(5.0)
    assert not has(robot.fail("/a", A, 10.0, "out_of_range"), events.FindNode)
    robot.row("/spare", C, "healthy", 12.0)
    assert only(robot.table(12.0), events.FindNode).node == A


def test_a_kept_node_is_judged_again_when_the_som_changes() -> None:
    robot = Robot(SHARED, WITH_D)
    robot.fail("/a", A, 10.0, "out_of_range")
    commands = robot.handle(events.SomChanged(12.0, changed(SHARED, "d", needed=False)))
    assert only(commands, events.FindNode).node == A


def test_a_kept_node_is_judged_again_after_the_retry_pause_and_says_nothing_new_twice() -> None:
    robot = Robot(SHARED, WITH_D)
    robot.fail("/a", A, 10.0, "out_of_range")
    assert robot.core.deadline == 12.0
    commands = robot.handle(events.Tick(12.0))
    assert not has(commands, events.ShowIncident) and not has(commands, events.Log)
    assert robot.core.deadline == 16.0


def test_a_kept_node_that_is_well_again_ends_the_incident() -> None:
    robot = Robot(SHARED, WITH_D)
    robot.fail("/a", A, 10.0, "out_of_range")
    assert last_incident(robot.back(11.0)).state is State.RETURNING
    assert last_incident(robot.handle(events.Tick(13.1))).state is State.ENDED


def test_a_kept_node_that_dies_is_healed() -> None:
    robot = Robot(SHARED, WITH_D)
    for kind, since in (
        (Kind.OUT_OF_RANGE, 10.00004),
        (Kind.NODE_GONE, 10.0),
    ):  # one moment, by two clocks
        robot.row("/a", A, "failed", since)
        robot.rows["/a", A] = replace(robot.rows["/a", A], kind=kind)
        commands = robot.table(since + 1.0)  # at last that its connection was lost
    assert has(commands, events.StartSubstitute) and publishing(robot) == (True,)


def test_a_silent_node_that_is_kept_is_bridged_until_it_speaks() -> None:
    robot = Robot(SHARED, WITH_D)
    commands = robot.fail("/a", A, 10.0, "silent")
    assert not has(commands, events.FindNode) and publishing(robot) == (True,)
    start = only(commands, events.StartSubstitute)
    incident = last_incident(robot.heard(start.node, 10.5))
    assert incident.state is State.HEALED and incident.kept
    assert last_incident(robot.back(11.0)).state is State.RETURNING
    assert publishing(robot) == (False,)


def test_a_bridged_node_that_wakes_with_nonsense_is_not_talked_over() -> None:
    robot = Robot(SHARED, WITH_D)
    start = only(robot.fail("/a", A, 10.0, "silent"), events.StartSubstitute)
    robot.heard(start.node, 10.5)
    commands = robot.fail("/a", A, 11.0, "out_of_range")
    assert only(commands, events.StopNode).node == start.node
    assert last_incident(commands).state is State.KEPT


def test_a_silent_needed_topic_counts_as_it_may_wake() -> None:
    robot = Robot(SHARED, WITH_D)
    robot.fail("/d", A, 10.0, "silent")
    robot.row("/d", A, "failed", 10.0)
    robot.rows["/d", A] = replace(robot.rows["/d", A], kind=Kind.SILENT)
    robot.table(10.0)
    assert not has(robot.fail("/a", A, 10.2, "silent"), events.FindNode)
    assert publishing(robot) == (True,)  # beside it


def test_a_silent_node_that_nothing_can_replace_is_not_killed() -> None:
    robot = Robot(Som([service("a", A, needed=True)]))
    incident = last_incident(robot.fail("/a", A, 10.0, "silent"))
    assert incident.state is State.UNHEALED and incident.kept
    robot.handle(events.Tick(12.0))
    assert not has(robot.said, events.FindNode)
    assert last_incident(robot.back(15.0)).state is State.RETURNING


@pytest.mark.parametrize(
    "resort", [LastResort(command=("stop",)), LastResort(values=(("a", 0.0),))]
)
def test_a_wrong_node_is_ended_for_the_last_resort_of_its_topic(resort: LastResort) -> None:
    robot = Robot(Som([replace(service("a", A, needed=True), last_resort=resort)]))
    assert only(robot.fail("/a", A, 10.0, "out_of_range"), events.FindNode).node == A


def test_what_a_running_substitute_reads_is_no_cost_where_another_law_will_do() -> None:
    som = Som([service("a", A, needed=True), service("b", B), service("d", B, needed=True)])
    ontology = replace(BOTH, functions=[*ONTOLOGY.functions, function("dc", "d", "c", 0.9)])
    robot = Robot(Som([*som, service("c", C)]), ontology)
    robot.heal(10.0)
    assert only(robot.fail("/d", B, 20.0, "out_of_range"), events.FindNode).node == B


def test_what_a_running_substitute_reads_is_a_cost() -> None:
    som = Som([service("a", A, needed=True), service("b", B), service("d", B, needed=True)])
    ontology = replace(BOTH, functions=[ONTOLOGY.functions[0], function("d_by_c", "d", "c", 0.9)])
    robot = Robot(Som([*som, service("c", C)]), ontology)
    node = robot.heal(10.0)
    assert reads(robot, node) == ("/b/data",)
    incident = last_incident(robot.fail("/d", B, 20.0, "out_of_range"))
    assert incident.state is State.KEPT and "would cost /a" in incident.decision
    assert publishing(robot) == (True,)


def test_what_is_promised_to_a_node_that_is_being_killed_is_a_cost() -> None:
    som = [service("a", A, needed=True), service("d", A, needed=True), service("c", C)]
    some = [service("b", B), service("e", B, needed=True)]
    functions = [
        *(function("ac", "a", "c", 0.9), function("db", "d", "b", 0.9)),
        function("ec", "e", "c", 0.9),
    ]
    ontology = Ontology({name: Property(name) for name in "abcde"}, {}, functions)
    robot = Robot(Som([*som, *some]), ontology)
    assert has(robot.fail("/a", A, 10.0, "out_of_range"), events.FindNode)
    incident = last_incident(robot.fail("/e", B, 10.01, "out_of_range"))
    assert incident.state is State.KEPT and "would cost /d" in incident.decision


def test_a_plan_uses_nothing_of_a_node_that_is_being_killed() -> None:
    som = Som([service("a", A, needed=True), service("b", B), service("d", B, needed=True)])
    functions = [*ONTOLOGY.functions, function("d_by_c", "d", "c", 0.9)]
    robot = Robot(Som([*som, service("c", C)]), replace(WITH_D, functions=functions))
    robot.fail("/d", B, 10.0, "out_of_range")
    start = only(robot.fail("/a", A, 10.01, "out_of_range"), events.StartSubstitute)
    assert start.program is not None and start.program.inputs == ("/c/data",)


@pytest.mark.parametrize("kind", ["out_of_range", "silent"])
def test_a_protected_node_is_killed_only_by_name(kind: str) -> None:
    som = Som([service("a", A, needed=True), service("b", B)])
    robot = Robot(som)
    robot.handle(events.NodeLearned(2.0, A, True, "its process is a nodelet manager"))
    incident = last_incident(robot.fail("/a", A, 10.0, kind))
    assert incident.kept and incident.decision == f"{A} is kept: its process is a nodelet manager"
    assert not has(robot.said, events.FindNode)
    named = Robot(changed(som, "a", contain=Contain.NODE))
    named.handle(events.NodeLearned(2.0, A, True, "its process is a nodelet manager"))
    named.fail("/a", A, 10.0, kind)
    named.row("/a", named.working()[0].node, "healthy", 10.5, first=10.5)
    named.table(10.5)
    assert only(named.said, events.FindNode).node == A


DUTIES = ("takes /cmd_vel", "broadcasts tf")


@pytest.mark.parametrize("kind", ["out_of_range", "silent", "requested"])
def test_a_node_with_duties_is_killed_only_by_name_or_to_be_started_again(kind: str) -> None:
    robot = Robot(SHARED, BOTH)
    robot.handle(events.GraphSeen(2.0, (), ((A, DUTIES),)))
    commands = robot.fail("/a", A, 10.0, kind)
    costs = "it takes /cmd_vel and broadcasts tf, which nothing takes over"
    spared = "it may speak again, and ending it would gain nothing"
    why = f"{A} is kept: {spared if kind == 'silent' else costs}"
    assert last_incident(commands).decision == why
    assert publishing(robot) == ((True,) if kind == "silent" else ())
    robot.handle(events.Tick(30.0))
    assert not has(robot.said, events.FindNode)
    allowing: List[Dict[str, Any]] = [{"contain": Contain.NODE}, {"policy": Policy.RESTART}]
    for allows in allowing:
        other = Robot(changed(SHARED, "a", **allows), BOTH)
        other.handle(events.GraphSeen(2.0, (), ((A, DUTIES),)))
        other.fail("/a", A, 10.0, "out_of_range")
        assert only(other.said, events.FindNode).node == A


def test_the_duties_that_a_former_reconfigurator_knew_count_before_the_master_tells() -> None:
    robot = Robot(SHARED, BOTH)
    robot.handle(events.Started(2.0, duties=((A, DUTIES),)))
    assert not has(robot.fail("/a", A, 10.0, "out_of_range"), events.FindNode)


@pytest.mark.parametrize("kind", ["stale_stamp", "future_stamp"])
def test_stamps_end_no_node_on_another_computer_whose_clock_may_have_been_set(kind: str) -> None:
    far = Som([replace(service("a", A, needed=True), host="pi"), *list(SOM)[1:]], [Host("pi")])
    for som, killed in ((far, False), (SOM, True)):
        robot = Robot(som)
        robot.handle(events.HostSeen(2.0, "pi", 0.1, 4.0))
        assert has(robot.fail("/a", A, 10.0, kind), events.FindNode) is killed
        decision = last_incident(robot.said).decision
        assert killed or decision == f"{A} is kept: the clock of its computer may have been set"


def test_who_is_ended_by_the_word_of_the_som_is_ended_though_it_is_protected() -> None:
    named = Robot(changed(SHARED, "a", contain=Contain.NODE), BOTH)
    assert not only(named.fail("/a", A, 10.0, "out_of_range"), events.FindNode).spares
    robot = Robot()
    assert only(robot.fail("/a", A, 10.0, "out_of_range"), events.FindNode).spares


def test_a_node_is_judged_again_when_its_duties_are_others() -> None:
    robot = Robot(SHARED, BOTH)
    robot.handle(events.GraphSeen(2.0, (), ((A, DUTIES),)))
    assert not has(robot.fail("/a", A, 10.0, "out_of_range"), events.FindNode)
    assert only(robot.handle(events.GraphSeen(11.0, (), ((A, ()),))), events.FindNode).node == A


def test_the_duties_of_a_dead_node_hinder_nothing() -> None:
    robot = Robot(SHARED, BOTH)
    robot.handle(events.GraphSeen(2.0, (), ((A, DUTIES),)))
    assert publishing(robot) == () and has(robot.fail("/a", A, 10.0), events.FindNode)
    assert publishing(robot) == (True,)
    incident = last_incident(robot.handle(events.NodeFound(10.1, A, events.Where.DEAD)))
    assert incident.killed is not None and not incident.kept


def test_a_protected_node_that_keeps_failing_is_let_back() -> None:
    robot = Robot(Som([service("a", A, needed=True), service("b", B)]), switches=1)
    robot.heal(10.0)
    robot.back(20.0)
    robot.handle(events.NodeLearned(20.1, A, True, "it is required"))
    robot.fail("/a", A, 20.5, "silent")
    assert last_incident(robot.said).state is State.HEALED
    assert last_incident(robot.back(21.0)).state is State.RETURNING
    assert len([each for each in robot.said if isinstance(each, events.FindNode)]) == 1


def test_a_node_is_protected_as_its_last_life_was_until_it_is_learned_anew() -> None:
    robot = Robot()
    robot.handle(events.NodeLearned(2.0, A, True, "it is required"))
    robot.fail("/a", A, 10.0)
    robot.handle(events.NodeFound(10.1, A, events.Where.DEAD))
    assert robot.core.robot.health.protected == {A: "it is required"}
    robot.handle(events.NodeLearned(11.0, A, True, ""))
    robot.handle(events.NodeLearned(12.0, B, True, "it is required"))
    robot.handle(events.NodeLearned(13.0, B, True, ""))
    assert not robot.core.robot.health.protected


def test_a_service_that_contains_nothing_lets_its_node_live() -> None:
    robot = Robot(changed(SHARED, "a", contain=Contain.NONE), BOTH)
    incident = last_incident(robot.fail("/a", A, 10.0, "out_of_range"))
    assert incident.state is State.KEPT and not has(robot.said, events.FindNode)
    assert "the SOM says so of /a" in incident.decision


def test_a_node_whose_policy_is_restart_is_killed_and_started_again() -> None:
    robot = Robot(changed(SHARED, "a", policy=Policy.RESTART), WITH_D, restart_pause=1.0)
    assert has(robot.fail("/a", A, 10.0, "out_of_range"), events.FindNode)
    robot.killed(10.1, A)
    assert only(robot.handle(events.Tick(11.2)), events.RestartNode).node == A


def test_a_restart_that_is_used_up_is_no_reason_to_kill() -> None:
    som = changed(SHARED, "a", policy=Policy.RESTART)
    robot = Robot(som, WITH_D, node_restarts=0)
    incident = last_incident(robot.fail("/a", A, 10.0, "out_of_range"))
    assert incident.state is State.KEPT and not has(robot.said, events.FindNode)


def test_a_node_that_dies_while_it_returns_fails_on_each_of_its_topics() -> None:
    robot = Robot(SHARED, BOTH)
    for name in "ad":
        robot.fail(f"/{name}", A, 10.0)
    robot.killed(10.1, A)
    for name in "ad":
        robot.row(f"/{name}", A, "healthy", 20.0)
    robot.table(20.0)
    for name in "ad":
        robot.fail(f"/{name}", A, 20.5)
    assert publishing(robot) == (True, True)


def test_what_somebody_asks_for_is_refused_if_it_would_cost_too_much() -> None:
    robot = Robot(SHARED, WITH_D)
    commands = robot.handle(events.SubstituteRequested(10.0, "a"))
    incident = last_incident(commands)
    assert incident.state is State.ENDED and "would cost /d" in incident.detail
    assert not has(commands, events.FindNode)
    assert robot.core.robot.availability.states.rows["a"].available


def test_a_lost_connection_ends_no_node_that_still_runs_and_does_well() -> None:
    robot = Robot(SHARED, WITH_D)
    commands = robot.fail("/a", A, 10.0)
    assert only(commands, events.FindNode) == events.FindNode(A, False, "/a")
    assert publishing(robot) == (True,)
    commands = robot.handle(events.NodeFound(10.01, A, events.Where.HERE))
    assert not has(commands, events.AskToLeave) and last_incident(commands).kept
    (row,) = robot.working()
    robot.heard(row.node, 10.5)
    robot.row("/d", A, "failed", 11.0)
    robot.rows["/d", A] = replace(robot.rows["/d", A], kind=Kind.NODE_GONE)
    assert only(robot.table(11.0), events.FindNode).node == A


def test_the_command_of_a_last_resort_runs_once_beside_a_kept_node() -> None:
    som = changed(SHARED, "a", last_resort=LastResort(command=("stop",)))
    robot = Robot(som, WITH_D)
    assert has(robot.fail("/a", A, 10.0, "out_of_range"), events.RunCommand)
    assert not has(robot.handle(events.Tick(12.0)), events.RunCommand)


def test_a_node_beside_another_original_is_kept_if_it_gives_more() -> None:
    robot = Robot(SHARED, WITH_D)
    robot.row("/a", "/other", "healthy", 2.0)
    robot.table(2.0)
    commands = robot.fail("/a", A, 10.0, "out_of_range")
    assert not has(commands, events.FindNode) and not has(commands, events.ShowIncident)
    assert f"{A} is kept" in str(commands) and "/other carries on" in str(commands)


def test_an_incident_that_ends_as_soon_as_it_began_has_a_number_of_its_own() -> None:
    robot = Robot(SHARED, WITH_D)
    asked = last_incident(robot.fail("/d", A, 10.0, "requested"))
    assert asked.state is State.ENDED
    assert last_incident(robot.fail("/a", A, 11.0)).id == asked.id + 1
