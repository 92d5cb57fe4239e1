"""The states of a service: the table, and what is impossible."""
from typing import Any, Dict, Set

import pytest

from core_robot import A, Robot
from shsa_core.healing.incident import State, Trigger
from shsa_core.healing.transitions import TRANSITIONS
from shsa_core.healing.service import InvalidTransition


def test_every_state_can_be_reached_and_left() -> None:
    ends: Dict[State, Set[State]] = {}
    for (state, _), (_, to) in TRANSITIONS.items():
        ends.setdefault(state, set()).update(to)
    reached = {State.WELL}
    while True:
        more = set().union(*(ends[state] for state in reached)) - reached
        if not more:
            break
        reached |= more
    assert reached == set(State) - {State.ENDED}
    assert all(to != {state} for state, to in ends.items())


def test_a_trigger_that_a_state_does_not_have_raises_with_its_story() -> None:
    robot = Robot()
    robot.heal(10.0)
    with pytest.raises(InvalidTransition) as caught:
        robot.core.services["a"].fire(Trigger.STEADY)
    told = str(caught.value)
    assert "a: healed: nothing is to be done about 'healthy for the hold-off'" in told
    assert "10.000 well -> healing: its node failed" in told
    assert "10.510 healing -> healed: first message of the substitute" in told


def test_a_transition_to_a_state_that_the_table_does_not_have_raises(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    act, _ = TRANSITIONS[State.WELL, Trigger.FAILED]
    changed: Any = TRANSITIONS
    monkeypatch.setitem(changed, (State.WELL, Trigger.FAILED), (act, frozenset({State.WELL})))
    with pytest.raises(InvalidTransition) as caught:
        Robot().fail("/a", A, 10.0)
    assert "'its node failed' does not lead from well to healing" in str(caught.value)
