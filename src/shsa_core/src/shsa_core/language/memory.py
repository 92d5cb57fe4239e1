"""Functions that remember earlier samples."""
import math
from collections import deque
from typing import Callable, Deque, Iterable, List, Optional, Tuple

from shsa_core.watch import INSTANT_S

MAX_GAP_S, GAP_PERIODS = 1.0, 10.0
HELD_SAMPLES = 1000
"""The most samples that a delay holds."""
NO_VALUE = math.nan

Memory = Callable[..., float]
"""One use of a stateful function: called with its arguments and the time `now` (s).

It returns a float, or NaN for "no value". A sample that is not finite is ignored. A sample at the
time of the last one is the same sample: the result is the same and nothing changes. After a gap of
more than `max_gap` (s), or when time runs backwards, the function starts anew. Each is one flat
function: a call inside would double its cost.
"""


def longest_gap(period: Optional[float]) -> float:
    """Return the time in s without a value after which functions start anew."""
    return math.inf if period is None else max(MAX_GAP_S, GAP_PERIODS * period)


def sample_times(came: Iterable[Optional[float]], now: float) -> Tuple[float, ...]:
    """Return when samples came, in s; None: a value that holds until the next one.

    That is as old as the oldest of the others, so that it makes none newer; alone, of now.
    """
    found = list(came)
    oldest = min((each for each in found if each is not None), default=now)
    return tuple(oldest if each is None else each for each in found)


def unwrapped() -> Callable[[float], float]:
    """Make what follows an angle in rad, by the shorter way from one sample to the next."""
    last = 0.0

    def follow(value: float) -> float:
        nonlocal last
        if value - value != 0.0:
            return NO_VALUE
        last += math.remainder(value - last, math.tau)
        return last

    return follow


def previous(max_gap: float = MAX_GAP_S) -> Memory:
    """Make `previous(x)`: the sample before."""
    last = before = result = NO_VALUE

    def sample(value: float, now: float) -> float:
        nonlocal last, before, result
        if value - value != 0.0:
            return NO_VALUE
        passed = now - last
        if passed != 0.0:
            result = before if 0.0 < passed <= max_gap else NO_VALUE
            last = now
            before = value
        return result

    return sample


def derivative(max_gap: float = MAX_GAP_S, least: float = 0.0) -> Memory:
    """Make `derivative(x)`: the change since the sample before, per second.

    A sample less than `least` s after the last one is left out.
    """
    last = before = result = NO_VALUE

    def sample(value: float, now: float) -> float:
        nonlocal last, before, result
        if value - value != 0.0:
            return NO_VALUE
        passed = now - last
        if not 0.0 <= passed < least and passed != 0.0:
            result = (value - before) / passed if 0.0 < passed <= max_gap else NO_VALUE
            last = now
            before = value
        return result

    return sample


def integral(max_gap: float = MAX_GAP_S, total: Optional[List[float]] = None) -> Memory:
    """Make `integral(x)`: the area under the samples since the start, by the trapezoidal rule.

    `total` holds the sum, and may be set. A gap adds nothing; after one an overflow starts anew.
    """
    last = before = NO_VALUE
    sum_ = [0.0] if total is None else total

    def sample(value: float, now: float) -> float:
        nonlocal last, before
        if value - value != 0.0:
            return NO_VALUE
        passed = now - last
        if passed != 0.0:
            if 0.0 < passed <= max_gap:
                sum_[0] += 0.5 * (before + value) * passed
            elif sum_[0] - sum_[0] != 0.0:
                sum_[0] = 0.0
            last = now
            before = value
        return sum_[0]

    return sample


def lowpass(max_gap: float = MAX_GAP_S) -> Memory:
    """Make `lowpass(x, tau)`: x behind a first-order filter with time constant `tau` (s, positive).

    It starts at the first sample. Between two samples it takes x to be the later one.
    """
    last = result = NO_VALUE

    def sample(value: float, tau: float, now: float) -> float:
        nonlocal last, result
        if value - value != 0.0 or not tau > 0.0:
            return NO_VALUE
        passed = now - last
        if passed != 0.0:
            if 0.0 < passed <= max_gap:
                result += (value - result) * -math.expm1(-passed / tau)
            else:
                result = value
            last = now
        return result

    return sample


def delay(max_gap: float = MAX_GAP_S) -> Memory:
    """Make `delay(x, time)`: x as it was `time` ago (s, above 0), or the oldest one while none is.

    It holds HELD_SAMPLES at most, so that it may be older by one part in HELD_SAMPLES.
    """
    last = result = NO_VALUE
    held: Deque[Tuple[float, float]] = deque()

    def sample(value: float, time: float, now: float) -> float:
        nonlocal last, result
        if value - value != 0.0 or not 0.0 < time < math.inf:
            return NO_VALUE
        passed = now - last
        if passed != 0.0:
            if not 0.0 < passed <= max_gap:
                held.clear()
            if not held or now - held[-1][0] >= time / HELD_SAMPLES:
                held.append((now, value))
            before = now - time + INSTANT_S
            while len(held) > 1 and held[1][0] <= before:
                held.popleft()
            result = held[0][1]
            last = now
        return result

    return sample
