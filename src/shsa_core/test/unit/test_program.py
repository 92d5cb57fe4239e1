"""Compiled substitutes: values, no values, time, and what they cost."""
import math
import re
import sys
from typing import Any, Optional, Tuple

import pytest
from shsa_testing.expressions import NAMES, NoValue, Sample, samples
from hypothesis import assume, given, settings, strategies as st

from shsa_core.codegen.program import CompiledProgram, compile_program
from shsa_testing.thorough import many

finite = st.floats(min_value=-1e3, max_value=1e3)


def program(
    text: str, constraint: Optional[str] = None, n_inputs: int = 1, **options: Any
) -> CompiledProgram:
    """A program of one relation over i1, i2, ..."""
    inputs = " ".join(f"t{i}=x[{i}];" for i in range(n_inputs))
    parameters = ",".join(f"i{i + 1}" for i in range(n_inputs))
    arguments = ",".join(f"t{i}" for i in range(n_inputs))
    require = f"  require({constraint})\n" if constraint else ""
    code = (
        f"{inputs}\ndef _tf1({parameters}):\n{require}  return {text}\n"
        f"t{n_inputs}=_tf1({arguments})\ny=t{n_inputs}\n"
    )
    return compile_program(code, n_inputs, 1, **options)


def value(text: str, *x: float) -> Optional[float]:
    result = program(text, n_inputs=len(x)).step(x, 0.0)
    return None if result is None else result[0]


@pytest.mark.parametrize(
    "text, x, result",
    [
        ("i1 + i2", (1.0, 2.0), 3.0),
        ("i1 - i2", (1.0, 2.0), -1.0),
        ("i1*i2", (3.0, 2.0), 6.0),
        ("i1/i2", (3.0, 2.0), 1.5),
        ("i1//i2", (7.0, 2.0), 3.0),
        ("i1 % i2", (7.0, 4.0), 3.0),
        ("i1**2 + i2*0", (-3.0, 0.0), 9.0),
        ("i1**-1 + i2*0", (4.0, 0.0), 0.25),
        ("i1**0.5 + i2*0", (9.0, 0.0), 3.0),
        ("i1**(1/2) + i2*0", (9.0, 0.0), 3.0),
        ("i1**i2", (2.0, 3.0), 8.0),
        ("i1**i2", (2.0, -0.5), 2.0**-0.5),
        ("-i1 + +i2", (2.0, 3.0), 1.0),
        ("min(i1, i2, 5)", (7.0, 6.0), 5.0),
        ("max(i1, i2, 5)", (7.0, 6.0), 7.0),
        ("pi*i1 + i2", (2.0, 0.0), 2 * math.pi),
        ("floor(i1) + ceil(i2)", (1.5, 1.5), 3.0),
        ("sign(i1) + sign(i2)", (-4.0, 0.0), -1.0),
        ("hypot(i1, i2)", (3.0, 4.0), 5.0),
        ("atan2(i1, i2)", (1.0, -1.0), math.atan2(1.0, -1.0)),
        ("log(i1) + log10(i2)", (math.e, 100.0), 3.0),
        ("i1 if i2 > 0 else -i1", (2.0, 1.0), 2.0),
        ("i1 if i2 > 0 else -i1", (2.0, 0.0), -2.0),
        ("i1 if 0 < i2 < 3 else 9", (2.0, 2.0), 2.0),
        ("i1 if 0 < i2 < 3 else 9", (2.0, 3.0), 9.0),
        ("i1 if i2 > 1 and i1 > 1 else 9", (2.0, 2.0), 2.0),
        ("i1 if i2 > 1 or i1 > 9 else 9", (2.0, 1.0), 9.0),
        ("i1 if not i2 > 1 else 9", (2.0, 1.0), 2.0),
        ("i1 if i2 == 1 else 9", (2.0, 1.0), 2.0),
        ("i1 if i2 != 1 else 9", (2.0, 1.0), 9.0),
        ("i1 if i2 >= 1 else 9", (2.0, 1.0), 2.0),
        ("i1 if i2 <= 1 else 9", (2.0, 1.0), 2.0),
        ("1/i1 if i1 != 0 else i2", (0.0, 7.0), 7.0),
    ],
)
def test_values(text: str, x: Tuple[float, ...], result: float) -> None:
    assert value(text, *x) == pytest.approx(result, rel=1e-12)


@pytest.mark.parametrize(
    "text, x",
    [
        ("1/i1", 0.0),
        ("1//i1", 0.0),
        ("1 % i1", 0.0),
        ("i1**-1", 0.0),
        ("i1**-0.5", 0.0),
        ("sqrt(i1)", -1.0),
        ("log(i1)", 0.0),
        ("asin(i1)", 1.5),
        ("exp(i1)", 1000.0),
        ("i1**100", 1e10),
        ("i1*i1", 1e200),
        ("i1*i1 - i1*i1", 1e200),
        ("i1**0.5", -8.0),
        ("i1**(1/3)", -8.0),
        ("(-8 + 0*i1)**(1/3)", 0.0),
        ("i1", math.nan),
        ("i1", math.inf),
        ("i1", -math.inf),
        ("1 if i1 > 0 else 2", math.nan),
        ("min(i1, 3)", math.inf),
        ("max(3, i1)", math.nan),
        ("1/i1", math.inf),
        ("floor(i1*i1)", 1e200),
    ],
)
def test_no_value_where_there_is_none(text: str, x: float) -> None:
    step = program(text).step
    assert step((x,), 0.0) is None
    assert step((x,), 1.0) is None


def test_an_input_that_is_not_finite_leaves_no_output_even_if_the_other_is() -> None:
    step = program("i1 + i2", n_inputs=2).step
    assert step((1.0, math.nan), 0.0) is None
    assert step((math.nan, 1.0), 0.0) is None
    assert step((math.inf, -math.inf), 0.0) is None
    assert step((1.0, 1.0), 0.0) == (2.0,)


def test_a_value_passed_on_must_be_finite() -> None:
    step = compile_program("t0=x[0];\ny=t0\n", 1, 1).step
    assert step((2.5,), 0.0) == (2.5,)
    assert step((math.nan,), 0.0) is None
    assert step((math.inf,), 0.0) is None


def test_whole_numbers_are_taken_too() -> None:
    assert program("i1/2").step([3], 0.0) == (1.5,)
    assert program("i1**i1").step([3], 0.0) == (27.0,)


def test_the_number_of_inputs_must_fit() -> None:
    for x in ((), (1.0, 2.0)):
        with pytest.raises(ValueError):
            program("i1").step(x, 0.0)


def test_where_the_constraint_is_false_there_is_no_output() -> None:
    step = program("i1", constraint="i1 > 10").step
    assert step((10.0,), 0.0) is None
    assert step((10.1,), 0.0) == (10.1,)


def test_a_constraint_guards_the_function() -> None:
    step = program("1/i1", constraint="i1 > 0 and log(i1) < 5").step
    assert step((0.0,), 0.0) is None
    assert step((2.0,), 0.0) == (0.5,)


def test_a_constraint_without_a_value_is_not_met() -> None:
    assert program("i1", constraint="1/i1 > 0 or i1 < 5").step((0.0,), 0.0) is None


TWO = (
    "t0=x[0]; t1=x[1];\n"
    "def _tf1(i1): # one: a\n  require(i1 > 0)\n  return integral(i1)\n"
    "t2=_tf1(t0)\n"
    "def _tf2(i1): # two: b\n  return integral(i1)\n"
    "t3=_tf2(t1)\n"
    "y=(t2,t3)\n"
)


def test_all_outputs_or_none() -> None:
    program = compile_program(TWO, 2, 2)
    assert program.step((1.0, 1.0), 0.0) == (0.0, 0.0)
    assert program.step((-1.0, 1.0), 0.5) is None
    assert program.step((1.0, math.nan), 0.5) is None


def test_a_stateful_function_sees_every_sample_whatever_others_do() -> None:
    program = compile_program(TWO, 2, 2, max_gap=0.5)
    program.step((1.0, 1.0), 0.0)
    for i in range(1, 20):  # the constraint of the first is false for two seconds
        assert program.step((-1.0, 1.0), i * 0.1) is None
    assert program.step((1.0, 1.0), 2.0) == pytest.approx((-1.8, 2.0))
    for i in range(1, 20):  # the first has no input for two seconds: a gap for it alone
        assert program.step((math.nan, 1.0), 2.0 + i * 0.1) is None
    assert program.step((1.0, 1.0), 4.0) == pytest.approx((-1.8, 4.0))


def test_every_use_of_a_stateful_function_has_its_own_memory() -> None:
    code = (
        "t0=x[0]; t1=x[1];\n"
        "def _tf1(i1): # r: a\n  return previous(i1)\n"
        "t2=_tf1(t0)\n"
        "def _tf2(i1): # r: b\n  return previous(i1) + 10*previous(i1*2)\n"
        "t3=_tf2(t1)\n"
        "y=(t2,t3)\n"
    )
    step = compile_program(code, 2, 2).step
    assert step((1.0, 5.0), 0.0) is None
    assert step((2.0, 6.0), 0.1) == (1.0, 105.0)
    assert step((3.0, 7.0), 0.2) == (2.0, 126.0)


def test_two_programs_of_one_code_do_not_share_memory() -> None:
    one, other = program("integral(i1)"), program("integral(i1)")
    one.step((1.0,), 0.0)
    one.step((1.0,), 1.0)
    other.step((1.0,), 0.0)
    assert one.step((1.0,), 2.0) == (2.0,)
    assert other.step((1.0,), 1.0) == (1.0,)


def test_a_stateful_function_sees_its_samples_while_another_has_none() -> None:
    step = program("integral(i2) + previous(1/i1)", n_inputs=2).step
    assert step((1.0, 1.0), 0.0) is None
    assert step((0.0, 1.0), 0.5) is None
    assert step((0.0, 1.0), 1.0) is None
    assert step((2.0, 1.0), 1.5) is None  # the sample before the last is too old for previous
    assert step((2.0, 1.0), 2.0) == (2.5,)


def test_no_output_until_a_stateful_function_has_its_samples() -> None:
    step = program("derivative(derivative(i1)) + dt").step
    squares = [(0.1 * i) ** 2 for i in range(5)]
    results: Any = [step((squares[i],), 0.1 * i) for i in range(5)]
    assert results[:2] == [None, None]
    assert [r[0] for r in results[2:]] == pytest.approx([2.1, 2.1, 2.1])


def test_a_comparison_does_not_hide_that_a_sample_is_missing() -> None:
    step = program("1 if derivative(i1) > 0 else 2").step
    assert step((1.0,), 0.0) is None
    assert step((2.0,), 0.1) == (1.0,)
    step = program("1 if dt > 0 else 2 + 0*i1").step
    assert step((1.0,), 0.0) is None
    assert step((2.0,), 0.1) == (1.0,)


def test_stateful_functions_in_a_constraint() -> None:
    step = program("i1", constraint="abs(derivative(i1)) < 5").step
    assert step((0.0,), 0.0) is None
    assert step((0.1,), 0.1) == (0.1,)
    assert step((9.0,), 0.2) is None
    assert step((9.1,), 0.3) == (9.1,)


def test_dt_is_the_time_since_the_last_evaluation() -> None:
    step = program("i1*dt").step
    assert step((2.0,), 10.0) is None
    assert step((2.0,), 10.5) == (1.0,)
    assert step((math.nan,), 10.7) is None
    assert step((2.0,), 10.8) == pytest.approx((0.2,))
    assert step((2.0,), 12.0) is None  # a gap
    assert step((2.0,), 12.25) == (0.5,)
    assert step((2.0,), 11.0) is None  # back in time
    assert step((2.0,), 11.25) == (0.5,)


def test_the_gap_that_is_allowed_can_be_set() -> None:
    step = program("derivative(i1)*1 + 0*dt", max_gap=10.0).step
    step((0.0,), 0.0)
    assert step((5.0,), 5.0) == (1.0,)
    assert step((25.0,), 15.1) is None


def test_lowpass_with_an_argument_of_its_own() -> None:
    step = program("lowpass(i1, i2)", n_inputs=2).step
    assert step((1.0, 0.5), 0.0) == (1.0,)
    assert step((3.0, 0.5), 0.5) == pytest.approx((3.0 - 2.0 / math.e,))
    assert step((3.0, 0.0), 0.6) is None
    assert step((3.0, -1.0), 0.7) is None


def test_a_relation_without_inputs() -> None:
    code = "def _tf1(): # r: a\n  require(dt > 0.05)\n  return 2*pi\nt0=_tf1()\ny=t0\n"
    step = compile_program(code, 0, 1).step
    assert step((), 0.0) is None
    assert step((), 0.1) == (2 * math.pi,)
    assert step((), 0.11) is None


def test_a_failing_relation_does_not_stop_those_that_do_not_need_it() -> None:
    code = (
        "t0=x[0];\n"
        "def _tf1(i1): # r: a\n  return 1/i1\n"
        "t1=_tf1(t0)\n"
        "def _tf2(i1): # s: b\n  return integral(i1)\n"
        "t2=_tf2(t0)\n"
        "y=(t1,t2)\n"
    )
    step = compile_program(code, 1, 2).step
    assert step((2.0,), 0.0) == (0.5, 0.0)
    assert step((0.0,), 0.5) is None
    assert step((2.0,), 1.0) == (0.5, 1.0)


def test_a_relation_gets_no_input_that_has_no_value() -> None:
    code = (
        "t0=x[0];\n"
        "def _tf1(i1): # r: a\n  return sqrt(i1)\n"
        "t1=_tf1(t0)\n"
        "def _tf2(i1): # s: b\n  return 1 if i1 > 2 else 0\n"
        "t2=_tf2(t1)\n"
        "y=t2\n"
    )
    step = compile_program(code, 1, 1).step
    assert step((9.0,), 0.0) == (1.0,)
    assert step((1.0,), 0.0) == (0.0,)
    assert step((-1.0,), 0.0) is None


PAPER = """t0=x[0]; t1=x[1]; t2=x[2]; t3=x[3]; t4=x[4];
def _tf1(i1,i2,i3,i4,i5):
    o = 48.67 - 0.03*abs(i1) - 1.17*abs(i2) \\
        + 2.07*abs(i3) - 0.03*abs(i4) \\
        - 3.72*i5
    return o
t5=_tf1(t0,t1,t2,t3,t4)
y=t5
"""


@settings(derandomize=True, max_examples=many(100), deadline=None)
@given(finite, finite, finite, finite, finite)
def test_the_listing_of_the_paper(v: float, a: float, w: float, e: float, u: float) -> None:
    step = compile_program(PAPER, 5, 1).step
    result = 48.67 - 0.03 * abs(v) - 1.17 * abs(a) + 2.07 * abs(w) - 0.03 * abs(e) - 3.72 * u
    assert step((v, a, w, e, u), 0.0) == (result,)


def steps(*body: str, **options: Any) -> Any:
    """The step of a program of one relation over i1 with these lines."""
    lines = "".join(f"  {line}\n" for line in body)
    code = f"t0=x[0];\ndef _tf1(i1):\n{lines}t1=_tf1(t0)\ny=t1\n"
    return compile_program(code, 1, 1, **options).step


def test_values_on_the_way_are_used_as_often_as_wanted() -> None:
    step = steps("o=i1+1", "p=o*o", "q=p-o", "return q*p+o")
    assert step((2.0,), 0.0) == (6.0 * 9.0 + 3.0,)
    doubled = [f"s{i}=s{i - 1}+s{i - 1}" for i in range(1, 100)]
    assert steps("s0=i1", *doubled, "return s99")((1.0,), 0.0) == (2.0**99,)


def test_without_a_value_on_the_way_there_is_none_at_the_end() -> None:
    step = steps("o=1/i1", "return 1 if o > 0 else 2")
    assert step((0.0,), 0.0) is None
    assert step((-2.0,), 0.0) == (2.0,)
    step = steps("o=i1*i1", "p=1 if o > 0 else 2", "return p")
    assert step((1e200,), 0.0) is None
    assert step((2.0,), 0.0) == (1.0,)


def test_a_constraint_guards_values_on_the_way() -> None:
    step = steps("require(i1 > 1)", "o=2*i1", "return o")
    assert step((1.0,), 0.0) is None
    assert step((2.0,), 0.0) == (4.0,)


def test_a_stateful_function_sees_every_value_on_the_way() -> None:
    step = steps("require(i1 > 0)", "o=2*i1", "p=integral(o)", "return p + dt*0")
    assert step((1.0,), 0.0) is None
    assert step((1.0,), 0.5) == (1.0,)
    assert step((-1.0,), 1.0) is None
    assert step((1.0,), 1.5) == (1.0,)  # what was seen while the constraint was false counts


def test_a_stateful_function_takes_no_sample_where_there_is_no_value() -> None:
    step = steps("o=1/i1", "p=1 if o > 0 else 2", "return integral(p) + 0*i1")
    assert step((1.0,), 0.0) == (0.0,)
    assert step((0.0,), 0.5) is None
    assert step((1.0,), 1.0) == (1.0,)
    step = steps("o=derivative(i1)", "p=1 if o > 0 else 3", "return integral(p)")
    assert step((0.0,), 0.0) is None
    assert step((1.0,), 0.5) == (0.0,)
    assert step((2.0,), 1.0) == (0.5,)


@settings(derandomize=True, max_examples=many(300), deadline=None)
@given(samples(), finite, finite, finite)
def test_a_value_on_the_way_means_what_it_stands_for(
    sample: Sample, a: float, b: float, c: float
) -> None:
    parameters = dict(zip(NAMES, ("i1", "i2", "i3")))
    text = re.sub(r"\b[abc]\b", lambda name: parameters[name.group()], sample.text)
    inputs = "t0=x[0]; t1=x[1]; t2=x[2];\ndef _tf1(i1,i2,i3):\n  z = i1 + i2 + i3\n"
    code = f"{inputs}  o = {text} \\\n    + 0*z\n  return o\nt3=_tf1(t0,t1,t2)\ny=t3\n"
    direct = program(f"{text} + 0*(i1 + i2 + i3)", n_inputs=3).step
    assert compile_program(code, 3, 1).step((a, b, c), 0.0) == direct((a, b, c), 0.0)


def test_compiled_code_reaches_no_builtins() -> None:
    names = program("i1 + abs(i1)").step.__globals__
    assert names["__builtins__"] == {}
    assert not {"eval", "exec", "open", "sys", "os"} & set(names)


def test_only_what_is_needed_is_compiled() -> None:
    without, using = program("i1*2").step.__code__, program("i1*dt").step.__code__
    assert "dt" not in without.co_varnames and "dt" in using.co_varnames
    assert without.co_filename == "<substitute>"
    assert "dt" in program("i1", constraint="dt > 0").step.__code__.co_varnames


@settings(derandomize=True, max_examples=many(600), deadline=None)
@given(samples(), finite, finite, finite)
def test_random_expressions_mean_what_they_say(
    sample: Sample, a: float, b: float, c: float
) -> None:
    parameters = dict(zip(NAMES, ("i1", "i2", "i3")))
    text = re.sub(r"\b[abc]\b", lambda name: parameters[name.group()], sample.text)
    step = program(f"({text}) + 0*(i1 + i2 + i3)", n_inputs=3).step
    result = step((a, b, c), 0.0)
    try:
        expected = sample.meaning(dict(a=a, b=b, c=c))
    except NoValue:
        assert result is None
        return
    assume(not math.isnan(expected))
    if math.isfinite(expected):
        assert result is not None
        assert result[0] == pytest.approx(expected, rel=1e-9, abs=1e-9)
    else:
        assert result is None


def test_deep_and_long_programs_are_compiled() -> None:
    assert value("i1" + " + i1" * 98, 1.0) == 99.0
    assert value("-" * 99 + "i1", 1.0) == -1.0
    assert sys.getrecursionlimit() >= 1000
