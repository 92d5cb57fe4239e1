"""The functions that remember earlier samples."""
import math
from typing import Callable

MAX_GAP_S = 1.0
NO_VALUE = math.nan

Memory = Callable[..., float]
"""A stateful function at one place of a program: called with its arguments and the time `now` (s).

It returns a float, or NaN for "no value". A sample that is not finite is no sample. A sample at the
time of the one before is the same sample: the result is the same and nothing changes. After a gap
of more than `max_gap` (s), or when time runs backwards, the function starts anew. Each is one flat
function: a call inside would double its cost.
"""


def elapsed(max_gap: float = MAX_GAP_S) -> Memory:
    """`dt`: seconds since the last evaluation; its argument is not used."""
    last = result = NO_VALUE

    def sample(value: float, now: float) -> float:
        nonlocal last, result
        if value - value != 0.0:
            return NO_VALUE
        passed = now - last
        if passed != 0.0:
            result = passed if 0.0 < passed <= max_gap else NO_VALUE
            last = now
        return result

    return sample


def previous(max_gap: float = MAX_GAP_S) -> Memory:
    """`previous(x)`: the sample before."""
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


def derivative(max_gap: float = MAX_GAP_S) -> Memory:
    """`derivative(x)`: the change since the sample before, per second."""
    last = before = result = NO_VALUE

    def sample(value: float, now: float) -> float:
        nonlocal last, before, result
        if value - value != 0.0:
            return NO_VALUE
        passed = now - last
        if passed != 0.0:
            result = (value - before) / passed if 0.0 < passed <= max_gap else NO_VALUE
            last = now
            before = value
        return result

    return sample


def integral(max_gap: float = MAX_GAP_S) -> Memory:
    """`integral(x)`: the area under the samples since the start, in seconds times x.

    By the trapezoidal rule.

    It starts at 0. What happened during a gap is not known and is not added. A sum that has
    overflowed starts anew with it.
    """
    last = before = NO_VALUE
    result = 0.0

    def sample(value: float, now: float) -> float:
        nonlocal last, before, result
        if value - value != 0.0:
            return NO_VALUE
        passed = now - last
        if passed != 0.0:
            if 0.0 < passed <= max_gap:
                result += 0.5 * (before + value) * passed
            elif result - result != 0.0:
                result = 0.0
            last = now
            before = value
        return result

    return sample


def lowpass(max_gap: float = MAX_GAP_S) -> Memory:
    """`lowpass(x, tau)`: x behind a first-order filter with time constant `tau` (s, positive).

    It starts at the first sample. Between two samples x is taken to hold the later one, which the
    filter follows exactly, whatever the time between them.
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
