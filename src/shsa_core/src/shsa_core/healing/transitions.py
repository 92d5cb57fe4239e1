"""The states of a service, and what leads from one to the other.

The diagram in docs/architecture.md as a table.
"""
from collections import deque
from typing import Deque, Dict, FrozenSet, Iterable, Tuple

from shsa_core.errors import ShsaError
from shsa_core.healing.incident import State
from shsa_core.model.kinds import Word

STORY_LENGTH = 20


class Trigger(Word):
    """What may change the state of a service."""

    FAILED = "its node failed"
    SUBSTITUTE_FAILED = "substitute failed"
    FIRST_MESSAGE = "first message of the substitute"
    SILENT = "silent while its program changes"
    LATE = "first message is late"
    INPUT_LOST = "an input was lost"
    NO_VALUE = "its law does not hold"
    RETURNED = "its node is back"
    STEADY = "healthy for the hold-off"
    RETRY = "a pause is over"
    SERVICE_CAME = "a service appeared"
    EXHAUSTED = "restarts are used up"
    RELEASED = "released"
    NODE_CHANGED = "its node is judged again"
    PREPARE = "another plan is best"
    WITHDRAWN = "no longer in the SOM"


_STUCK_OR_HEALING = (State.HEALING, State.UNHEALED, State.SAFE, State.KEPT)


def _rows() -> Iterable[Tuple[State, Trigger, str, Tuple[State, ...]]]:
    """State, trigger, the method of TopicHealing that acts, and the states that it may lead to."""
    well, healing, healed = State.WELL, State.HEALING, State.HEALED
    returning, unhealed, safe = State.RETURNING, State.UNHEALED, State.SAFE
    kept = State.KEPT

    yield well, Trigger.FAILED, "_open", (*_STUCK_OR_HEALING, well)
    yield well, Trigger.SUBSTITUTE_FAILED, "_pause_standby", (well,)
    yield well, Trigger.PREPARE, "_prepare", (well,)
    yield well, Trigger.RETRY, "_prepare", (well,)
    yield well, Trigger.NO_VALUE, "_change_law", (well,)

    yield healing, Trigger.FIRST_MESSAGE, "_publishes", (healed,)
    yield healing, Trigger.LATE, "_replace_late", _STUCK_OR_HEALING
    yield healing, Trigger.EXHAUSTED, "_exhausted", (unhealed, safe)
    yield healing, Trigger.PREPARE, "_heal", _STUCK_OR_HEALING
    yield healed, Trigger.INPUT_LOST, "_change_inputs", (healed, unhealed, safe, kept)
    yield healing, Trigger.INPUT_LOST, "_change_inputs", _STUCK_OR_HEALING
    for state in (healing, healed):
        yield state, Trigger.SILENT, "_await_again", (healing,)
        yield state, Trigger.NO_VALUE, "_change_law", (state,)
    for state in (healing, healed, safe):
        yield state, Trigger.SUBSTITUTE_FAILED, "_replace", _STUCK_OR_HEALING

    for stuck, more in ((unhealed, ()), (safe, (healed,))):
        yield stuck, Trigger.RETRY, "_retry", (*_STUCK_OR_HEALING, *more)
        yield stuck, Trigger.SERVICE_CAME, "_heal", (*_STUCK_OR_HEALING, *more)
        yield stuck, Trigger.RELEASED, "_heal", (*_STUCK_OR_HEALING, *more)
        yield stuck, Trigger.EXHAUSTED, "_exhausted", (unhealed, safe)

    for trigger, method in (
        (Trigger.FAILED, "_still_failing"),
        (Trigger.NODE_CHANGED, "_judge_again"),
    ):
        for state in (healing, healed, unhealed, safe):
            yield state, trigger, method, (state, kept)
        yield kept, trigger, method, _STUCK_OR_HEALING
    for trigger in (Trigger.RETRY, Trigger.RELEASED, Trigger.PREPARE):
        yield kept, trigger, "_heal", _STUCK_OR_HEALING
    yield kept, Trigger.SUBSTITUTE_FAILED, "_lose_standby", (kept,)
    for state in (healing, healed, unhealed, safe, kept):
        yield state, Trigger.RETURNED, "_hold_off", (returning,)
    for state in (healing, healed, returning):
        yield state, Trigger.RELEASED, "_record", (state,)

    yield returning, Trigger.FAILED, "_failed_again", (healed, *_STUCK_OR_HEALING)
    yield returning, Trigger.SUBSTITUTE_FAILED, "_lose_standby", (returning,)
    yield returning, Trigger.STEADY, "_end", (well,)
    for state in (healing, healed, returning, unhealed, safe, kept):
        yield state, Trigger.WITHDRAWN, "_withdraw", (well,)


TRANSITIONS: Dict[Tuple[State, Trigger], Tuple[str, FrozenSet[State]]] = {
    (state, trigger): (method, frozenset(to)) for state, trigger, method, to in _rows()
}


class InvalidTransition(ShsaError):
    """A state was to be left in a way that it does not have; the story tells what led to it."""


class Story:
    """The last transitions of a service."""

    def __init__(self, service: str) -> None:
        self._service = service
        self._steps: Deque[Tuple[float, State, Trigger, State]] = deque(maxlen=STORY_LENGTH)

    def method(self, state: State, trigger: Trigger) -> str:
        """The method that acts on a trigger. Raises InvalidTransition if there is none."""
        if (state, trigger) not in TRANSITIONS:
            raise self._invalid(f"{state}: nothing is to be done about '{trigger}'")
        return TRANSITIONS[state, trigger][0]

    def add(self, time: float, state: State, trigger: Trigger, to: State) -> None:
        """A transition was made. Raises InvalidTransition if it is not in the table."""
        self._steps.append((time, state, trigger, to))
        if to not in TRANSITIONS[state, trigger][1]:
            raise self._invalid(f"'{trigger}' does not lead from {state} to {to}")

    def _invalid(self, what: str) -> InvalidTransition:
        steps = [f"{time:.3f} {state} -> {to}: {why}" for time, state, why, to in self._steps]
        return InvalidTransition("\n  ".join([f"{self._service}: {what}. Before that:", *steps]))
