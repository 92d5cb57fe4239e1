"""Random values lie within their interval, and exist where no trouble is found."""
import math
import random
from typing import List, Optional, Sequence, Tuple

from shsa_testing.expressions import NAMES, NoValue, Sample, samples
from hypothesis import assume, given, settings, strategies as st

from shsa_core.codegen.program import compile_program
from shsa_core.language.expression import parse_expression
from shsa_core.language.functions import FUNCTIONS, STATEFUL
from shsa_learning.ranges.interval import Interval
from shsa_learning.ranges.analysis import find_troubles, interval_of
from shsa_testing.thorough import many

ends = st.floats(min_value=-50.0, max_value=50.0)


@settings(derandomize=True, max_examples=many(800), deadline=None)
@given(samples(), st.lists(ends, min_size=6, max_size=6), st.integers())
def test_values_lie_within_the_interval_and_exist_where_no_trouble_is_found(
    sample: Sample, bounds: List[float], seed: int
) -> None:
    """Without a warning every value is a finite number."""
    choice = random.Random(seed)
    ranges = {
        name: Interval(
            min(bounds[2 * index : 2 * index + 2]), max(bounds[2 * index : 2 * index + 2])
        )
        for index, name in enumerate(NAMES)
    }
    law = parse_expression(sample.text)
    tree = law.tree()
    found = interval_of(tree, ranges)
    trouble = find_troubles(law, ranges)
    for _ in range(20):
        values = {name: _pick(choice, ranges[name]) for name in NAMES}
        try:
            value = sample.meaning(values)
        except NoValue:
            value = math.nan
        assert math.isfinite(value) or trouble
        if not trouble:
            slack = 1e-9 * (1.0 + abs(value))
            assert found.low - slack <= value <= found.high + slack


def _pick(choice: random.Random, interval: Interval) -> float:
    kind = choice.randrange(4)
    if kind == 0 and interval.has_zero:
        return 0.0
    return {1: interval.low, 2: interval.high}.get(
        kind, choice.uniform(interval.low, interval.high)
    )


FUNCTION_NAMES = sorted(n for n in set(FUNCTIONS) - {"min", "max"} if FUNCTIONS[n].least < 3)


@settings(derandomize=True, max_examples=many(1500), deadline=None)
@given(st.sampled_from(FUNCTION_NAMES), st.lists(ends, min_size=4, max_size=4), st.integers())
def test_the_image_of_every_function_contains_its_values(
    name: str, bounds: List[float], seed: int
) -> None:
    """Wherever the function has a value, and it has one everywhere where nothing is warned of."""
    function = FUNCTIONS[name]
    scale = {"asin": 0.05, "acos": 0.05, "exp": 20.0}.get(name, 1.0)
    pairs = (sorted(scale * bound for bound in bounds[:2]), sorted(bounds[2:]))
    ranges = [Interval(min(pair), max(pair)) for pair in pairs][: function.least]
    names = NAMES[: function.least]
    text = f"{name}({', '.join(names)})"
    law = parse_expression(text)
    tree = law.tree()
    image = interval_of(tree, dict(zip(names, ranges)))
    trouble = find_troubles(law, dict(zip(names, ranges)))
    choice = random.Random(seed)
    for _ in range(20):
        values = [_pick(choice, each) for each in ranges]
        try:
            value = function.call(*values)
        except (ValueError, OverflowError):
            value = math.nan
        assert math.isfinite(value) or trouble
        if not trouble:
            assert within(value, image) and (value != 0.0 or image.has_zero)


@settings(derandomize=True, max_examples=many(800), deadline=None)
@given(st.sampled_from(sorted(STATEFUL)), st.lists(ends, min_size=2, max_size=2), st.integers())
def test_the_image_of_every_function_with_memory_contains_its_values(
    name: str, bounds: List[float], seed: int
) -> None:
    """Save integrals, which grow with the time."""
    choice = random.Random(seed)
    values = Interval(min(bounds), max(bounds))
    text = f"{name}(a{', 0.3' * (STATEFUL[name].least - 1)})"
    image = interval_of(parse_expression(text).tree(), {"a": values})
    memory = STATEFUL[name].call(1.0)
    now = 0.0
    for _ in range(20):
        now += choice.uniform(0.01, 0.5)
        value = memory(_pick(choice, values), *[0.3] * (STATEFUL[name].least - 1), now)
        assert math.isnan(value) or within(value, image)


def within(value: float, image: Interval) -> bool:
    slack = 1e-9 * (1.0 + abs(value))
    return image.low - slack <= value <= image.high + slack


@settings(derandomize=True, max_examples=many(1500), deadline=None)
@given(
    st.sampled_from(["//", "%", "**", "/", "*", "-", "+"]),
    st.lists(ends, min_size=4, max_size=4),
    st.one_of(st.none(), st.integers(-4, 4)),
    st.integers(),
)
def test_the_image_of_every_operation_contains_its_values(
    sign: str, bounds: Sequence[float], exponent: Optional[int], seed: int
) -> None:
    one = Interval(min(bounds[:2]), max(bounds[:2]))
    other = Interval(min(bounds[2:]), max(bounds[2:]))
    if exponent is not None:
        other = Interval(exponent, exponent)
    law = parse_expression(f"a {sign} b")
    tree = law.tree()
    image = interval_of(tree, {"a": one, "b": other})
    trouble = find_troubles(law, {"a": one, "b": other})
    step = compile_program(
        f"t0=x[0]; t1=x[1];\ndef _tf1(i1,i2):\n  return i1 {sign} i2\nt2=_tf1(t0,t1)\ny=t2\n", 2, 1
    ).step
    choice = random.Random(seed)
    for _ in range(20):
        result = step((_pick(choice, one), _pick(choice, other)), 0.0)
        assert result is not None or trouble
        if result is not None and not trouble:
            assert within(result[0], image) and (result[0] != 0.0 or image.has_zero)


FITTED = ["clip", "dot", "rbf", "table"]
small = st.floats(min_value=-4.0, max_value=4.0)


@settings(derandomize=True, max_examples=many(1500), deadline=None)
@given(
    st.sampled_from(FITTED),
    st.lists(st.tuples(small, small), min_size=9, max_size=9),
    st.integers(0, 2),
    st.integers(),
)
def test_the_images_of_functions_of_fitted_models_contain_their_values(
    name: str, bounds: List[Tuple[float, float]], more: int, seed: int
) -> None:
    function = FUNCTIONS[name]
    count = function.least + (more * function.each if function.most is None else 0)
    ranges = [Interval(min(pair), max(pair)) for pair in bounds[:count]]
    if name == "table":
        xs = sorted({round(pair[0], 1) for pair in bounds})[: count // 2]
        assume(len(xs) == count // 2)
        ranges[1::2] = [Interval(x, x) for x in xs]
    names = [f"v{i}" for i in range(count)]
    known = dict(zip(names, ranges))
    text = f"{name}({', '.join(names)})"
    law = parse_expression(text)
    tree = law.tree()
    image, trouble = interval_of(tree, known), find_troubles(law, known)
    assert image.known
    choice = random.Random(seed)
    for _ in range(20):
        value = function.call(*(_pick(choice, each) for each in ranges))
        assert math.isfinite(value) and not trouble
        assert within(value, image) and (value != 0.0 or image.has_zero)
