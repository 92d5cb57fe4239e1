"""A reconfigurator that is killed, and the next one that takes up what it has left."""
from dataclasses import replace
from math import inf
from typing import Any, Dict, List, Tuple

import pytest

from core_robot import (
    A,
    B,
    ONTOLOGY,
    SOM,
    Robot,
    assigned,
    has,
    last_incident,
    only,
    publishing,
    service,
)
from shsa_core.healing import events
from shsa_core.healing.incident import State
from shsa_core.healing.machine import Reconfigurator
from shsa_core.healing.records import Counters, Healthy, Record, of_this_robot
from shsa_core.healing.settings import ANSWER_S
from shsa_core.model.health import PublisherHealth, PublisherState
from shsa_core.model.kinds import Kind, Policy, Standby
from shsa_core.model.ontology import Ontology
from shsa_core.model.som import Som

Subscribers = Tuple[Tuple[str, Tuple[str, ...]], ...]


def succeed(
    robot: Robot,
    time: float,
    running: Tuple[str, ...] = (),
    subscribers: Subscribers = (),
    **changes: Any,
) -> List[events.Command]:
    """The reconfigurator is killed, and the next one starts; `changes`: its models."""
    core = robot.core
    models: Dict[str, Any] = {"ontology": ONTOLOGY, "som": core.robot.som, **changes}
    records, robot.written = tuple(robot.written.values()), {}
    robot.core, robot.shown = Reconfigurator(settings=core.robot.settings, **models), {}
    started = events.Started(time, (), (), records, running, subscribers=subscribers)
    return robot.handle(started)


def test_what_publishes_goes_on_and_keeps_its_incident() -> None:
    robot = Robot()
    node = robot.heal(10.0)
    row = robot.shown[node]
    commands = succeed(robot, 20.0, (node,))
    assert robot.shown[node] == row and row.publishing
    assert not has(commands, events.StopNode) and not has(commands, events.StartSubstitute)
    assert not has(commands, events.FindNode)
    incident = last_incident(commands)
    assert (incident.id, incident.state, incident.substitute) == (1, State.HEALED, node)


def test_its_incident_ends_in_the_record_once_its_node_is_back() -> None:
    robot = Robot()
    node = robot.heal(10.0)
    succeed(robot, 20.0, (node,))
    robot.back(25.0)
    commands = robot.handle(events.Tick(28.0))
    assert (last_incident(commands).id, last_incident(commands).state) == (1, State.ENDED)
    assert only(commands, events.StopNode).node == node


def test_incidents_and_substitutes_are_numbered_on() -> None:
    robot = Robot()
    node = robot.heal(10.0)
    robot.back(12.0)
    robot.handle(events.Tick(15.0))
    del robot.rows["/a", node]  # its record that it does well is there yet
    succeed(robot, 20.0)
    robot.table(20.1)
    commands = robot.fail("/a", A, 30.0)
    assert last_incident(commands).id == 2
    assert only(commands, events.StartSubstitute).node == "/substitute_a_2" != node


def test_who_has_died_meanwhile_is_replaced_once_the_monitors_had_a_moment() -> None:
    robot = Robot()
    node = robot.heal(10.0)
    assert not has(succeed(robot, 20.0) + robot.idle(20.1), events.StartSubstitute)
    commands = robot.handle(events.Tick(20.0 + ANSWER_S))
    start = only(commands, events.StartSubstitute)
    assert start.node != node and publishing(robot) == (True,)
    assert last_incident(commands).id == 1


def test_idle_processes_stay_ready() -> None:
    som = Som([service("a", A, needed=True, standby=Standby.WARM), *list(SOM)[1:]])
    robot = Robot(som)
    (idle,) = robot.idle_rows()
    commands = succeed(robot, 20.0, (idle.node,))
    assert not has(commands, events.StartSubstitute) and not has(commands, events.StopNode)
    robot.table(20.1)
    robot.idle(20.2)
    assert assigned(robot.fail("/a", A, 30.0)) == idle.node


def test_an_idle_process_that_has_taken_over_by_itself_is_adopted() -> None:
    som = Som([service("a", A, needed=True, standby=Standby.WARM), *list(SOM)[1:]])
    robot = Robot(som, pool=2)
    robot.handle(events.Tick(5.0))
    first, second = robot.idle_rows()
    assert (first.bridge, second.bridge) == (0.5, 1.0)
    succeed(robot, 20.0, (first.node, second.node))
    assert robot.shown[second.node].idle
    gone = PublisherHealth("/a", A, PublisherState.FAILED, 19.0, 1.0, 18.9, Kind.NODE_GONE)
    robot.rows["/a", A] = gone
    robot.row("/a", second.node, "healthy", 19.6, first=19.6)
    commands = robot.table(20.1)
    assert assigned(commands) == second.node
    assert robot.shown[second.node].publishing and robot.shown[first.node].idle
    incident = last_incident(commands)
    assert (incident.state, incident.first_message) == (State.HEALED, 19.6)
    for kind in (events.StartSubstitute, events.StopNode):
        assert not has(robot.handle(events.Tick(20.5)), kind)


def test_who_did_well_does_so_until_a_monitor_is_there() -> None:
    robot = Robot()
    node = robot.heal(10.0)
    commands = succeed(robot, 20.0, (node,))
    commands += robot.handle(events.Tick(40.0))  # both healers died, and the monitor starts slowly
    assert not has(commands, events.StopNode) and publishing(robot) == (True,)
    del robot.rows["/b", B]
    assert not has(robot.table(40.1), events.ShowSubstitutions)
    commands = robot.handle(events.Tick(45.2))
    assert assigned(commands) == node
    assert [row.topic for row in robot.shown[node].inputs] == ["/c"]


@pytest.mark.parametrize("standby", [Standby.WARM, Standby.HOT])
def test_what_is_needed_by_its_subscribers_keeps_what_stands_by(standby: Standby) -> None:
    som = Som([service("a", A, needed=None, standby=standby), *list(SOM)[1:]])  # type: ignore
    robot = Robot(som)
    heard = (("/a", ("/user",)), ("/b", ()), ("/c", ()))
    robot.handle(events.GraphSeen(1.1, heard))
    robot.idle(1.2)
    nodes = tuple(row.node for row in robot.shown.values() if row.node)
    assert len(nodes) == 1
    commands = succeed(robot, 20.0, nodes, heard, som=som)
    commands += robot.table(20.1) + robot.idle(20.2)
    assert not has(commands, events.StartSubstitute) and not has(commands, events.StopNode)
    robot.handle(events.GraphSeen(20.3, (("/a", ()),)))
    gone = robot.idle(20.4)
    assert not robot.core._processes.nodes, gone


def test_a_process_that_nothing_tells_of_is_ended() -> None:
    robot = Robot()
    commands = succeed(robot, 20.0, ("/substitute_a_7",))
    assert only(commands, events.StopNode).node == "/substitute_a_7"
    robot.table(20.1)
    assert only(robot.fail("/a", A, 30.0), events.StartSubstitute).node == "/substitute_a_8"


def test_a_program_that_does_not_fit_the_models_any_more_is_not_gone_on_with() -> None:
    robot = Robot()
    node = robot.heal(10.0)
    other = Ontology(ONTOLOGY.properties, {}, [ONTOLOGY.functions[1]])
    commands = succeed(robot, 20.0, (node,), ontology=other)
    assert only(commands, events.StopNode).node == node
    start = only(robot.handle(events.Tick(20.0 + ANSWER_S)), events.StartSubstitute)
    assert start.program is not None and start.program.inputs == ("/c/data",)


def test_the_incident_of_a_service_that_left_the_som_is_ended() -> None:
    robot = Robot()
    node = robot.heal(10.0)
    commands = succeed(robot, 20.0, (node,), som=Som(list(SOM)[1:]))
    assert only(commands, events.StopNode).node == node
    assert (last_incident(commands).id, last_incident(commands).state) == (1, State.ENDED)


def test_a_kill_that_was_not_over_waits_for_the_monitors_word() -> None:
    robot = Robot()
    start = only(robot.fail("/a", A, 10.0, "out_of_range"), events.StartSubstitute)
    commands = succeed(robot, 10.5, (start.node,))
    assert not has(commands, events.FindNode) and publishing(robot) == (False,)
    assert not has(robot.idle(10.55), events.FindNode)
    state, kind = PublisherState.FAILED, Kind.OUT_OF_RANGE
    row = PublisherHealth("/a", A, state, 10.0, kind=kind, detail="as told")
    commands = robot.handle(events.HealthSeen(10.6, (row,)))
    assert only(commands, events.FindNode).node == A


def test_a_node_that_came_back_meanwhile_is_not_killed() -> None:
    robot = Robot()
    start = only(robot.fail("/a", A, 10.0, "out_of_range"), events.StartSubstitute)
    succeed(robot, 12.0, (start.node,))
    robot.row("/a", A, "healthy", 11.0)
    commands = robot.table(12.1)
    assert last_incident(commands).state is State.RETURNING
    assert not has(commands, events.FindNode)


def test_it_is_not_killed_though_its_substitute_has_died_too() -> None:
    robot = Robot()
    robot.fail("/a", A, 10.0, "out_of_range")
    commands = succeed(robot, 20.0) + robot.idle(20.1)
    robot.row("/a", A, "healthy", 15.0)
    commands += robot.table(20.2) + robot.handle(events.Tick(20.0 + ANSWER_S))
    assert last_incident(commands).state is State.RETURNING
    assert not has(commands, events.FindNode) and not has(commands, events.StartSubstitute)


def test_who_was_well_counts_until_the_monitor_tells() -> None:
    robot = Robot()
    commands = succeed(robot, 20.0)
    states = {row.service.name: row for row in only(commands, events.ShowSom).rows}
    assert states["a"].available and states["a"].healthy == (A,)
    assert not has(robot.handle(events.Tick(40.0)), events.ShowSom)
    robot.handle(events.HealthSeen(40.1, (), whole=True))
    commands = robot.handle(events.Tick(45.2))
    assert not any(row.available for row in only(commands, events.ShowSom).rows)


def test_a_message_of_who_was_well_is_still_known() -> None:
    robot = Robot()
    well = replace(robot.rows["/a", A], last_message=b"well")
    robot.handle(events.HealthSeen(2.0, (well,)))
    succeed(robot, 20.0)
    robot.fail("/a", A, 30.0)
    assert [row.template for row in robot.working()] == [b"well"]


def test_a_message_of_who_has_failed_is_still_known() -> None:
    robot = Robot()
    robot.row("/a", A, "healthy", 3.0)
    robot.rows["/a", A] = replace(robot.rows["/a", A], last_message=b"well")
    robot.table(3.0)
    node = robot.heal(10.0)
    succeed(robot, 11.0, (node,))
    robot.handle(events.ProcessExited(12.0, node, "exit status 1"))
    assert [row.template for row in robot.working()] == [b"well"]


def test_a_message_of_who_was_not_heard_before_it_failed_is_still_known() -> None:
    robot = Robot()
    robot.row("/a", A, "healthy", 3.0)
    robot.rows["/a", A] = replace(robot.rows["/a", A], last_message=b"well")
    robot.table(3.0)
    unheard = PublisherHealth("/a", A, PublisherState.FAILED, 10.0, kind=Kind.NEVER_PUBLISHED)
    robot.handle(events.HealthSeen(10.0, (unheard,)))
    succeed(robot, 11.0, tuple(row.node for row in robot.working()))
    assert [row.template for row in robot.working()] == [b"well"]


def test_the_last_message_of_what_nothing_could_heal_is_still_known() -> None:
    """Though the monitor has died as well, and knows nothing of it."""
    robot = Robot(Som([service("a", A, needed=True), service("b", B)]), pool=0)
    robot.row("/b", B, "failed", 5.0)
    lost = PublisherHealth("/a", A, PublisherState.FAILED, 10.0, 1.0, 9.9, Kind.NODE_GONE)
    robot.rows["/a", A] = replace(lost, last_message=b"well")
    assert last_incident(robot.table(10.0)).state is State.UNHEALED
    succeed(robot, 20.0)
    robot.rows.clear()
    robot.row("/b", B, "healthy", 21.0)
    robot.table(21.0)
    robot.handle(events.Tick(30.0))
    assert [row.last_message for row in robot.working()] == [b"well"]


def test_a_node_that_was_started_again_is_known_to_the_next() -> None:
    som = Som([replace(SOM.services["a"], policy=Policy.RESTART_AND_SUBSTITUTE), *list(SOM)[1:]])
    robot = Robot(som)
    robot.handle(events.NodeRestarted(11.0, A))
    commands = succeed(robot, 20.0, (A,))
    assert not has(commands, events.StopNode)
    assert robot.handle(events.StarterEnded(21.0, A)) == [events.StopNode(A)]


def test_a_node_that_was_started_again_and_is_gone_is_nobodys() -> None:
    robot = Robot()
    robot.handle(events.NodeRestarted(11.0, A))
    succeed(robot, 20.0)
    assert robot.handle(events.StarterEnded(21.0, A)) == []


def test_a_service_that_waits_to_be_healed_is_tried_again() -> None:
    robot = Robot(Som([SOM.services["a"]]), pool=0)
    robot.fail("/a", A, 10.0)
    assert last_incident(robot.said).state is State.UNHEALED
    succeed(robot, 20.0)
    assert robot.core.deadline < inf
    assert last_incident(robot.said).state is State.UNHEALED


@pytest.mark.parametrize("commands", range(8))
def test_a_death_at_any_command_of_a_takeover_leaves_one_publisher(commands: int) -> None:
    robot = Robot()
    said = robot.fail("/a", A, 10.0)
    started = [each.node for each in said[:commands] if isinstance(each, events.StartSubstitute)]
    succeed(robot, 11.0, tuple(started))
    robot.handle(events.Tick(11.0 + ANSWER_S))
    assert publishing(robot) == (True,)
    (row,) = robot.working()
    assert last_incident(robot.heard(row.node, 12.0)).state is State.HEALED
    assert last_incident(robot.said).id == 1


def test_an_incident_that_ended_is_told_once_more_if_nobody_may_have_heard() -> None:
    robot = Robot()
    node = robot.heal(10.0)
    robot.back(12.0)
    robot.handle(events.Tick(15.0))
    commands = succeed(robot, 15.1, (node,))
    assert last_incident(commands).state is State.ENDED
    assert only(commands, events.StopNode).node == node


def test_an_incident_that_ended_before_the_last_event_is_not_told_again() -> None:
    robot = Robot()
    robot.heal(10.0)
    robot.back(12.0)
    robot.handle(events.Tick(15.0))
    robot.handle(events.Tick(15.1))
    assert not has(succeed(robot, 15.2), events.ShowIncident)


def test_who_did_well_is_missed_once_though_a_new_monitor_tells_more() -> None:
    robot = Robot()
    rows = tuple(robot.rows.values())
    for time, began in ((5.0, 1), (6.0, 2)):
        robot.handle(events.HealthSeen(time, rows, whole=True, began=began))
    robot.handle(events.HealthSeen(7.0, rows[1:], began=2))
    robot.handle(events.Tick(30.0))
    assert robot.core.robot.health.well("/a") == [A]


def test_an_incident_is_told_that_ended_as_another_began_since_the_som_moved_its_topic() -> None:
    robot = Robot()
    robot.fail("/a", A, 10.0, "silent")
    robot.row("/moved", A, "failed", 11.0)
    robot.rows["/moved", A] = replace(robot.rows["/moved", A], kind=Kind.SILENT)
    robot.table(11.0)
    moved = SOM.with_services(replace(e, topic="/moved") if e.name == "a" else e for e in SOM)
    robot.handle(events.SomChanged(12.0, moved))
    commands = succeed(robot, 13.0, tuple(row.node for row in robot.working()))
    told = [each.incident for each in commands if isinstance(each, events.ShowIncident)]
    states = {each.id: each.state for each in told}
    assert states[1] is State.ENDED and states[2] is State.HEALING


def test_a_node_that_is_kept_out_stays_out() -> None:
    robot = Robot(switches=1)
    robot.heal(10.0)
    for time in (12.0, 30.0):
        commands = robot.back(time)
        if time == 12.0:
            robot.fail("/a", A, 13.0)
            robot.killed(13.1, A)
            succeed(robot, 20.0, tuple(row.node for row in robot.working()))
    assert only(commands, events.FindNode).node == A and publishing(robot) == (True,)


def test_after_an_orderly_end_only_the_numbers_stay() -> None:
    robot = Robot()
    robot.heal(10.0)
    robot.handle(events.ShuttingDown(20.0))
    (left,) = robot.written.values()
    assert left == Counters(1, 2)


def test_records_of_another_robot_are_not_taken_up() -> None:
    robot = Robot()
    node = robot.heal(10.0)
    records: Tuple[Record, ...] = tuple(robot.written.values())
    assert of_this_robot(records, False, ()) == (Counters(1, 2),)
    assert of_this_robot(records, False, (node,)) == records
    assert of_this_robot(records, True, ()) == records
    assert Healthy("/b", B, 0.0) in records


def test_who_is_said_to_have_failed_is_not_written_down_as_healthy() -> None:
    robot = Robot()
    assert f"healthy /b {B}" in robot.written
    robot.failure("/b", B, 10.0, "out_of_range", "it is said.", 9.9)
    assert f"healthy /b {B}" not in robot.written


def test_a_hot_substitute_stands_by_on_after_a_death_as_its_incident_ended() -> None:
    robot = Robot(Som([service("a", A, needed=True, standby=Standby.HOT), *list(SOM)[1:]]))
    (node,) = robot.core._processes.nodes
    robot.fail("/a", A, 10.0)
    robot.killed(10.1, A)
    robot.row("/a", node, "healthy", 10.2, first=10.2)
    robot.back(12.0)
    assert last_incident(robot.handle(events.Tick(15.0))).state is State.ENDED
    commands = succeed(robot, 15.1, (node,))
    assert last_incident(commands).state is State.ENDED
    assert not has(commands, events.StopNode) and [row.node for row in robot.working()] == [node]
