"""Whom a failure can kill, and who is started again: nobody on another's word."""
from dataclasses import replace
from typing import List

import pytest

from core_robot import (
    A,
    B,
    ONTOLOGY,
    SOM,
    Robot,
    has,
    last_incident,
    only,
    publishing,
    service,
)
from shsa_core.healing import events
from shsa_core.healing.events import Where
from shsa_core.healing.incident import State
from shsa_core.healing.kill import KillNode, KillOver, Kills, Outcome
from shsa_core.healing.machine import Reconfigurator
from shsa_core.healing.settings import Settings
from shsa_core.model.kinds import Contain, Policy, Standby
from shsa_core.model.som import Som

STRANGER = "/stranger"
HEALING = ["/monitor", "/reconfigurator", "/rosout", "/master", "/r2/monitor", "/substitute_b_3"]


def decision(commands: List[events.Command]) -> str:
    return " ".join(command.text for command in commands if isinstance(command, events.Log))


@pytest.mark.parametrize("node", HEALING)
@pytest.mark.parametrize("kind", ["out_of_range", "silent", "node_gone", "rate_high"])
def test_no_failure_kills_a_part_of_healing_or_of_ros(node: str, kind: str) -> None:
    robot = Robot()
    commands = robot.failure("/a", node, 10.0, kind, "as somebody says", 9.9)
    robot.rows.pop(("/a", A))
    robot.table(10.5)
    commands += robot.failure("/a", node, 11.0, kind, "as somebody says", 9.9)
    assert not has(robot.said, events.AskToLeave) and not has(robot.said, events.EndProcess)
    finds = [each for each in robot.said if isinstance(each, events.FindNode) and each.node == node]
    for find in finds:  # only whether it is dead
        assert not find.successor
        robot.handle(events.NodeFound(11.1, node, Where.HERE))
    assert not has(robot.said, events.AskToLeave) and not has(robot.said, events.EndProcess)


@pytest.mark.parametrize("node", ["/monitor", "/rosout"])
def test_not_even_the_som_has_healing_killed(node: str) -> None:
    first, *others = SOM
    robot = Robot(Som([replace(first, node=node, contain=Contain.NODE), *others]))
    robot.failure("/a", node, 10.0, "out_of_range", "as somebody says", 9.9)
    assert not has(robot.said, events.FindNode)


def test_a_node_of_the_users_may_have_a_name_like_ours() -> None:
    first, *others = SOM
    robot = Robot(Som([replace(first, node="/camera/monitor"), *others]))
    commands = robot.failure("/a", "/camera/monitor", 10.0, "out_of_range", "as it is", 9.9)
    assert only(commands, events.FindNode).node == "/camera/monitor"


def test_a_node_that_another_service_needs_and_that_is_good_there_is_never_killed() -> None:
    first, second, third = SOM
    robot = Robot(Som([first, replace(second, needed=True), third]))
    commands = robot.failure("/a", B, 10.0, "out_of_range", "as somebody says", 9.9)
    assert not has(commands, events.FindNode)
    forced = Som([replace(first, contain=Contain.NODE), replace(second, needed=True), third])
    robot = Robot(forced)
    commands = robot.failure("/a", B, 10.0, "out_of_range", "as somebody says", 9.9)
    assert not has(commands, events.FindNode)


def test_a_stranger_that_babbles_is_looked_for_as_a_publisher_of_that_topic() -> None:
    robot = Robot()
    commands = robot.failure("/a", STRANGER, 10.0, "unknown_publisher", "as it is", 9.9)
    assert only(commands, events.FindNode) == events.FindNode(STRANGER, True, "/a")


def test_who_is_not_the_one_that_failed_is_not_touched_and_goes_on_to_count() -> None:
    robot = Robot()
    robot.failure("/a", B, 10.0, "rate_high", "as somebody says", 9.9)
    commands = robot.handle(events.NodeFound(10.01, B, Where.ANOTHER, "it is another"))
    assert "/b_node is not touched: it is another." in decision(commands)
    assert not has(commands, events.AskToLeave) and B not in robot.core.robot.health.excluded
    assert robot.core.robot.availability.states.rows["b"].available


def test_healing_goes_on_beside_one_that_cannot_be_verified() -> None:
    for where in (Where.ANOTHER, Where.UNKNOWN):
        robot = Robot()
        robot.fail("/a", A, 10.0, "out_of_range")
        assert publishing(robot) == (False,)
        commands = robot.handle(events.NodeFound(10.01, A, where, "it says nothing"))
        assert "it says nothing" in decision(commands)
        assert publishing(robot) == (True,)
        assert last_incident(robot.said).killed is None


def test_only_the_nodes_that_the_som_names_are_learned() -> None:
    robot = Robot()
    robot.row("/a", STRANGER, "healthy", 5.0)
    robot.row("/nothing", "/other", "healthy", 5.0)
    robot.row("/b", A, "healthy", 5.0)
    commands = robot.table(5.0)
    assert not has(commands, events.LearnNode)
    learned = [each for each in robot.said if isinstance(each, events.LearnNode)]
    assert events.LearnNode(A, "/a") in learned and events.LearnNode(B, "/b") in learned


def test_a_stranger_is_never_started_again() -> None:
    first, *others = SOM
    robot = Robot(Som([replace(first, policy=Policy.RESTART), *others]), restart_pause=1.0)
    robot.rows.pop(("/a", A))
    robot.row("/a", STRANGER, "healthy", 5.0)
    robot.table(5.0)
    robot.failure("/a", STRANGER, 10.0, "out_of_range", "as it is", 9.9)
    robot.killed(10.1, STRANGER)
    for time in (11.0, 12.0, 15.0):
        robot.handle(events.Tick(time))
    assert not has(robot.said, events.RestartNode)


@pytest.mark.parametrize("policy", [Policy.RESTART, Policy.RESTART_AND_SUBSTITUTE])
def test_a_node_that_may_not_be_started_again_is_not_killed_for_it(policy: Policy) -> None:
    first, *others = SOM
    cost = service("b", A, needed=True)
    som = Som([replace(first, policy=policy), cost, others[1]])
    robot = Robot(som)
    robot.core = Reconfigurator(ONTOLOGY, som, Settings(), restarts=False)
    robot.table(2.0)
    commands = robot.fail("/a", A, 10.0, "out_of_range")
    assert not has(commands, events.FindNode)
    assert last_incident(commands).state is State.KEPT
    assert not has(robot.handle(events.Tick(20.0)), events.RestartNode)


def test_a_failure_that_is_told_of_another_topic_does_not_save_who_failed() -> None:
    kills = Kills(Robot().core.robot)
    assert kills.begin(10.0, KillNode("/n", "/x")) != []
    assert kills.begin(10.0, KillNode("/n", "/y")) == []
    another = events.NodeFound(10.1, "/n", Where.ANOTHER, "it does not publish /x")
    assert kills.handle(another) == [events.FindNode("/n", True, "/y")]
    here = replace(another, where=Where.HERE)
    assert kills.handle(here) == [events.AskToLeave("/n")]


def test_who_failed_on_none_of_the_topics_is_another() -> None:
    kills = Kills(Robot().core.robot)
    for topic in ("/x", "/y"):
        kills.begin(10.0, KillNode("/n", topic))
    another = events.NodeFound(10.1, "/n", Where.ANOTHER, "it does not publish that")
    kills.handle(another)
    (over,) = kills.handle(another)
    assert isinstance(over, KillOver) and over.outcome is Outcome.ANOTHER


def test_what_cannot_be_verified_is_not_certain() -> None:
    for where in (Where.UNKNOWN, Where.ANOTHER):
        kills = Kills(Robot().core.robot)
        kills.begin(10.0, KillNode("/n", "/x"))
        (over,) = kills.handle(events.NodeFound(10.1, "/n", where))
        assert isinstance(over, KillOver)
        spared = over.outcome is Outcome.ANOTHER and "not the one" in over.detail
        assert spared or over.outcome is Outcome.UNSURE
    kills = Kills(Robot().core.robot)
    kills.begin(10.0, KillNode("/n", "/x"))
    kills.handle(events.NodeFound(10.1, "/n", Where.ELSEWHERE))
    (over,) = kills.handle(events.ProcessUntouchable(10.2, "/n", "", "it refuses"))
    assert over == KillOver(10.2, "/n", Outcome.UNSURE, "it refuses")


def test_who_was_to_be_spared_is_spared_when_nothing_can_be_told() -> None:
    kills = Kills(Robot().core.robot)
    kills.begin(10.0, KillNode("/n", "/x", if_dead=True))
    (over,) = kills.handle(events.ProcessUntouchable(10.1, "/n", "", "an error"))
    assert over == KillOver(10.1, "/n", Outcome.SPARED)


def test_a_hot_service_is_healed_at_once_beside_a_lie() -> None:
    first, *others = SOM
    robot = Robot(Som([replace(first, standby=Standby.HOT), *others]))
    robot.failure("/a", "/monitor", 10.0, "out_of_range", "as somebody says", 9.9)
    assert publishing(robot) == (False,)  # its own node does well
    robot.fail("/a", A, 11.0)
    assert publishing(robot) == (True,)
