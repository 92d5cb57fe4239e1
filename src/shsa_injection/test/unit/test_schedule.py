"""The schedule of chaos: the same for the same seed, over all faults; and durations."""
import argparse
import itertools
from collections import Counter
from typing import List

import pytest

from shsa_injection.cli._common import duration
from shsa_injection.schedule import MASTER, Step, cards, schedule

POSSIBLE = {
    "current": ["crash", "stuck", "nan"],
    "odometry": ["crash", "hang"],
    "acceleration": ["crash", "slow"],
    MASTER: ["master_restart"],
}
NODES = {"current": "/meter", "odometry": "/wheels", "acceleration": "/wheels", MASTER: MASTER}
DECK = cards(POSSIBLE, NODES)


def steps(seed: int, count: int = 60) -> List[Step]:
    return list(itertools.islice(schedule(seed, DECK), count))


def test_the_same_seed_makes_the_same_schedule() -> None:
    assert steps(5) == steps(5)
    assert steps(5) != steps(6)
    assert steps(5, 10) == steps(5)[:10]


def test_every_fault_comes_before_any_comes_again() -> None:
    made = [(each.target, each.fault) for step in steps(1, 200) for each in step.faults]
    every = {(card.target, card.fault) for card in DECK}
    for start in range(0, 80, len(DECK)):
        assert set(made[start : start + len(DECK)]) == every


def test_some_steps_have_faults_of_two_nodes_and_the_master_is_alone() -> None:
    for seed in range(10):
        sizes = Counter(len(step.faults) for step in steps(seed))
        assert set(sizes) == {1, 2} and sizes[2] > 5
        for step in steps(seed):
            nodes = [NODES[each.target] for each in step.faults]
            assert len(set(nodes)) == len(nodes)
            assert MASTER not in nodes or nodes == [MASTER]


def test_numbers_count_and_times_are_within_their_limits() -> None:
    for place, step in enumerate(steps(3)):
        assert step.number == place + 1
        for each in step.faults:
            assert 0.0 <= each.after <= 0.2
            assert 0.1 <= each.seconds <= 4.0


def test_nothing_possible_makes_no_step() -> None:
    assert list(schedule(1, [])) == []


@pytest.mark.parametrize(
    "text, value",
    [("5s", 5.0), ("200ms", 0.2), ("1.5min", 90.0), ("2", 2.0), (".5s", 0.5), ("1h", 3600.0)],
)
def test_a_duration(text: str, value: float) -> None:
    assert duration(text) == pytest.approx(value)


@pytest.mark.parametrize("text", ["", "s", "-1s", "0s", "nan", "inf", "5 s s", "1e3s", "5x", "٣s"])
def test_what_is_no_duration_is_refused(text: str) -> None:
    with pytest.raises(argparse.ArgumentTypeError, match="is no duration above 0"):
        duration(text)
