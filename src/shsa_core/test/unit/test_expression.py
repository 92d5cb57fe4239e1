"""The language of expressions: what is read, what is refused, and that nothing is ever run."""
import math
import sys
from typing import Any, Optional

import audit
import pytest
from shsa_testing.expressions import Sample, samples
from hostile_expressions import EXPRESSIONS
from hypothesis import given, settings, strategies as st

from shsa_core.errors import ExpressionError
from shsa_core.language.expression import Expression, parse_constraint, parse_expression
from shsa_core.language.functions import CALLS, RESERVED
from shsa_core.language.syntax import MAX_DEPTH, MAX_LENGTH, MAX_NODES, MAX_ROW, is_name
from shsa_core.language.trees import literal
from shsa_testing.thorough import many

UNCLOSED = 8 if sys.version_info >= (3, 9) else 9
"""The place that the parser of Python names."""
HOSTILE = [text for texts in EXPRESSIONS.values() for text in texts]


def test_table_of_hostile_expressions_is_large_enough() -> None:
    assert len(set(HOSTILE)) >= 200


@pytest.mark.parametrize("text", HOSTILE, ids=lambda text: ascii(text)[:40])
def test_hostile_expression_is_refused_and_nothing_runs(text: str) -> None:
    with audit.recorded() as events:
        with pytest.raises(ExpressionError) as caught:
            parse_expression(text)
    assert set(events) <= {"compile"}  # the parser of Python; it runs nothing
    assert str(caught.value)


@pytest.mark.parametrize(
    "text, names",
    [
        ("1", ()),
        ("a", ("a",)),
        ("b + a*b", ("b", "a")),
        ("f1 if x > y else z", ("f1", "x", "y", "z")),
        ("-a**-2 // 3 % 4", ("a",)),
        ("+a", ("a",)),
        ("x**(1/3)", ("x",)),
        ("x**(y*2)", ("x", "y")),
        ("x**dt", ("x",)),
        ("x**pi", ("x",)),
        ("x**sqrt(4)", ("x",)),
        ("x**-(2 - +3)", ("x",)),
        ("x**log(-(1 - 3))", ("x",)),
        ("x**100", ("x",)),
        ("x**-100", ("x",)),
        ("48.67 - 0.03*abs(v) - 1.17*abs(a)", ("v", "a")),
        ("min(a, b, c, 1e3)", ("a", "b", "c")),
        ("derivative(previous(a)) + dt*pi", ("a",)),
        ("lowpass(a, 0.5)", ("a",)),
        ("a if derivative(b) > 0 and c > 0 else 1", ("a", "b", "c")),
        ("a if derivative(b) < integral(c) < 3 else 1", ("a", "b", "c")),
        ("0x1F + 1_000 + .5 + 5.", ()),
        ("range + map + int", ("range", "map", "int")),
        ("a  +\n\t b", ("a", "b")),
    ],
)
def test_expression_is_read_with_its_names_in_order(text: str, names: Any) -> None:
    expression = parse_expression(text)
    assert expression.names == names
    assert expression.text == " ".join(text.split())


@pytest.mark.parametrize(
    "text, names",
    [
        ("a > 1", ("a",)),
        ("1 <= a < b", ("a", "b")),
        ("a == 1 or b != 2", ("a", "b")),
        ("not a >= 1 and b > 0", ("a", "b")),
        ("abs(derivative(a)) < 3", ("a",)),
        ("(a if b > 0 else c) > 1", ("a", "b", "c")),
        ("a > 1 if b > 0 else 2 > 1", None),
        ("a", None),
        ("1", None),
        ("a + 1", None),
        ("-a", None),
        ("True", None),
        ("abs(a)", None),
        ("not a", None),
        ("a and b > 1", None),
        ("a > 1 and b", None),
        ("a > 1 > (b > 2)", None),
        ("a is b", None),
        ("a > 1 is b", None),
        ("a in b", None),
        ("a not in b", None),
        ("a is not b", None),
        ("a.b > 1", None),
        ("a > 1, b > 1", None),
        ("a > 1 and b > 0 and derivative(a) > 0", None),
        ("not (a > 0 or previous(a) > 0)", None),
    ],
)
def test_constraint_is_a_condition(text: str, names: Any) -> None:
    if names is None:
        with pytest.raises(ExpressionError):
            parse_constraint(text)
    else:
        assert parse_constraint(text).names == names


LANGUAGE = (
    "is not part of the language; allowed: numbers, names, + - * / // % **, "
    "comparisons, and, or, not, 'a if c else b', dt, pi, and the functions abs, sign, min, max, "
    "floor, ceil, sqrt, exp, log, log10, sin, cos, tan, asin, acos, atan, tanh, atan2, hypot, "
    "clip, dot, rbf, table, derivative, integral, previous, lowpass, delay"
)


@pytest.mark.parametrize(
    "text, message",
    [
        ("a; b", "character ';' at position 2 " + LANGUAGE),
        ("a.b", "an attribute (a.b) " + LANGUAGE),
        ("a << b", "'LShift' " + LANGUAGE),
        ("a = b", None),
        ("True", "a value that is not a number " + LANGUAGE),
        ("max(a, *b)", "a starred argument (*a) " + LANGUAGE),
        ("(a, b)", "a tuple (a, b) " + LANGUAGE),
        ("abs(a)(b)", "a call of a result " + LANGUAGE),
        ("(a for a in b)", "a loop (... for ... in ...) " + LANGUAGE),
        ("a if a is b else c", "the operator 'is' " + LANGUAGE),
        ("a if a is not b else c", "the operator 'is not' " + LANGUAGE),
        ("a if a in b else c", "the operator 'in' " + LANGUAGE),
        ("a if a not in b else c", "the operator 'not in' " + LANGUAGE),
        ("await a", None),
        (
            "sine(a)",
            "there is no function 'sine'; did you mean sin?; allowed: "
            + LANGUAGE.split(": ", 1)[1],
        ),
        ("zzzz(a)", "there is no function 'zzzz'; allowed: " + LANGUAGE.split(": ", 1)[1]),
        ("abs", "'abs' is a function: write abs(...)"),
        ("lowpass(a)", "lowpass(...) takes 2 arguments, not 1"),
        ("min(a)", "min(...) takes 2 or more arguments, not 1"),
        ("abs(a, b)", "abs(...) takes 1 argument, not 2"),
        ("abs(a=1)", "abs(...) takes no arguments by name"),
        ("a > b", "a condition stands where a number is needed; write '1 if condition else 0'"),
        (
            "a if b else c",
            "a number stands where a condition is needed; write a comparison such as 'a > 0'",
        ),
        ("a**101", "the exponent is 101; at most 100 is allowed"),
        ("a**-101", "the exponent is -101; at most 100 is allowed"),
        ("a**(1/0)", "the exponent has no value"),
        ("a**log(0)", "the exponent has no value"),
        (
            "a**derivative(1)",
            "an exponent without names must be made of numbers and arithmetic alone",
        ),
        (
            "a**(1 if 1 > 0 else 2)",
            "an exponent without names must be made of numbers and arithmetic alone",
        ),
        ("1e999", "a number is too large; the largest is about 1.8e308"),
        ("", "the expression is empty"),
        (
            "a if b > 0 else previous(a)",
            "previous(...) stands where it is not evaluated every time, so it would miss samples; "
            "give it a property and a relation of its own",
        ),
        ("a" * 40_001, "the expression has 40001 characters; at most 40000 are allowed"),
        ("dot(a, b, c)", "dot(...) takes 2, 4, ... arguments, not 3"),
        ("rbf(a, b)", "rbf(...) takes 3, 5, ... arguments, not 2"),
        ("table(a, 0, 1)", "table(...) takes 5, 7, ... arguments, not 3"),
        ("table(a, 0, 1, 2, 3, 4)", "table(...) takes 5, 7, ... arguments, not 6"),
        (
            "table(a, 0, 1, 0, 2)",
            "table(...): x0, x1, ... must rise: 0 and then 0 do not",
        ),
        (
            "table(a, 0, 1, 2, 2, -1, 3)",
            "table(...): x0, x1, ... must rise: 2 and then -1 do not",
        ),
        (
            "table(a, -1e308, 1, 1e308, 2)",
            "table(...): x0, x1, ... must rise: -1e+308 and then 1e+308 do not",
        ),
        ("table(a, 0, 1, b + 1, 2)", "table(...): argument 4 must be a number or a constant"),
        ("delay(a, 2*b)", "delay(...): argument 2 must be a number or a constant"),
        ("delay(a, 0)", "delay(...): the time must be above 0 s"),
        ("delay(a, -1)", "delay(...): the time must be above 0 s"),
        ("clip(a, 2, 1)", "clip(...): 2 is above 1"),
        ("tanh(a, b)", "tanh(...) takes 1 argument, not 2"),
        ("a b", "not an expression: it cannot be read from position 3 of 'a b'"),
        (
            "lowpass(a",
            f"not an expression: it cannot be read from position {UNCLOSED} of 'lowpass(a'; "
            "a ( is not closed: a comma within {...} ends what is not quoted",
        ),
        ("power /", "not an expression: it cannot be read from position 7 of 'power /'"),
        ("a + )", "not an expression: it cannot be read from position 5 of 'a + )'"),
        (
            "1 " * 30,
            "not an expression: it cannot be read from position 3 of '" + ("1 " * 30)[:-1] + "'",
        ),
        (
            "1 " * 31,
            "not an expression: it cannot be read from position 3 of '" + "1 " * 28 + "1...'",
        ),
        (
            "1 " * 30 + "2",
            "not an expression: it cannot be read from position 3 of '" + "1 " * 28 + "1...'",
        ),
        (
            "1 " * 29 + "23",
            "not an expression: it cannot be read from position 3 of '" + "1 " * 29 + "23'",
        ),
    ],
)
def test_refusal_says_what_was_wrong_and_what_is_allowed(text: str, message: Optional[str]) -> None:
    with pytest.raises(ExpressionError) as caught:
        parse_expression(text)
    if message is not None:
        assert str(caught.value) == message


@pytest.mark.parametrize("text", ["(power / voltage", "a * (b"])
def test_a_parenthesis_without_a_call_was_cut_off_by_no_comma(text: str) -> None:
    with pytest.raises(ExpressionError) as caught:
        parse_expression(text)
    assert str(caught.value).endswith("; a ( is not closed")


@pytest.mark.parametrize(
    "text, levels",
    [
        ("-{}", 1),
        ("+{}", 1),
        ("{} + b", 1),
        ("{} + b - b + b", 1),
        ("b + {}", 1),
        ("b + b*{}", 2),
        ("b**{}", 1),
        ("abs({})", 1),
        ("max(b, {})", 1),
        ("lowpass(b, {})", 1),
        ("{} if b > 0 else b", 1),
        ("b if b > 0 else {}", 1),
        ("b if {} > 0 else b", 2),
        ("b if b > {} else b", 2),
        ("b if 0 < b < {} else b", 2),
        ("b if {} > 0 and b > 0 else b", 3),
        ("b if b > 0 or {} > 0 else b", 3),
        ("b if not {} > 0 else b", 3),
    ],
)
def test_every_construct_counts_towards_the_depth(text: str, levels: int) -> None:
    parse_expression(text.format("-" * (MAX_DEPTH - levels) + "a"))
    with pytest.raises(ExpressionError, match="^the expression is nested more than 100 deep$"):
        parse_expression(text.format("-" * (MAX_DEPTH + 1 - levels) + "a"))


def test_what_python_itself_finds_too_deep_is_refused_too() -> None:
    with pytest.raises(ExpressionError) as caught:
        parse_expression("-" * 3999 + "a")
    assert str(caught.value) in (
        "nested too deeply: '" + "-" * 57 + "...'",
        "the expression is nested more than 100 deep",  # where the parser can take it
    )


def test_an_expression_cannot_be_changed() -> None:
    with pytest.raises(AttributeError):
        setattr(parse_expression("a"), "text", "b")


def test_refusal_of_what_is_no_condition() -> None:
    with pytest.raises(ExpressionError) as caught:
        parse_constraint("a.b")
    assert str(caught.value) == "an attribute (a.b) " + LANGUAGE


def test_every_function_of_the_list_can_be_used() -> None:
    for name, function in CALLS.items():
        arguments = ", ".join(["a"] * function.least)
        assert parse_expression(f"{name}({arguments})").names == ("a",)


def test_limits_are_where_they_are_said_to_be() -> None:
    depth = MAX_DEPTH
    assert parse_expression("-" * depth + "a")
    with pytest.raises(ExpressionError, match="nested more than 100 deep"):
        parse_expression("-" * (depth + 1) + "a")
    flat = "max(" + ", ".join(["a"] * (MAX_NODES - 1)) + ")"
    assert parse_expression(flat)
    with pytest.raises(ExpressionError, match="^the expression has more than 10000 parts$"):
        parse_expression(flat.replace("(", "(a, ", 1))
    assert parse_constraint("-" * (depth - 1) + "a > 0")
    with pytest.raises(ExpressionError, match="nested more than 100 deep"):
        parse_constraint("-" * depth + "a > 0")
    padded = "a +" + " " * 10_000 + "b"
    assert parse_expression(padded).text == "a + b"
    exact = "+".join(["a" * 43] * 90)[: MAX_LENGTH - 1] + "a"
    assert parse_expression("a" * MAX_LENGTH).names == ("a" * MAX_LENGTH,)
    assert parse_expression(exact)


@pytest.mark.parametrize("sign", ["+", "-", "*", "/"])
def test_terms_in_a_row_count_as_one_level(sign: str) -> None:
    for term in ("a", "a**3", "(0.5*a*b)", "(a - b)"):
        parse_expression(sign.join([term] * 500))
    parse_expression(sign.join(["a"] * (MAX_ROW + 1)))
    message = f"^the expression has more than {MAX_ROW} operations in a row$"
    for text in (sign.join(["a"] * (MAX_ROW + 2)), sign.join(["abs(" + "a+" * 599 + "a)", "a"])):
        with pytest.raises(ExpressionError, match=message):
            parse_expression(sign.join([text, "a"]))


def test_an_exponent_may_have_terms_in_a_row() -> None:
    assert parse_expression("a**(" + "+".join(["0.1"] * 500) + ")")
    with pytest.raises(ExpressionError, match="^the exponent is 250; at most 100 is allowed$"):
        parse_expression("a**(" + "+".join(["0.5"] * 500) + ")")


def test_names_are_replaced_and_functions_are_not() -> None:
    expression = parse_expression("a + abs(aa)*a**2 - pi*dt + min(a, b)")
    written = expression.code({"a": "i1", "aa": "(-2.0)", "b": "a"})
    assert written == "i1 + abs((-2.0))*i1**2 - pi*dt + min(i1, a)"


@pytest.mark.parametrize(
    "text, good",
    [
        ("battery_current", True),
        ("_a", True),
        ("A1", True),
        ("", False),
        ("1a", False),
        ("a-b", False),
        ("a b", False),
        ("a\n", False),
        ("a/b", False),
        ("\u00e4", False),
        ("lambda", False),
        ("True", False),
        ("abs", False),
        ("dt", False),
        ("pi", False),
        ("require", False),
        ("derivative", False),
    ],
)
def test_names(text: str, good: Any) -> None:
    assert is_name(text) is good


def test_reserved_words_are_the_language() -> None:
    assert {"pi", "dt", "abs", "lowpass", "require"} <= RESERVED


def test_literals() -> None:
    def value(text: str) -> Optional[float]:
        return literal(parse_expression(text).tree())

    assert value("2") == 2.0 and isinstance(value("2"), float)
    assert value("-2.5") == -2.5
    assert value("+2") is None
    assert value("-a") is None
    assert value("--2") is None
    assert value("2*3") is None
    assert literal(Expression("True", ()).tree()) is None
    assert literal(Expression("9" * 400, ()).tree()) == math.inf


@settings(derandomize=True, max_examples=many(300), deadline=None)
@given(samples())
def test_random_expressions_of_the_language_are_read(sample: Sample) -> None:
    parse_expression(sample.text)


@settings(derandomize=True, max_examples=many(1500), deadline=None)
@given(
    st.text(alphabet="ab01.+-*/%<>=!() ,_\n\\'\"[]{}:;#@~^&|$ifelsndotruabmx\u00e4", max_size=60)
)
def test_random_texts_are_read_or_refused_and_nothing_runs(text: str) -> None:
    with audit.recorded() as events:
        try:
            parse_expression(text)
        except ExpressionError as error:
            assert str(error)
    assert set(events) <= {"compile"}
