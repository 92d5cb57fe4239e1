"""Decides who may not be blamed, why, and for how long: one table, in order.

Together all alibis of a silence grant it as long again as it is allowed, at most.
"""
from dataclasses import dataclass
from math import inf
from typing import Callable, NamedTuple, Optional, Tuple

from shsa_core.model.checks import BY_VALUE
from shsa_core.model.kinds import Kind
from shsa_core.model.substitution import CHANGEOVER_S
from shsa_core.monitoring.settings import TOGETHER_NODES


@dataclass(frozen=True)
class Case:
    """A publisher that is late, and what else was going on. Times in s."""

    kind: Optional[Kind]  # what it could be blamed for; None: nothing, it would teach a deadline
    now: float
    began: float  # when that began
    limit: float = inf  # until when alibis count
    due: float = -inf  # when it is late by the watch, which stands while nobody could act
    reconnects_until: float = -inf  # by then it gives a lost connection anew
    busy: float = -inf  # when healing connected to it, or a substitute came up, last
    short: float = -inf  # when it or the computer was short of processor time
    paced: bool = True  # the rate by the SOM is its own
    together: int = 1  # nodes that are late, or out of range, with it, itself included
    confirmed: bool = False  # what others tell is as far out of range
    fed_badly: bool = False  # what it is computed from is at fault as well
    was_there: bool = False  # it was there before its topic was watched
    robot_came: bool = True  # some node of it was there, or was under a former monitor


class Alibi(NamedTuple):
    """Why a publisher is not blamed, and until when; `accuses_som`: the SOM may be wrong."""

    why: str
    until: float
    accuses_som: bool = False


class Row(NamedTuple):
    """An alibi: of what it clears, when it applies, and until when it holds."""

    why: str
    clears: Tuple[Optional[Kind], ...]
    applies: Callable[[Case], bool] = lambda case: True
    until: Callable[[Case], float] = lambda case: case.limit


_SILENCE, _RANGE, _START = (Kind.SILENT,), (Kind.OUT_OF_RANGE,), (Kind.NEVER_PUBLISHED,)
BY_SOM = (Kind.OUT_OF_RANGE, Kind.UNKNOWN_PUBLISHER)
_LATE = (Kind.SILENT, Kind.RATE_LOW, Kind.STALE_STAMP, None)

ROWS = (
    Row(
        "the monitor was held up, and others may have been with it",
        _SILENCE,
        until=lambda case: case.due,
    ),
    Row(
        "its connection is made anew",
        _SILENCE,
        until=lambda case: case.reconnects_until,
    ),
    Row(
        "healing connected to it, or a substitute came up, which takes its time",
        _LATE,
        lambda case: case.busy + CHANGEOVER_S >= case.began,
    ),
    Row(
        "it waits for a processor, or the computer is short of processor time",
        (*_LATE, *_START),
        lambda case: case.short + CHANGEOVER_S >= case.began,
    ),
    Row(
        "nodes that have nothing to do with each other are late together",
        (*_LATE, *_START),
        lambda case: case.together >= TOGETHER_NODES,
    ),
    Row(
        "its rate was never good: `period` in the SOM may be wrong, or that of another node",
        (Kind.RATE_LOW, Kind.RATE_HIGH),
        lambda case: not case.paced,
    ),
    Row(
        "what others tell confirms its value: the range in the SOM may be wrong, and not the node",
        _RANGE,
        lambda case: case.confirmed,
    ),
    Row(
        "nodes that share no cause are out of range together: the SOM may be wrong, or the world",
        _RANGE,
        lambda case: case.together > 1,
    ),
    Row(
        "what it is computed from is wrong, comes too seldom, or is a substitute's",
        (*_LATE, *BY_VALUE),
        lambda case: case.fed_badly,
    ),
    Row(
        "it was there before its topic was watched: name it in the SOM, or end it",
        (Kind.UNKNOWN_PUBLISHER,),
        lambda case: case.was_there,
    ),
    Row(
        "nothing of the robot is there yet",
        _START,
        lambda case: not case.robot_came,
    ),
)


def decide(case: Case) -> Optional[Alibi]:
    """Return the first alibi that holds; None: the publisher is to blame."""
    for row in ROWS:
        if case.kind in row.clears and row.applies(case) and row.until(case) > case.now:
            accuses_som = case.kind in BY_SOM or not case.paced
            return Alibi(row.why, row.until(case), accuses_som)
    return None
