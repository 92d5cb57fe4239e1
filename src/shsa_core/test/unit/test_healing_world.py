"""The reconfigurator with nodes, launches, and services that share a topic."""
from dataclasses import replace
from math import inf
from typing import Any, Callable, List

import pytest

from core_robot import (
    A,
    B,
    C,
    SOM,
    Robot,
    function,
    has,
    last_incident,
    only,
    publishing,
    service,
)
from shsa_core.errors import ModelError, ShsaError
from shsa_core.healing import events
from shsa_core.healing.incident import WELL, State, Trigger
from shsa_core.healing.node import Accusation
from shsa_core.healing.process import Substitute
from shsa_core.model.kinds import Standby
from shsa_core.model.ontology import Ontology, Property
from shsa_core.model.service import LastResort, Provision, Service
from shsa_core.model.som import Som
from shsa_core.planning.pool import IdleProcess


def learned(commands: List[events.Command]) -> List[str]:
    return [command.node for command in commands if isinstance(command, events.LearnNode)]


def test_a_node_is_learned_once_each_time_that_it_comes_up() -> None:
    two = replace(service("b", A), name="b")
    robot = Robot(Som([service("a", A, needed=True), two, service("c", C)]))
    assert sorted(learned(robot.said)) == [A, C]
    robot.row("/b", A, "healthy", 5.0)
    assert not learned(robot.table(5.0))
    robot.fail("/a", A, 10.0, "out_of_range")
    robot.killed(10.1, A)
    assert learned(robot.back(20.0)) == [A]


def test_a_node_that_could_not_be_learned_is_tried_until_it_is_known() -> None:
    robot = Robot()
    robot.handle(events.NodeLearned(1.0, B, True))
    robot.handle(events.NodeLearned(1.0, A, False))
    assert robot.core.deadline == 3.0
    assert learned(robot.handle(events.Tick(3.0))) == [A]
    for time, pause in ((4.0, 4.0), (8.0, 8.0)):
        robot.handle(events.NodeLearned(time, A, False))
        assert robot.core.deadline == time + pause
        assert learned(robot.handle(events.Tick(time + pause))) == [A]
    robot.handle(events.NodeLearned(34.0, A, True))
    assert robot.core.deadline == inf


def test_the_som_tells_which_processes_are_known() -> None:
    robot = Robot()

    def verified(commands: List[events.Command]) -> List[str]:
        tables = [each for each in commands if isinstance(each, events.ShowSom)]
        return [node for table in tables for row in table.rows for node in row.verified]

    assert verified(robot.handle(events.NodeLearned(1.0, A, True))) == [A]
    again = robot.rows.pop(("/a", A))
    robot.table(1.2)
    robot.rows["/a", A] = replace(again, since=1.4)
    assert not verified(robot.table(1.4))
    assert verified(robot.handle(events.NodeLearned(1.5, A, True))) == [A]


def test_a_node_that_died_is_not_tried_any_more() -> None:
    robot = Robot()
    robot.handle(events.NodeLearned(1.0, B, False))
    robot.rows.pop(("/b", B))
    robot.table(1.2)
    assert not learned(robot.handle(events.Tick(2.0)))


def test_substitutes_that_were_left_behind_are_cleared_and_their_names_not_used_again() -> None:
    robot = Robot()
    left = ("/substitute_a_7", "/substitute_standby_3")
    commands = robot.handle(events.Started(1.0, left))
    assert [each.node for each in commands if isinstance(each, events.ClearNode)] == list(left)
    assert "Stopping orphaned substitute /substitute_a_7." in str(commands)
    start = only(robot.fail("/a", A, 10.0), events.StartSubstitute)
    assert start.node == "/substitute_a_8"


@pytest.mark.parametrize(
    "node",
    [
        "/substitute_messages",
        "/substitute_7",
        "/substitute_a_\u00b2",
        "/substitute_a_\u0667",
        "/substitute_a_" + "7" * 5000,
        "/substitute_4242_1700000000000",
        "/robot1/substitute_a_7",
    ],
)
def test_a_node_whose_name_only_begins_like_a_substitutes_is_never_killed(node: str) -> None:
    robot = Robot()
    for event in (events.Started(1.0, (node,)), events.Started(1.0, (), (node,))):
        commands = robot.handle(event)
        assert not has(commands, events.FindNode) and "Stopping" not in str(commands)
    assert only(robot.fail("/a", A, 10.0), events.StartSubstitute).node == "/substitute_a_1"


def test_what_is_named_as_a_substitute_and_not_known_to_be_one_is_left_alone_and_told() -> None:
    robot = Robot()
    commands = robot.handle(events.Started(1.0, (), ("/substitute_a_7", "/substitute_messages")))
    (log,) = [each for each in commands if isinstance(each, events.Log)]
    assert "/substitute_a_7 is left alone" in log.text and not has(commands, events.FindNode)
    assert only(robot.fail("/a", A, 10.0), events.StartSubstitute).node == "/substitute_a_8"


def test_at_the_end_every_substitute_is_stopped() -> None:
    robot = Robot()
    node = robot.heal(10.0)
    robot.handle(events.NodeRestarted(11.0, A))
    assert robot.handle(events.ShuttingDown(20.0)) == [events.StopNode(node)]


def test_a_node_that_was_started_again_ends_with_whoever_started_it_first() -> None:
    robot = Robot()
    robot.handle(events.NodeRestarted(11.0, A))
    assert robot.handle(events.StarterEnded(12.0, A)) == [events.StopNode(A)]
    assert robot.handle(events.StarterEnded(12.0, A)) == []


def test_what_stops_while_the_launch_ends_is_not_healed() -> None:
    robot = Robot()
    robot.handle(events.LaunchEnding(9.0))
    assert robot.fail("/a", A, 10.0) == []
    robot.row("/a", A, "failed", 10.0)
    commands = robot.table(10.1)
    assert not has(commands, events.FindNode) and not has(commands, events.ShowIncident)


SHARED = Ontology(
    properties={name: Property(name) for name in ("left", "right", "c")},
    constants={},
    functions=[function("l", "left", "c + 1", 0.9), function("r", "right", "left + c", 0.9)],
)


def wheel(name: str, node: str) -> Service:
    provides = (Provision(name, "velocity"),)
    return Service(name, "/wheels", "pkg/Wheel", node, 0.02, provides, needed=True)


def test_services_that_share_a_topic_are_healed_each_for_itself() -> None:
    som = Som([wheel("left", "/l_node"), wheel("right", "/r_node"), service("c", C)])
    robot = Robot(som, SHARED)
    commands = robot.fail("/wheels", "/l_node", 10.0)
    start = only(commands, events.StartSubstitute)
    assert start.program is not None and start.program.inputs == ("/c/data",)
    assert last_incident(commands).service == "left"
    (state,) = only(commands, events.ShowSom).rows
    assert (state.service.name, state.available) == ("left", False)
    (signal,) = robot.shown[start.node].outputs
    assert (signal.topic, signal.node) == ("/wheels", "/l_node")


def test_an_input_on_a_shared_topic_counts_from_its_own_node_alone() -> None:
    som = Som([wheel("left", "/l_node"), wheel("right", "/r_node"), service("c", C)])
    robot = Robot(som, SHARED)
    start = only(robot.fail("/wheels", "/r_node", 10.0), events.StartSubstitute)
    inputs = {signal.path: signal.node for signal in start.inputs}
    assert inputs == {"/wheels/velocity": "/l_node", "/c/data": ""}


def test_a_stranger_on_a_shared_topic_belongs_to_no_service() -> None:
    som = Som([wheel("left", "/l_node"), wheel("right", "/r_node"), service("c", C)])
    robot = Robot(som, SHARED)
    assert robot.fail("/wheels", "/stranger", 10.0) == []


def test_the_failure_of_a_substitute_on_a_shared_topic_is_its_services() -> None:
    som = Som([wheel("left", "/l_node"), wheel("right", "/r_node"), service("c", C)])
    robot = Robot(som, SHARED, restarts=0)
    node = only(robot.fail("/wheels", "/l_node", 10.0), events.StartSubstitute).node
    robot.killed(10.1, "/l_node")
    commands = robot.failure("/wheels", node, 11.5, "out_of_range", "too high", 11.4)
    assert only(commands, events.StopNode).node == node
    assert last_incident(commands).service == "left"


def test_services_are_found_by_name_topic_and_property() -> None:
    spare = Service("spare", "/spare", "p/T", "/spare_node", 0.1, (Provision("a", "data"),))
    robot = Robot(Som([spare, *SOM]))
    assert robot.core.find("spare").name == "spare"
    assert robot.core.find("/a").name == "a"
    assert robot.core.find("a").name == "a"
    with pytest.raises(ModelError) as caught:
        robot.core.find("/nothing")
    assert "the SOM has no such service or topic; it has spare (/spare), a (/a)" in str(
        caught.value
    )


def test_a_request_for_what_is_being_healed_shows_the_incident() -> None:
    robot = Robot()
    robot.heal(10.0)
    assert robot.core.incident("a") is not None and robot.core.incident("b") is None
    shown = only(robot.handle(events.SubstituteRequested(20.0, "a")), events.ShowIncident)
    assert shown.incident.state is State.HEALED
    assert robot.handle(events.SubstituteRequested(20.0, "nothing")) == []


def test_what_was_told_twice_is_done_once() -> None:
    robot = Robot()
    robot.fail("/a", A, 10.0, "silent")
    robot.killed(10.05, A)
    assert robot.fail("/a", A, 10.0, "silent") == []


@pytest.mark.parametrize("certain", (True, False))
def test_what_is_told_again_ends_no_new_node_of_that_name(certain: bool) -> None:
    """Its moment comes through two clocks, and may be a little later than at the first time."""
    robot = Robot()
    robot.fail("/a", A, 10.0)
    if certain:
        robot.killed(10.01, A)
    robot.row("/a", A, "unknown", 12.0)
    robot.table(12.0)  # it is coming back
    commands = robot.failure("/a", A, 10.005, "node_gone", "it died.", 9.98)
    asked = (events.FindNode, events.ClearNode, events.AskToLeave)
    assert not any(isinstance(each, asked) for each in commands)


def test_a_substitute_of_former_days_is_no_original() -> None:
    robot = Robot()
    node = robot.heal(10.0)
    robot.back(20.0)
    robot.handle(events.Tick(23.0))
    assert robot.failure("/a", node, 24.0, "silent", "no message", 23.0) == []
    assert robot.handle(events.ProcessExited(24.0, node, "status 0")) == []


def test_the_record_of_an_incident_is_plain() -> None:
    robot = Robot()
    robot.heal(10.0)
    plain = last_incident(robot.said).as_dict()
    assert plain["state"] == "healed" and plain["kind"] == "node_gone"
    assert type(plain["state"]) is str and plain["outage"] == pytest.approx(0.52)


def test_an_incident_tells_what_was_seen_and_what_was_not_available() -> None:
    robot = Robot()
    robot.row("/b", B, "healthy", 5.0)
    robot.row("/c", C, "failed", 5.0)
    robot.table(5.0)
    robot.heal(10.0)
    incident = last_incident(robot.said)
    assert incident.evidence == "it died." != incident.detail
    assert incident.unavailable == ("c",)


def test_safe_values_promise_nothing() -> None:
    first, *_ = SOM
    robot = Robot(Som([replace(first, last_resort=LastResort(values=(("a", 1.0),)))]))
    start = only(robot.fail("/a", A, 10.0), events.StartSubstitute)
    assert last_incident(robot.said).quality is None
    assert robot.shown[start.node].quality == 0.0


@pytest.mark.parametrize(
    "spoil, told",
    [
        (lambda core, a: setattr(a.substitute, "plan", None), "a process without a plan"),
        (lambda core, a: a.timers.update({Trigger.STEADY: 20.0}), "a: healed with the timers"),
        (
            lambda core, a: setattr(a, "incident", replace(a.incident, state=State.UNHEALED)),
            "a: unhealed, and nothing will ever be tried again",
        ),
        (
            lambda core, a: vars(a.substitute).update(node="", plan=None),
            "a: healed without a substitute",
        ),
        (
            lambda core, a: core._processes.pool.add(IdleProcess(a.node, 0.0)),
            "works for a and for the pool",
        ),
        (
            lambda core, a: setattr(a, "incident", replace(a.incident, state=State.HEALING)),
            "a is being healed, and nothing will ever happen",
        ),
        (
            lambda core, a: core.robot.availability.states.rows.update(
                a=core.robot.availability.states.rows["b"]
            ),
            "a is healed and available at the same time",
        ),
        (
            lambda core, a: a.__dict__.update(
                incident=WELL,
                accusation=Accusation(),
                substitute=Substitute("a", core.robot, core._processes),
            ),
            "is in the table of substitutions, but has no owner",
        ),
        (
            lambda core, a: a.__dict__.update(incident=WELL, accusation=Accusation()),
            "publishes for a, which is well",
        ),
    ],
)
def test_a_broken_invariant_is_told(spoil: Callable[[Any, Any], object], told: str) -> None:
    robot = Robot()
    robot.heal(10.0)
    spoil(robot.core, robot.core.services["a"])
    with pytest.raises(ShsaError, match=told):
        robot.core.validate()


def test_a_service_is_found_by_a_property_alone() -> None:
    two = Service("both", "/both", "p/T", A, 0.1, (Provision("b", "x"),), needed=True)
    robot = Robot(Som([service("b", B), two]))
    assert robot.core.find("/both").name == "both"
    named = Service("other", "/other", "p/T", A, 0.1, (Provision("c", "x"),))
    assert Robot(Som([named, two])).core.find("c").name == "other"


def test_nothing_is_healed_without_evidence_in_the_record() -> None:
    robot = Robot()
    commands = robot.failure("/a", A, 10.0, "silent", "", 9.9)
    assert not has(commands, events.ShowIncident) and not has(commands, events.FindNode)
    assert "Nothing is healed without evidence" in str(commands)
    incident = last_incident(robot.fail("/a", A, 11.0))
    assert incident.kind == "node_gone" and incident.detail


def test_a_node_that_is_well_again_counts_for_all_that_it_publishes() -> None:
    robot = Robot(Som([service("a", A, needed=True), service("b", B), service("c", A)]))
    robot.fail("/a", A, 10.0, "silent")
    robot.killed(10.1, A)
    robot.rows["/c", A] = replace(robot.rows["/c", A], since=10.2)
    robot.table(10.2)
    states = {
        row.service.name: row.available
        for row in robot.core.robot.availability.states.rows.values()
    }
    assert states == {"a": False, "b": True, "c": True}
    robot.row("/a", A, "healthy", 20.0)
    robot.handle(events.HealthSeen(20.0, (robot.rows["/a", A],)))
    robot.killed(20.1, B)
    robot.handle(
        events.HealthSeen(
            20.2, (replace(robot.rows["/c", A], topic="/x", publisher=B, since=20.2),)
        )
    )
    assert robot.core.robot.availability.states.rows["b"].available


def test_silence_of_a_substitute_beside_its_returning_original_is_no_step() -> None:
    robot = Robot()
    node = robot.heal(10.0)
    robot.row("/b", B, "failed", 15.0)
    robot.table(15.01)
    robot.row("/a", A, "healthy", 15.02)
    robot.table(15.03)
    assert robot.failure("/a", node, 15.1, "silent", "no message", 14.9) == []


def test_a_node_that_is_back_before_its_kill_is_over_is_not_healed_for_ever() -> None:
    robot = Robot()
    commands = robot.fail("/a", A, 10.0)
    assert only(commands, events.FindNode) == events.FindNode(A, False, "/a")
    robot.row("/a", A, "healthy", 10.3)
    robot.table(10.31)
    assert publishing(robot) == (True,)
    commands = robot.handle(events.NodeFound(10.5, A, events.Where.DEAD))
    assert publishing(robot) == (False,)
    assert last_incident(commands).state is State.RETURNING
    assert learned(commands) == [A]
    assert last_incident(robot.handle(events.Tick(12.6))).state is State.ENDED
    start = only(robot.fail("/a", A, 20.0, "out_of_range"), events.FindNode)
    assert start.successor


def test_a_node_that_was_well_before_it_was_killed_is_not_back() -> None:
    robot = Robot()
    robot.fail("/a", A, 10.0, "out_of_range")
    robot.row("/a", A, "healthy", 10.03)
    robot.table(10.04)
    robot.killed(10.1, A)
    assert last_incident(robot.said).state is State.HEALING and publishing(robot) == (True,)


def test_a_hot_service_that_nothing_can_replace_any_more_has_no_substitute() -> None:
    first, *others = SOM
    robot = Robot(Som([replace(first, standby=Standby.HOT), *others]))
    (row,) = robot.working()
    robot.rows = {("/a", A): robot.rows["/a", A]}
    robot.table(5.0)
    assert only(robot.idle(5.1), events.StopNode).node == row.node
    assert robot.working() == []


def test_an_outage_has_a_beginning_and_an_end() -> None:
    robot = Robot()
    incident = last_incident(robot.fail("/a", A, 10.0))
    assert incident.outage is None
    assert replace(incident, first_message=10.5).outage == pytest.approx(0.52)
    assert replace(incident, first_message=10.5, last_good=None).outage is None


def test_an_outage_begins_with_the_last_good_message_of_the_substitute() -> None:
    robot = Robot()
    robot.heal(10.0)
    robot.fail("/b", B, 20.0)
    robot.fail("/c", C, 20.2)
    robot.row("/b", B, "healthy", 20.3)
    robot.table(20.3)
    (node,) = [row.node for row in robot.working()]
    robot.row("/a", node, "healthy", 20.5, first=20.5)
    told = last_incident(robot.table(20.6))
    assert told.state is State.HEALED and told.outage == pytest.approx(0.3)


def test_the_failure_of_what_is_not_needed_is_said_once() -> None:
    robot = Robot()
    told = robot.fail("/b", B, 10.0)
    assert not has(told, events.FindNode) and not has(told, events.StartSubstitute)
    robot.row("/b", B, "failed", 10.0)
    told += robot.table(10.02)
    texts = [each.text for each in told if isinstance(each, events.Log)]
    assert [text for text in texts if "nothing is done" in text] == texts and len(texts) == 1
