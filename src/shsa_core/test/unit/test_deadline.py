"""Deadlines learned from the gaps of a stream: as often exceeded as was asked for."""
from math import exp, log
from typing import Callable, List, Sequence, Tuple

import numpy as np
import pytest
from hypothesis import given, strategies as st

from shsa_core.monitoring.learned import LearnedDeadline
from shsa_core.monitoring.settings import BLOCKS, SPARE, TAIL_KEPT
from shsa_testing.thorough import many

PERIOD, FIXED, MOST = 0.02, 0.25, 1.0
SIGNIFICANCE = 1e-3


def learned(false_alarms: float = 0.01) -> LearnedDeadline:
    return LearnedDeadline(PERIOD, false_alarms, FIXED, MOST)


def heard(delays: "np.ndarray") -> List[float]:
    """The gaps of messages that are sent each period, come late by `delays`, and in order."""
    sent = PERIOD * np.arange(len(delays))
    gaps: List[float] = np.diff(np.maximum.accumulate(sent + delays)).tolist()
    return gaps


def idle(random: "np.random.RandomState", count: int) -> "np.ndarray":
    return np.abs(random.normal(0.0, 0.0003, count))


def busy(random: "np.random.RandomState", count: int) -> "np.ndarray":
    """As beside busy processes: slices of the scheduler, now and then several of them."""
    several = np.where(random.random_sample(count) < 0.002, random.uniform(0.02, 0.055, count), 0.0)
    return np.maximum(random.exponential(0.002, count), several)


def jittery(random: "np.random.RandomState", count: int) -> "np.ndarray":
    return random.exponential(0.02, count)


def bursty(random: "np.random.RandomState", count: int) -> "np.ndarray":
    """Five messages at a time, each time a little late."""
    waits = PERIOD * (4.0 - np.arange(count) % 5)
    return waits + np.repeat(random.exponential(0.008, count // 5 + 1), 5)[:count]


def wifi(random: "np.random.RandomState", count: int) -> "np.ndarray":
    """Some ms, and a stall now and then after which all that was held up comes at once."""
    stalls = random.random_sample(count) < 1.0 / 3000.0
    return random.exponential(0.003, count) + np.where(
        stalls, random.lognormal(log(0.08), 0.4, count), 0.0
    )


STREAMS = (idle, busy, jittery, bursty, wifi)
Stream = Callable[["np.random.RandomState", int], "np.ndarray"]


def alarms(deadline: LearnedDeadline, gaps: Sequence[float]) -> int:
    """Count the gaps that are blamed; those teach nothing."""
    count = 0
    for gap in gaps:
        if gap > deadline.allowed:
            count += 1
        else:
            deadline.add(gap)
    return count


def most_likely(gaps: Sequence[float], an_hour: float) -> int:
    """More false alarms than this are as good as excluded, where the rate is kept (binomial)."""
    chance = an_hour * sum(gaps) / 3600.0 / len(gaps)
    term, total, found = exp(len(gaps) * np.log1p(-chance)), 0.0, 0
    while total + term < 1.0 - SIGNIFICANCE:
        total += term
        term *= (len(gaps) - found) / (found + 1) * chance / (1.0 - chance)
        found += 1
    return found


@pytest.mark.parametrize("stream", STREAMS)
@pytest.mark.parametrize("an_hour", [1.0, 10.0])
def test_a_healthy_stream_is_blamed_as_seldom_as_was_asked_for(
    stream: Stream, an_hour: float
) -> None:
    random = np.random.RandomState(14)
    gaps = heard(stream(random, many(20) * 180000))
    deadline = learned(an_hour)
    assert alarms(deadline, gaps) <= most_likely(gaps, an_hour)
    assert deadline.is_learned


def test_each_stream_has_a_deadline_of_its_own() -> None:
    random, found = np.random.RandomState(14), []
    for stream in STREAMS:
        deadline = learned()
        alarms(deadline, heard(stream(random, 100000)))
        found.append(deadline.allowed)
    steady, loaded, *loose = found
    assert steady == loaded == FIXED < min(loose[0], loose[2])


def test_nobody_is_blamed_where_an_idle_computer_becomes_busy() -> None:
    for seed in range(many(20)):
        random, deadline = np.random.RandomState(seed), learned()
        assert alarms(deadline, heard(idle(random, 60000))) == 0
        assert alarms(deadline, heard(busy(random, 60000))) == 0


def test_a_single_late_message_of_a_steady_stream_is_not_blamed() -> None:
    deadline = learned(10.0)
    assert alarms(deadline, [PERIOD] * 15000 + [0.18]) == 0 and deadline.is_learned


def test_the_fixed_deadline_counts_until_enough_is_known() -> None:
    for an_hour, needed in ((0.01, 18000), (0.1, 1800), (10.0, 1000)):
        deadline = learned(an_hour)
        assert deadline.needed == needed
        for _ in range(needed - 1):
            assert not deadline.add(PERIOD)
        assert deadline.allowed == FIXED and f"until {needed} gaps are known" in deadline.told()
        assert not deadline.add(PERIOD) and deadline.allowed == FIXED
        told = f"learned from {needed} gaps, {an_hour:g} false alarms an hour"
        assert deadline.told() == told


def test_a_longer_gap_counts_at_once_and_is_forgotten_slowly() -> None:
    deadline = learned(10.0)
    alarms(deadline, [PERIOD] * 2000)
    assert deadline.add(0.2)
    raised = deadline.allowed
    assert raised >= SPARE * 0.2
    alarms(deadline, [PERIOD] * 90000)  # half an hour
    assert deadline.allowed >= SPARE * 0.2
    alarms(deadline, [PERIOD] * 400000)
    assert deadline.allowed == FIXED


def test_what_is_too_slow_for_a_block_is_learned_all_the_same() -> None:
    deadline = LearnedDeadline(10.0, 0.01, 50.0, 200.0)
    alarms(deadline, [10.0] * 5000)
    assert deadline.is_learned and deadline.allowed == 50.0


def test_only_one_gap_in_twenty_is_tail() -> None:
    """Half of the gaps that are kept are usual ones: they tell nothing of the long ones."""
    deadline = learned(1.0)
    alarms(deadline, [PERIOD] * 950 + [0.1 + 0.001 * number for number in range(50)])
    assert deadline.is_learned
    times = 50 * 3600.0 / (950 * PERIOD + 50 * 0.1245)
    assert deadline.allowed == pytest.approx(0.1 + 0.0245 * log(times), rel=1e-6)


def test_other_numbers_count_for_what_was_learned_before() -> None:
    deadline = learned(1.0)
    alarms(deadline, heard(jittery(np.random.RandomState(1), 2000)))
    seldom = LearnedDeadline(PERIOD, 0.1, FIXED, MOST, deadline)
    assert seldom.is_learned and seldom.allowed > deadline.allowed
    assert not LearnedDeadline(0.05, 0.1, FIXED, MOST, deadline).is_learned


GAPS = st.lists(
    st.tuples(st.floats(0.0, 5.0) | st.floats(0.0, 0.05) | st.just(PERIOD), st.integers(1, 1500)),
    max_size=20,
)


@given(GAPS, st.sampled_from((0.01, 1.0, 100.0)))
def test_whatever_comes_the_deadline_is_within_its_limits(
    runs: List[Tuple[float, int]], an_hour: float
) -> None:
    deadline = learned(an_hour)
    longest = 0.0
    for gap, times in runs:
        for _ in range(times):
            before = deadline.allowed
            assert deadline.add(gap) == (deadline.allowed != before)
        longest = max(longest, gap)
        if not deadline.is_learned:
            assert deadline.allowed == FIXED
            continue
        assert FIXED <= deadline.allowed <= MOST
        if sum(each * count for each, count in runs) < 1800.0:
            assert deadline.allowed >= min(MOST, SPARE * longest)
        oftener = LearnedDeadline(PERIOD, 10.0 * an_hour, FIXED, MOST, deadline)
        assert oftener.allowed <= LearnedDeadline(PERIOD, an_hour, FIXED, MOST, deadline).allowed
    assert sum(len(block.longest) for block in deadline._blocks) <= TAIL_KEPT * BLOCKS
