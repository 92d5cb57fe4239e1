"""The reconfigurator's decisions: events in, commands out."""
from dataclasses import replace

import pytest

from core_robot import (
    A,
    B,
    C,
    ONTOLOGY,
    SOM,
    Robot,
    function,
    has,
    last_incident,
    only,
    program_of,
    service,
    publishing,
)
from shsa_core.errors import ModelError
from shsa_core.healing import events
from shsa_core.healing.incident import State
from shsa_core.healing.machine import Reconfigurator
from shsa_core.model.health import PublisherHealth, PublisherState
from shsa_core.model.kinds import Contain, Kind, Policy
from shsa_core.model.log import Level
from shsa_core.model.ontology import Ontology, Property
from shsa_core.model.service import Provision, Service
from shsa_core.model.som import Som
from shsa_core.planning import planner
from shsa_core.planning.settings import CERTAIN_S


def test_a_failure_kills_the_node_and_starts_the_best_substitute() -> None:
    robot = Robot()
    commands = robot.fail("/a", A, 10.0)
    assert only(commands, events.FindNode) == events.FindNode(A, False, "/a")
    start = only(commands, events.StartSubstitute)
    assert program_of([start]).inputs == ("/b/data",)
    assert program_of([start]).outputs == ("/a/data",)
    incident = last_incident(commands)
    assert incident.state is State.HEALING
    assert (incident.topic, incident.faulty_node, incident.last_good) == ("/a", A, 9.98)
    assert incident.relations == ("good",) and incident.quality == 0.9
    assert publishing(robot) == (True,), "the node is certainly gone"


def test_a_substitute_is_muted_until_the_faulty_node_is_gone() -> None:
    robot = Robot()
    robot.fail("/a", A, 10.0, "out_of_range")
    assert publishing(robot) == (False,)
    commands = robot.killed(10.05, A)
    assert publishing(robot) == (True,)
    assert only(commands, events.ShowSubstitutions).rows[0].original == A
    assert last_incident(commands).killed == 10.05


def test_a_substitute_publishes_as_soon_as_the_killed_node_has_closed_its_connection() -> None:
    robot = Robot()
    robot.fail("/a", A, 10.0, "out_of_range")
    assert publishing(robot) == (False,)
    commands = robot.fail("/a", A, 10.01, "node_gone")
    assert publishing(robot) == (True,)
    assert not has(commands, events.Log) and not has(commands, events.FindNode)


def test_the_incident_records_every_step() -> None:
    robot = Robot()
    node = robot.heal(10.0)
    incident = last_incident(robot.said)
    assert incident.state is State.HEALED and incident.substitute == node
    steps = (incident.last_good, incident.detected, incident.found, incident.killed)
    assert steps == (9.98, 10.0, 10.0, 10.0)
    assert (incident.spawned, incident.first_message) == (10.02, 10.5)
    assert incident.outage is not None and abs(incident.outage - 0.52) < 1e-9


def test_the_original_returns_and_the_substitute_stops_after_the_hold_off() -> None:
    robot = Robot()
    node = robot.heal(10.0)
    robot.row("/a", A, "healthy", 20.0)
    commands = robot.table(20.01)
    assert last_incident(commands).state is State.RETURNING
    assert publishing(robot) == (False,)
    assert robot.core.deadline == 22.01
    assert not has(robot.handle(events.Tick(22.0)), events.StopNode)
    commands = robot.handle(events.Tick(22.02))
    assert only(commands, events.StopNode).node == node
    assert last_incident(commands).state is State.ENDED
    assert publishing(robot) == ()
    assert robot.core._processes.nodes == ()


def test_an_original_that_fails_again_in_the_hold_off_gives_the_topic_back() -> None:
    robot = Robot()
    node = robot.heal(10.0)
    robot.row("/a", A, "healthy", 20.0)
    robot.table(20.01)
    commands = robot.fail("/a", A, 21.0, "out_of_range")
    assert only(commands, events.FindNode).node == A
    assert publishing(robot) == (False,)
    robot.killed(21.01, A)
    assert publishing(robot) == (True,)
    assert robot.core._processes.nodes == (node,)
    assert last_incident(robot.said).state is State.HEALED
    assert not has(robot.handle(events.Tick(30.0)), events.StopNode)


def test_an_old_table_is_not_taken_for_a_return() -> None:
    robot = Robot()
    robot.fail("/a", A, 10.0)
    robot.killed(10.01, A)
    robot.row("/a", A, "healthy", 0.0)
    robot.table(10.02)
    assert last_incident(robot.said).state is State.HEALING


def test_a_substitute_that_fails_is_replaced_by_the_next_best() -> None:
    robot = Robot()
    node = robot.heal(10.0)
    commands = robot.failure("/a", node, 15.0, "out_of_range", "it is too high.", 14.9)
    assert only(commands, events.StopNode).node == node
    assert program_of(commands).inputs == ("/c/data",)
    assert not has(commands, events.FindNode)


def test_a_substitute_whose_process_dies_is_started_again_under_another_name() -> None:
    robot = Robot()
    node = robot.heal(10.0)
    start = only(
        robot.handle(events.ProcessExited(15.0, node, "status -9")), events.StartSubstitute
    )
    assert program_of([start]).inputs == ("/b/data",)
    assert start.node != node


def test_a_substitute_that_keeps_dying_makes_room_for_the_next_best() -> None:
    robot = Robot()
    node = robot.heal(10.0)
    for deaths, read in enumerate(["/b/data"] * 2 + ["/c/data"] * 3):
        died = events.ProcessExited(15.0 + deaths, node, "status 1")
        start = only(robot.handle(died), events.StartSubstitute)
        node = start.node
        assert program_of([start]).inputs == (read,)


def test_without_a_substitute_it_says_what_is_missing_and_tries_when_one_appears() -> None:
    robot = Robot()
    del robot.rows["/b", B], robot.rows["/c", C]
    robot.table(9.0)
    commands = robot.fail("/a", A, 10.0)
    robot.killed(10.01, A)
    incident = last_incident(commands)
    assert incident.state is State.UNHEALED and incident.missing == ("b", "c")
    robot.row("/c", C, "healthy", 12.0)
    commands = robot.table(12.0)
    assert program_of(commands).inputs == ("/c/data",)
    assert last_incident(commands).state is State.HEALING


def test_an_unhealed_topic_is_tried_again_with_growing_pauses() -> None:
    robot = Robot()
    robot.rows.clear()
    robot.table(9.0)
    robot.fail("/a", A, 10.0)
    robot.killed(10.0, A)
    assert robot.core.deadline == 12.0
    robot.table(11.0)
    assert robot.core.deadline == 12.0
    robot.handle(events.Tick(12.0))
    assert robot.core.deadline == 16.0


def test_an_unhealed_topic_whose_original_returns_ends() -> None:
    robot = Robot()
    robot.rows.clear()
    robot.table(9.0)
    robot.fail("/a", A, 10.0)
    robot.killed(10.01, A)
    assert last_incident(robot.back(11.0)).state is State.RETURNING
    assert last_incident(robot.handle(events.Tick(13.0))).state is State.ENDED


def test_another_healthy_publisher_of_the_topic_is_not_replaced() -> None:
    robot = Robot()
    robot.row("/a", "/spare", "healthy", 2.0)
    robot.table(3.0)
    commands = robot.fail("/a", A, 10.0, "out_of_range")
    assert only(commands, events.FindNode).node == A
    assert not has(commands, events.StartSubstitute)


def test_what_the_failed_node_also_provides_is_not_used() -> None:
    som = Som([service("a", A, needed=True), service("b", A), service("c", C)])
    robot = Robot(som)
    commands = robot.fail("/a", A, 10.0)
    assert program_of(commands).inputs == ("/c/data",)


BY_C = Ontology(
    properties={name: Property(name) for name in "abc"},
    constants={},
    functions=[function("ac", "a", "c", 0.9), function("bc", "b", "-c", 0.9)],
)


@pytest.mark.parametrize("kind", ["node_gone", "out_of_range"])
def test_two_topics_of_one_node_are_killed_once_and_healed_both(kind: str) -> None:
    som = Som([service("a", A, True), service("b", A, True), service("c", C)])
    robot = Robot(som, BY_C)
    robot.fail("/a", A, 10.0, kind)
    robot.fail("/b", A, 10.001, kind)
    assert len([c for c in robot.said if isinstance(c, events.FindNode)]) == 1
    assert len([c for c in robot.said if isinstance(c, events.StartSubstitute)]) == 2
    robot.killed(10.05, A)
    assert publishing(robot) == (True, True)


def test_one_substitute_fills_every_field_of_the_topic() -> None:
    both = (Provision("a", "data"), Provision("b", "other"))
    two = Service("ab", "/ab", "pkg/Type", A, 0.02, both, needed=True)
    robot = Robot(Som([two, service("c", C)]), BY_C)
    start = only(robot.fail("/ab", A, 10.0), events.StartSubstitute)
    assert program_of([start]).outputs == ("/ab/data", "/ab/other")


def test_a_row_that_turns_failed_is_the_failure() -> None:
    robot = Robot()
    robot.row("/a", A, "failed", 10.0)
    assert has(robot.table(10.01), events.StartSubstitute)
    assert not has(robot.table(10.7), events.StartSubstitute)


def gone(since: float, last_message: bytes = b"") -> PublisherHealth:
    """The row of A that has died."""
    whose = "/a", A, PublisherState.FAILED, since, 1.0, since - 0.02
    return PublisherHealth(*whose, Kind.NODE_GONE, "it died.", last_message=last_message)


def test_a_row_may_bring_the_last_message_after_the_failure() -> None:
    robot = Robot()
    commands = robot.handle(events.HealthSeen(10.0, (gone(10.0),)))
    start = only(commands, events.StartSubstitute)
    commands = robot.handle(events.HealthSeen(10.1, (gone(10.0, b"last"),)))
    assert robot.shown[start.node].last_message == b"last"
    assert not has(commands, events.ShowIncident) and not has(commands, events.Log)


@pytest.mark.parametrize("since", [9.0, 10.0, 10.3])
def test_a_failure_that_is_told_besides_or_by_a_clock_that_is_ahead_is_the_same(
    since: float,
) -> None:
    robot = Robot()
    robot.handle(events.HealthSeen(10.0, (gone(10.0),)))
    assert robot.handle(events.HealthSeen(10.4, (gone(since),))) == []
    assert robot.failure("/a", A, since, "node_gone", "it died.", 9.9) == []


def test_who_is_accused_once_more_is_judged_once_more() -> None:
    robot = Robot()
    robot.failure("/a", C, 10.0, "out_of_range", "99 is out of range.", 9.9)
    robot.killed(10.1, C, certain=False)
    again = robot.failure("/a", C, 11.0, "out_of_range", "99 is out of range.", 9.9)
    assert has(again, events.FindNode)


def test_what_is_told_of_a_process_that_was_there_before_is_not_held_against_the_next() -> None:
    robot = Robot()
    robot.row("/a", A, "healthy", 9.0)
    robot.table(9.1)
    assert robot.failure("/a", A, 8.9, "out_of_range", "99 is out of range.", 8.0) == []


def test_a_topic_that_never_came_up_is_healed() -> None:
    robot = Robot()
    del robot.rows["/a", A]
    robot.table(2.0)
    commands = robot.failure("/a", "", 10.0, "never_published", "nothing came.", None)
    start = only(commands, events.StartSubstitute)
    robot.row("/a", start.node, "healthy", 10.5, first=10.5)
    assert last_incident(robot.table(10.51)).state is State.HEALED
    assert not has(robot.said, events.FindNode)


CONTAINED = SOM.with_services(replace(each, contain=Contain.NODE) for each in SOM)


def test_a_silent_node_is_spared_and_filled_in_for_until_it_speaks() -> None:
    robot = Robot()
    for time in (10.0, 16.0, 22.0, 28.0, 34.0):  # each time within its hold-off, but the first
        robot.fail("/a", A, time, "silent")
        (row,) = robot.working()
        assert row.publishing
        robot.row("/a", row.node, "healthy", time + 0.3, first=time + 0.3)
        robot.table(time + 0.31)
        robot.handle(events.Tick(time + 5.0))
        incident = robot.core.incident("a")
        assert incident is not None and incident.state is State.HEALED
        assert incident.kept and not incident.kept_out
        assert last_incident(robot.back(time + 5.0)).state is State.RETURNING
        assert publishing(robot) == (False,)
    assert not has(robot.said, events.FindNode)


@pytest.mark.parametrize("policy", [Policy.RESTART, Policy.RESTART_AND_SUBSTITUTE])
def test_a_silent_node_that_is_to_be_started_again_has_time_to_speak(policy: Policy) -> None:
    robot = Robot(SOM.with_services(replace(each, policy=policy) for each in SOM))
    robot.fail("/a", A, 10.0, "silent")
    assert publishing(robot) == ((True,) if policy.substitutes else ())
    assert last_incident(robot.back(9.9 + CERTAIN_S)).state is State.RETURNING
    robot.handle(events.Tick(10.0 + CERTAIN_S))
    robot.handle(events.Tick(20.0))
    assert not has(robot.said, events.FindNode) and robot.core.incident("a") is None
    robot.fail("/a", A, 100.0, "silent")
    assert not has(robot.handle(events.Tick(99.9 + CERTAIN_S)), events.FindNode)
    assert only(robot.handle(events.Tick(100.0 + CERTAIN_S)), events.FindNode).node == A


def test_a_silent_node_is_killed_once_its_substitute_publishes_where_the_som_says_so() -> None:
    robot = Robot(CONTAINED)
    commands = robot.fail("/a", A, 10.0, "silent")
    node = only(commands, events.StartSubstitute).node
    assert not has(commands, events.FindNode) and publishing(robot) == (True,)
    robot.row("/a", node, "healthy", 10.3, first=10.3)
    commands = robot.table(10.31)
    assert only(commands, events.FindNode).node == A
    assert last_incident(commands).state is State.HEALED
    assert last_incident(robot.killed(10.35, A)).killed == 10.35
    robot.back(20.0)
    assert publishing(robot) == (False,)
    commands = robot.fail("/a", A, 20.5, "silent")  # within its hold-off
    assert not has(commands, events.FindNode) and publishing(robot) == (True,)
    robot.row("/a", node, "healthy", 20.6, first=10.3)
    assert only(robot.table(20.6), events.FindNode).node == A


def test_a_silent_node_on_another_computer_is_left_alone_and_nobody_waits_for_it() -> None:
    robot = Robot(CONTAINED)
    node = only(robot.fail("/a", A, 10.0, "silent"), events.StartSubstitute).node
    robot.row("/a", node, "healthy", 10.5, first=10.5)
    assert only(robot.table(10.51), events.FindNode).node == A
    commands = robot.handle(events.NodeFound(10.52, A, events.Where.ELSEWHERE))
    assert not has(commands, events.AskToLeave) and publishing(robot) == (True,)
    assert "no agent says" in last_incident(commands).detail
    robot.row("/a", A, "healthy", 12.0)  # the link is up again
    assert last_incident(robot.table(12.0)).state is State.RETURNING


def test_a_wrong_node_on_another_computer_is_asked_to_leave() -> None:
    robot = Robot()
    robot.fail("/a", A, 10.0, "out_of_range")
    commands = robot.handle(events.NodeFound(10.1, A, events.Where.ELSEWHERE))
    assert only(commands, events.AskToLeave).node == A


def test_a_silent_node_that_wakes_before_its_substitute_publishes_is_never_killed() -> None:
    robot = Robot()
    robot.fail("/a", A, 10.0, "silent")
    robot.row("/b", B, "failed", 10.1)  # everybody is silent: the machine stalls
    robot.row("/c", C, "failed", 10.1)
    robot.table(10.1)
    robot.handle(events.Tick(16.0))
    for topic, node in (("/b", B), ("/c", C), ("/a", A)):
        robot.row(topic, node, "healthy", 17.0)
    robot.table(17.0)
    assert last_incident(robot.handle(events.Tick(19.1))).state is State.ENDED
    assert not has(robot.said, events.FindNode) and not has(robot.said, events.AskToLeave)


def test_the_running_som_follows_health() -> None:
    robot = Robot()
    shown = only(robot.said, events.ShowSom)
    assert [(row.service.name, row.available) for row in shown.rows] == [(n, True) for n in "abc"]
    robot.row("/b", B, "failed", 5.0)
    (row,) = only(robot.table(5.0), events.ShowSom).rows
    assert (row.service.name, row.available, row.detail) == ("b", False, "not published")
    robot.row("/b", "/b_again", "healthy", 6.0)
    (row,) = only(robot.table(6.0), events.ShowSom).rows
    assert (row.service.name, row.available, row.node) == ("b", True, "/b_again")


def test_a_request_substitutes_a_healthy_topic() -> None:
    robot = Robot()
    commands = robot.handle(events.SubstituteRequested(10.0, "a"))
    assert only(commands, events.FindNode).node == A
    assert last_incident(commands).kind == "requested"


def test_an_explanation_acts_on_nothing() -> None:
    robot = Robot()
    plan = robot.core.explain("a")
    assert plan.program.inputs == ("/b/data",)
    assert robot.core.explain("a", without=[B]).program.inputs == ("/c/data",)
    assert not has(robot.said, events.FindNode)


def test_relative_names_are_asked_for_in_the_namespace() -> None:
    som = Som(
        replace(each, topic=f"/robot1/{each.name}_topic", node="/robot1" + each.node)
        for each in SOM
    )
    core = Reconfigurator(ONTOLOGY, som, namespace="/robot1/")
    rows = [PublisherHealth(s.topic, s.node, PublisherState.HEALTHY, 0.0) for s in som]
    core.handle(events.HealthSeen(1.0, tuple(rows), whole=True))
    for name in ("a", "/robot1/a_topic", "a_topic"):
        assert core.find(name).name == "a"
    assert core.explain("a_topic").relations == ("good",)
    for left_out in ("b", "/robot1/b_node", "b_node", "b_topic"):
        assert core.explain("a", without=[left_out]).relations == ("poor",)
    with pytest.raises(ModelError, match="no such service or topic"):
        core.find("/a_topic")


def test_an_uncertain_kill_is_said_and_the_substitute_publishes() -> None:
    robot = Robot()
    robot.fail("/a", A, 10.0, "out_of_range")
    commands = robot.killed(11.0, A, certain=False)
    assert any(isinstance(c, events.Log) and c.level is Level.ERROR for c in commands)
    assert publishing(robot) == (True,)


def test_the_same_topic_heals_any_number_of_times() -> None:
    robot = Robot()
    names = set()
    for round_ in range(20):
        start = 10.0 + 12.0 * round_
        names.add(robot.heal(start))
        robot.back(start + 1.0)
        robot.rows = {key: row for key, row in robot.rows.items() if key[1] not in names}
        incident = last_incident(robot.handle(events.Tick(start + 4.0)))
        assert (incident.state, incident.id) == (State.ENDED, round_ + 1)
        assert not robot.core._processes.nodes
    assert len(names) == 20


def test_a_search_during_a_failure_has_a_deadline(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(planner, "STEPS", 0)
    functions = [function("poor", "a", "2 * c", 0.5), function("z", "a", "d + 1", 0.9)]
    functions.append(function("far", "d", "b + 1", 1.0))
    robot = Robot(ontology=Ontology({name: Property(name) for name in "abcd"}, {}, functions))
    robot.core.robot.planner.plans.forget("a")  # none was made ahead
    assert program_of(robot.fail("/a", A, 10.0)).inputs == ("/c/data",)
    best = robot.core.explain("a")
    assert best.relations == ("z", "far") and best.proven_best
