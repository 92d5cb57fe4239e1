"""The kill of a faulty node, step by step, and what counts as certain."""
from math import inf
from typing import Any, FrozenSet, List, Optional, Sequence, Tuple

import pytest

from core_robot import Robot
from shsa_core.healing.events import (
    AskToLeave,
    ClearNode,
    Command,
    EndProcess,
    FindNode,
    HealthSeen,
    NodeAnswered,
    NodeFound,
    NodeLeft,
    ProcessUntouchable,
    Where,
)
from shsa_core.healing.kill import (
    KillEvent,
    KillNode,
    KillOver,
    Kills,
    Outcome,
    Said,
)
from shsa_core.model.health import PublisherHealth, PublisherState

N = "/node"
Parts = Tuple[List[Any], Optional[KillOver]]


class Killing(Kills):
    """Kills without services, and what is said of them in two parts."""

    def __init__(self) -> None:
        self.robot = Robot().core.robot
        super().__init__(self.robot)

    @property
    def nodes(self) -> FrozenSet[str]:
        return frozenset(self.robot.health.dying)

    def told(self, event: KillEvent) -> Parts:
        return parts(self.handle(event))

    def passed(self, time: float) -> Parts:
        return parts(self.tick(time))


def parts(said: Sequence[Said]) -> Parts:
    """Return the commands, and how the kill has ended."""
    over = [each for each in said if isinstance(each, KillOver)]
    return [each for each in said if each not in over], over[0] if over else None


def begun(quick: bool = False) -> Killing:
    kills = Killing()
    assert kills.begin(10.0, KillNode(N, quick=quick)) == [FindNode(N, spares=not quick)]
    assert kills.nodes == {N}
    return kills


def found(kills: Killing, where: Where) -> List[Command]:
    commands, over = kills.told(NodeFound(10.0, N, where))
    assert over is None and kills.nodes == {N}
    return commands


def test_the_address_of_the_process_that_was_heard_goes_with_the_search() -> None:
    kills = Killing()
    row = PublisherHealth("/x", N, PublisherState.FAILED, 9.0, uri="http://127.0.0.1:4242/")
    kills.robot.health.heed(HealthSeen(9.5, (row,)))
    assert kills.begin(10.0, KillNode(N, "/x")) == [FindNode(N, True, "/x", 0.0, row.uri)]


def test_a_node_that_leaves_when_it_is_asked_is_certainly_gone() -> None:
    kills = begun()
    assert found(kills, Where.HERE) == [AskToLeave(N)]
    commands, over = kills.told(NodeLeft(10.05, N))
    assert commands == [ClearNode(N)]
    assert over == KillOver(10.05, N, Outcome.GONE, "it left")
    assert not kills.nodes and kills.agenda.next() == inf


@pytest.mark.parametrize("quick, patience", [(True, 0.1), (False, 1.0)])
def test_a_node_that_does_not_leave_in_time_is_forced(quick: bool, patience: float) -> None:
    kills = begun(quick=quick)
    found(kills, Where.HERE)
    if quick:  # though it answers
        assert kills.told(NodeAnswered(10.01, N)) == ([], None)
    assert kills.agenda.next() == 10.0 + patience
    assert kills.passed(10.0 + 0.9 * patience) == ([], None)
    assert kills.passed(10.0 + patience) == ([EndProcess(N)], None)
    _, over = kills.told(NodeLeft(11.5, N))
    assert over and over.outcome is Outcome.GONE and "did not leave in time" in over.detail


def test_a_node_that_answers_has_the_time_that_roslaunch_gives() -> None:
    kills = begun()
    found(kills, Where.HERE)
    assert kills.told(NodeAnswered(10.01, N)) == ([], None)
    assert kills.passed(25.0) == ([], None)
    assert kills.passed(25.01) == ([EndProcess(N, gently=True)], None)
    assert kills.passed(27.0) == ([], None)
    assert kills.passed(27.01) == ([EndProcess(N)], None)
    _, over = kills.told(NodeLeft(27.1, N))
    assert over and over.outcome is Outcome.GONE


def test_a_stopped_node_is_forced_at_once() -> None:
    assert found(begun(), Where.STOPPED) == [EndProcess(N)]


def test_a_dead_node_is_only_cleared() -> None:
    kills = begun()
    commands, over = kills.told(NodeFound(10.0, N, Where.DEAD))
    assert commands == [ClearNode(N)]
    assert over == KillOver(10.0, N, Outcome.GONE, "it had died")


def test_a_node_that_nobody_knows_is_gone() -> None:
    commands, over = begun().told(NodeFound(10.0, N, Where.NOWHERE))
    assert commands == [] and over and over.outcome is Outcome.GONE


def test_a_node_elsewhere_that_does_not_answer_may_still_run() -> None:
    kills = begun()
    assert found(kills, Where.ELSEWHERE) == [AskToLeave(N)]
    commands, over = kills.passed(11.0)
    assert commands == [] and over and over.outcome is Outcome.UNSURE
    assert over.detail == "it does not answer"


def test_a_node_elsewhere_that_answers_is_gone() -> None:
    kills = begun()
    found(kills, Where.ELSEWHERE)
    _, over = kills.told(NodeLeft(10.2, N))
    assert over and over.outcome is Outcome.GONE


def test_a_process_that_does_not_end_may_still_run() -> None:
    kills = begun()
    found(kills, Where.STOPPED)
    _, over = kills.passed(11.0)
    assert over and over.outcome is Outcome.UNSURE and over.detail == "it does not end"


def test_a_process_of_somebody_else_may_still_run() -> None:
    kills = begun()
    found(kills, Where.STOPPED)
    _, over = kills.told(ProcessUntouchable(10.1, N))
    assert over and over.outcome is Outcome.UNSURE and "somebody else" in over.detail


def test_a_node_that_cannot_be_found_in_time_may_still_run() -> None:
    kills = begun()
    assert kills.passed(11.9) == ([], None)
    _, over = kills.passed(12.0)
    assert over and over.outcome is Outcome.UNSURE and "found in time" in over.detail


def test_a_kill_that_is_under_way_is_not_begun_again() -> None:
    kills = begun()
    assert kills.begin(10.1, KillNode(N)) == []
    assert kills.begin(10.1, KillNode("")) == []


def test_what_comes_late_changes_nothing() -> None:
    kills = begun()
    found(kills, Where.HERE)
    assert kills.told(NodeFound(10.1, N, Where.DEAD)) == ([], None)  # told twice
    kills.told(NodeLeft(10.2, N))
    assert kills.told(NodeLeft(10.3, N)) == ([], None)
    assert kills.told(NodeFound(10.3, N, Where.HERE)) == ([], None)
    assert kills.told(ProcessUntouchable(10.3, N)) == ([], None)
    assert kills.passed(20.0) == ([], None)


@pytest.mark.parametrize("where", [Where.HERE, Where.STOPPED, Where.ELSEWHERE])
def test_a_node_that_is_to_be_cleared_if_it_is_dead_is_spared_if_it_is_not(where: Where) -> None:
    kills = Killing()
    assert kills.begin(10.0, KillNode(N, if_dead=True)) == [FindNode(N, successor=False)]
    assert kills.told(NodeFound(10.1, N, where)) == ([], KillOver(10.1, N, Outcome.SPARED))
    assert not kills.nodes and kills.agenda.next() == inf


def test_a_dead_node_is_cleared_even_if_it_is_to_be_spared() -> None:
    kills = Killing()
    kills.begin(10.0, KillNode(N, if_dead=True))
    commands, over = kills.told(NodeFound(10.1, N, Where.DEAD))
    assert commands == [ClearNode(N)] and over and over.outcome is Outcome.GONE


def test_a_node_that_cannot_be_found_in_time_is_spared() -> None:
    kills = Killing()
    kills.begin(10.0, KillNode(N, if_dead=True))
    assert kills.passed(12.0) == ([], KillOver(12.0, N, Outcome.SPARED))


def test_a_node_that_is_to_be_killed_after_all_is_not_spared() -> None:
    kills = Killing()
    kills.begin(10.0, KillNode(N, if_dead=True))
    assert kills.begin(10.01, KillNode(N)) == []
    assert found(kills, Where.HERE) == [AskToLeave(N)]
