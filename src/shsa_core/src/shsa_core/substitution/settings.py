"""The numbers by which a substitute decides; times in s."""
from dataclasses import dataclass
from typing import Tuple


@dataclass(frozen=True)
class Settings:
    """Settings of one substitute.

    shortest_step_share: of the period; a program is not evaluated again sooner, what it yielded
    last is as good. yield_s: so long a muted substitute serves those whom the original, that is
    back, does not serve yet. look_s: the least time between two looks at the original.
    withdraw_delay_s: topics that are not needed any more are withdrawn so long after a program was
    taken, and withdraw_pause_s after one another: each has others close a connection. announce_s,
    prepare_s: when after advertising one looks who has not connected, in a hurry and without.
    together_s: looks that are in no hurry are made with one that is due by so much sooner.
    gap_periods, shortest_gap_s: after such a time without a value, derivatives and the
    like start anew. misses, first_misses: evaluations in a row without a value after which a
    program says so, once it has had one and before. rest_s: muted, a program that remembers nothing
    is evaluated no more often than that: to see whether it still has a value.
    """

    shortest_step_share: float = 0.5
    yield_s: float = 1.0
    look_s: float = 0.01
    withdraw_delay_s: float = 0.2
    withdraw_pause_s: float = 0.05
    announce_s: Tuple[float, ...] = (0.05, 0.15, 0.35, 0.75, 1.55, 3.15)
    prepare_s: Tuple[float, ...] = (0.5, 1.5, 3.5)
    together_s: float = 0.5
    gap_periods: float = 10.0
    shortest_gap_s: float = 1.0
    misses: int = 2
    first_misses: int = 10
    rest_s: float = 0.25
