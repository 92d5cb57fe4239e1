"""Decides who may not be blamed, why, and for how long: one table, in order.

A silence, a low rate, an old stamp, a late start, a wrong value and a gap that would teach how long
a stream may be silent are asked the same. Together all alibis of a silence grant it as
long again as it is allowed, at most.
"""
from dataclasses import dataclass
from enum import Enum
from math import inf
from typing import Callable, NamedTuple, Optional, Tuple

from shsa_core.model.substitution import CHANGEOVER_S
from shsa_core.monitoring.settings import TOGETHER_NODES


class Blame(Enum):
    """The faults that a publisher could be blamed for."""

    SILENCE = "silence"
    RATE = "rate"
    HASTE = "haste"
    GAP = "gap"
    STAMP = "stamp"
    RANGE = "range"
    VALUE = "value"
    START = "start"


@dataclass(frozen=True)
class Case:
    """A publisher that is late since it `began` to be, and what else was going on. Times in s.

    `limit`: until when alibis count. `due`: when it is late by the watch, which stands
    while nobody could act. `reconnects_until`: until then it gives a connection that was lost anew.
    `busy`: when healing connected to it, or a substitute came up, last; `short`: when it or the
    computer was short of processor time. `paced`: the rate by the SOM is its
    own. `together`: how many nodes are late, or out of range, with it, itself included.
    `confirmed`: what others tell is as far out of range. `fed_badly`: what it is computed from is
    at fault as well. `robot_came`: some node of the robot was there, or was under a former monitor.
    """

    blame: Blame
    now: float
    began: float
    limit: float = inf
    due: float = -inf
    reconnects_until: float = -inf
    busy: float = -inf
    short: float = -inf
    paced: bool = True
    together: int = 1
    confirmed: bool = False
    fed_badly: bool = False
    robot_came: bool = True


class Alibi(NamedTuple):
    """Why a publisher is not blamed, and until when that holds if nothing changes.

    `accuses_som`: the SOM may be wrong; people should look.
    """

    why: str
    until: float
    accuses_som: bool = False


class Row(NamedTuple):
    """An alibi: of what it clears, when it applies, and until when it holds."""

    why: str
    clears: Tuple[Blame, ...]
    applies: Callable[[Case], bool]
    until: Callable[[Case], float] = lambda case: case.limit


_SILENCE, _RANGE = (Blame.SILENCE,), (Blame.RANGE,)
_LATE = (Blame.SILENCE, Blame.RATE, Blame.GAP, Blame.STAMP)

ROWS = (
    Row(
        "the monitor was held up, and others may have been with it",
        _SILENCE,
        lambda case: case.due > case.now,
        lambda case: case.due,
    ),
    Row(
        "its connection is made anew",
        _SILENCE,
        lambda case: case.reconnects_until > case.now,
        lambda case: case.reconnects_until,
    ),
    Row(
        "healing connected to it, or a substitute came up, which takes its time",
        _LATE,
        lambda case: case.busy + CHANGEOVER_S >= case.began,
    ),
    Row(
        "it waits for a processor, or the computer is short of processor time",
        (*_LATE, Blame.START),
        lambda case: case.short + CHANGEOVER_S >= case.began,
    ),
    Row(
        "nodes that have nothing to do with each other are late together",
        (*_LATE, Blame.START),
        lambda case: case.together >= TOGETHER_NODES,
    ),
    Row(
        "its rate was never good: `period` in the SOM may be wrong, or that of another node",
        (Blame.RATE, Blame.HASTE),
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
        (*_LATE, Blame.RANGE, Blame.VALUE),
        lambda case: case.fed_badly,
    ),
    Row(
        "nothing of the robot is there yet",
        (Blame.START,),
        lambda case: not case.robot_came,
    ),
)
NOBODY_CAME = ROWS[-1].why


def decide(case: Case) -> Optional[Alibi]:
    """Return the first alibi that holds; None: the publisher is to blame."""
    for row in ROWS:
        if case.blame in row.clears and row.applies(case) and row.until(case) > case.now:
            accuses_som = case.blame is Blame.RANGE or not case.paced
            return Alibi(row.why, row.until(case), accuses_som)
    return None
