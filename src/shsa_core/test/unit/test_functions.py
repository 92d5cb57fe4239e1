"""The functions with memory: right under jitter, after a gap, at the first sample."""
import math
from collections import deque
from typing import Any, Callable, List, Tuple

import pytest
from hypothesis import given, settings, strategies as st

from shsa_core.language.functions import FUNCTIONS, STATEFUL, ceil, clip, dot
from shsa_core.language.functions import floor, rbf, sign, table
from shsa_core.language.memory import (
    HELD_SAMPLES,
    MAX_GAP_S,
    Memory,
    delay,
    derivative,
    integral,
    lowpass,
    previous,
)
from shsa_testing.thorough import many

ALL = [previous, derivative, integral]
NAN = math.nan

# Periods with jitter: the time between two samples, always within the gap that is allowed.
jitter = st.lists(st.floats(min_value=1e-3, max_value=0.5), min_size=2, max_size=40)
starts = st.floats(min_value=-1e3, max_value=1e6)
values = st.floats(min_value=-1e3, max_value=1e3)
exhaustive = settings(derandomize=True, max_examples=many(300), deadline=None)


def times(start: float, steps: List[float]) -> List[float]:
    result = [start]
    for step in steps:
        result.append(result[-1] + step)
    return result


def run(memory: Memory, signal: Callable[[float], float], moments: List[float]) -> List[float]:
    return [memory(signal(t), t) for t in moments]


@pytest.mark.parametrize("value, result", [(-3.5, -1.0), (0.0, 0.0), (-0.0, 0.0), (2.0, 1.0)])
def test_sign(value: Any, result: Any) -> None:
    assert sign(value) == result and isinstance(sign(value), float)


def test_rounding_gives_floats_however_large() -> None:
    assert floor(-1.5) == -2.0 and ceil(-1.5) == -1.0
    assert floor(1.5) == 1.0 and ceil(1.5) == 2.0
    assert isinstance(floor(1e300), float) and isinstance(ceil(1e300), float)


@pytest.mark.parametrize("name", sorted(FUNCTIONS))
def test_each_function_gives_a_float(name: str) -> None:
    function = FUNCTIONS[name]
    result = function.call(*([0.5] * function.least))
    assert isinstance(result, float)


def test_values_of_the_mathematics() -> None:
    result = {name: f.call(*[0.25, 2.0, 3.0, 4.0, 5.0][: f.least]) for name, f in FUNCTIONS.items()}
    assert result == {
        "abs": 0.25,
        "sign": 1.0,
        "min": 0.25,
        "max": 2.0,
        "floor": 0.0,
        "ceil": 1.0,
        "sqrt": 0.5,
        "exp": math.exp(0.25),
        "log": math.log(0.25),
        "log10": math.log10(0.25),
        "sin": math.sin(0.25),
        "cos": math.cos(0.25),
        "tan": math.tan(0.25),
        "asin": math.asin(0.25),
        "acos": math.acos(0.25),
        "atan": math.atan(0.25),
        "atan2": math.atan2(0.25, 2.0),
        "hypot": math.hypot(0.25, 2.0),
        "tanh": math.tanh(0.25),
        "clip": 2.0,
        "dot": 0.5,
        "rbf": math.exp(-0.25),
        "table": 3.0,
    }


@pytest.mark.parametrize("make", [previous, derivative])
def test_there_is_no_value_at_the_first_sample(make: Callable[..., Memory]) -> None:
    memory = make()
    assert math.isnan(memory(1.0, 100.0))
    assert math.isfinite(memory(1.0, 100.1))


def test_integral_and_lowpass_begin_at_the_first_sample() -> None:
    assert integral()(5.0, 100.0) == 0.0
    assert lowpass()(5.0, 2.0, 100.0) == 5.0


@exhaustive
@given(values, values, starts, jitter)
def test_derivative_of_a_ramp_is_its_slope_under_jitter(
    offset: float, slope: float, start: float, steps: List[float]
) -> None:
    moments = times(start, steps)
    results = run(derivative(), lambda t: offset + slope * (t - start), moments)[1:]
    for result, step in zip(results, steps):
        assert result == pytest.approx(slope, abs=1e-6 * (1 + abs(offset) + abs(slope)) / step)


@exhaustive
@given(values, values, starts, jitter)
def test_integral_of_a_ramp_is_exact_under_jitter(
    offset: float, slope: float, start: float, steps: List[float]
) -> None:
    moments = times(start, steps)
    results = run(integral(), lambda t: offset + slope * (t - start), moments)
    for moment, result in zip(moments, results):
        length = moment - start
        area = offset * length + 0.5 * slope * length**2
        assert result == pytest.approx(area, rel=1e-6, abs=1e-4)


@exhaustive
@given(values, values, st.floats(min_value=0.01, max_value=10.0), starts, jitter)
def test_lowpass_follows_a_step_exactly_under_jitter(
    before: float, after: float, tau: float, start: float, steps: List[float]
) -> None:
    memory = lowpass()
    moments = times(start, steps)
    memory(before, tau, moments[0])
    for moment in moments[1:]:
        result = memory(after, tau, moment)
        exact = after + (before - after) * math.exp(-(moment - start) / tau)
        assert result == pytest.approx(exact, rel=1e-6, abs=1e-6)


@exhaustive
@given(st.lists(st.tuples(values, st.floats(min_value=1e-3, max_value=0.5)), min_size=2))
def test_previous_tells_the_sample_before(samples: List[Tuple[float, float]]) -> None:
    before = previous()
    now, last_value = 50.0, None
    for value, step in samples:
        if last_value is not None:
            assert before(value, now) == last_value
        else:
            assert math.isnan(before(value, now))
        last_value = value
        now += step


@exhaustive
@given(values, st.integers(min_value=2, max_value=40))
def test_integral_does_not_depend_on_how_often_it_is_sampled(value: float, parts: int) -> None:
    whole, divided = integral(), integral()
    whole(value, 0.0)
    divided(value, 0.0)
    for i in range(1, parts + 1):
        result = divided(value, i / parts)
    assert result == pytest.approx(whole(value, 1.0), rel=1e-9, abs=1e-9)


@pytest.mark.parametrize("make", [previous, derivative])
def test_after_a_gap_it_starts_anew(make: Callable[..., Memory]) -> None:
    memory = make(max_gap=0.5)
    memory(1.0, 0.0)
    assert math.isfinite(memory(2.0, 0.5))
    assert math.isnan(memory(3.0, 1.0001))
    assert math.isfinite(memory(4.0, 1.1))


def test_what_happened_in_a_gap_is_not_added_to_the_integral() -> None:
    memory = integral(max_gap=0.5)
    memory(2.0, 0.0)
    assert memory(2.0, 0.5) == 1.0
    assert memory(1000.0, 10.0) == 1.0
    assert memory(1000.0, 10.5) == 501.0


def test_lowpass_starts_at_the_sample_after_a_gap() -> None:
    memory = lowpass(max_gap=0.5)
    memory(0.0, 1.0, 0.0)
    assert 0.0 < memory(1.0, 1.0, 0.5) < 0.5
    assert memory(7.0, 1.0, 1.1) == 7.0


def test_the_gap_is_one_second_unless_told_otherwise() -> None:
    assert MAX_GAP_S == 1.0
    memory = previous()
    memory(1.0, 0.0)
    assert memory(2.0, 1.0) == 1.0
    assert math.isnan(memory(3.0, 2.001))


@pytest.mark.parametrize("make", ALL)
def test_when_time_runs_backwards_it_starts_anew(make: Callable[..., Memory]) -> None:
    memory, fresh = make(), make()
    memory(1.0, 10.0)
    memory(2.0, 10.1)
    before = memory(3.0, 9.0)
    if make is integral:
        assert before == pytest.approx(0.15)
        assert memory(3.0, 9.1) == pytest.approx(0.45)
    else:
        assert math.isnan(before)
        fresh(3.0, 9.0)
        assert memory(4.0, 9.2) == fresh(4.0, 9.2)


@pytest.mark.parametrize("make", ALL)
def test_the_same_sample_again_changes_nothing(make: Callable[..., Memory]) -> None:
    memory, once = make(), make()
    for now in (0.0, 0.1, 0.3):
        first = memory(now * 7, now)
        again = memory(99.0, now)
        expected = once(now * 7, now)
        for result in (first, again):
            assert result == expected or math.isnan(result) and math.isnan(expected)


@pytest.mark.parametrize("bad", [math.nan, math.inf, -math.inf])
@pytest.mark.parametrize("make", ALL)
def test_a_sample_that_is_not_finite_is_no_sample(make: Callable[..., Memory], bad: Any) -> None:
    memory, without = make(), make()
    memory(1.0, 0.0)
    without(1.0, 0.0)
    assert math.isnan(memory(bad, 0.1))
    assert memory(3.0, 0.2) == without(3.0, 0.2)


def test_lowpass_needs_a_positive_time_constant() -> None:
    memory = lowpass()
    for tau in (0.0, -1.0, NAN):
        assert math.isnan(memory(1.0, tau, 0.0))
    assert memory(1.0, 0.1, 0.0) == 1.0
    assert math.isnan(memory(2.0, 0.0, 0.1))
    assert memory(2.0, 0.1, 0.2) == pytest.approx(2.0 - math.exp(-2.0))


def test_the_list_cannot_be_changed() -> None:
    with pytest.raises(AttributeError):
        setattr(FUNCTIONS["abs"], "most", 2)
    with pytest.raises(AttributeError):
        setattr(STATEFUL["previous"], "least", 2)


def test_values_of_the_functions_of_fitted_models() -> None:
    assert [clip(value, -1.0, 2.0) for value in (-3.0, -1.0, 0.5, 2.0, 9.0)] == [-1, -1, 0.5, 2, 2]
    assert clip(0.0, 2.0, 1.0) == 1.0
    assert dot(2.0, 3.0, -1.0, 4.0, 0.5, 8.0) == 6.0
    assert rbf(0.5, 1.0, 3.0, 2.0, 1.0) == math.exp(-2.5)
    assert rbf(1.0, 1e300, -1e300) == 0.0 and rbf(0.0, 1e300, -1e300) == 1.0
    with pytest.raises(OverflowError):
        rbf(-1.0, 100.0, 0.0)


def test_a_table_is_straight_between_its_points_and_held_beyond() -> None:
    points = (-1.0, 10.0, 0.0, 20.0, 4.0, 0.0)
    given_ = (-9.0, -1.0, -0.5, 0.0, 1.0, 2.0, 4.0, 99.0)
    assert [table(x, *points) for x in given_] == [10.0, 10.0, 15.0, 20.0, 15.0, 10.0, 0.0, 0.0]
    assert math.isnan(table(NAN, *points))
    assert table(1.0, 0.0, -1.7e308, 2.0, 1.7e308) == 0.0  # the difference would be too large


def test_delay_gives_what_was_that_long_ago() -> None:
    memory = delay()
    results = [memory(float(i), 0.1, 1.6e9 + 0.02 * i) for i in range(20)]
    assert results == [0.0] * 5 + [float(i) for i in range(15)]


@exhaustive
@given(starts, jitter, st.floats(min_value=1e-3, max_value=10.0))
def test_delay_holds_past_samples_under_jitter(
    start: float, steps: List[float], time: float
) -> None:
    moments = times(start, steps)
    memory = delay()
    for count, now in enumerate(moments, 1):
        result = memory(now, time, now)
        past = [each for each in moments[:count] if each <= now - time + 2e-6]
        sure = [each for each in moments[:count] if each <= now - time] or moments[:1]
        assert result <= (past[-1] if past else moments[0])
        assert result >= sure[-1] - time / HELD_SAMPLES


def test_delay_starts_anew_after_a_gap_and_ignores_what_is_no_sample() -> None:
    memory = delay(max_gap=0.5)
    assert memory(1.0, 0.2, 0.0) == 1.0
    assert memory(2.0, 0.2, 0.1) == 1.0
    assert math.isnan(memory(NAN, 0.2, 0.2)) and math.isnan(memory(math.inf, 0.2, 0.2))
    assert memory(3.0, 0.2, 0.3) == 2.0
    assert memory(9.0, 0.2, 0.3) == 2.0  # the same time again
    assert memory(4.0, 0.2, 0.9) == 4.0
    assert memory(5.0, 0.2, 1.0) == 4.0
    assert memory(6.0, 0.2, 0.5) == 6.0  # backwards


@pytest.mark.parametrize("time", [0.0, -1.0, NAN, math.inf])
def test_delay_needs_a_time_within_its_limits(time: float) -> None:
    memory = delay()
    assert math.isnan(memory(1.0, time, 0.0))
    assert memory(1.0, 1e300, 0.0) == 1.0


def test_delay_holds_so_many_samples_however_fast_they_come() -> None:
    memory = delay()
    (held,) = (c.cell_contents for c in closure(memory) if isinstance(c.cell_contents, deque))
    for i in range(40_000):
        now = 1e-3 * i
        result = memory(now, 10.0, now)
        assert result == pytest.approx(max(now - 10.0, 0.0), abs=2 * 10.0 / HELD_SAMPLES)
    assert HELD_SAMPLES / 2 < len(held) <= HELD_SAMPLES + 2


def closure(memory: Any) -> Any:
    return memory.__closure__
