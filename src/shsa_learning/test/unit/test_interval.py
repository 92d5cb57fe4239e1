"""Interval arithmetic: what it says of a range holds for every value in it."""
import math
from typing import List, Mapping, Optional, Tuple

import pytest

from shsa_core.language.expression import parse_constraint, parse_law
from shsa_core.language.functions import CALLS
from shsa_learning.ranges.interval import ANYTHING, Interval
from shsa_learning.ranges.rules import RULES
from shsa_learning.ranges.analysis import find_troubles, interval_of, narrow, narrowed

RANGES = {
    "v": Interval(0.0, 14.0),
    "i": Interval(-5.0, 60.0),
    "w": Interval(-1.0, 1.0),
    "u": Interval(9.0, 14.0),
    "n": Interval(-3.0, -1.0),
}


def troubles(text: str, constraint: Optional[str] = None) -> List[Tuple[str, str]]:
    ranges = narrowed(parse_constraint(constraint), RANGES) if constraint else RANGES
    found = find_troubles(parse_law(text), ranges, RANGES)
    return [(trouble.part, trouble.reason) for trouble in found]


def interval(text: str, **ranges: Interval) -> Interval:
    return interval_of(parse_law(text).result.tree(), dict(RANGES, **ranges))


@pytest.mark.parametrize(
    "text, constraint, part, reason",
    [
        ("p/v", None, "v", "can be 0 (from 0 to 14), and is divided by"),
        ("p//v", None, "v", "can be 0 (from 0 to 14), and is divided by"),
        ("p % v", None, "v", "can be 0 (from 0 to 14), and is divided by"),
        ("p/v", "i > 0", "v", "can be 0 (from 0 to 14), and is divided by"),
        ("p/v", "v >= 0", "v", "can be 0 (from 0 to 14), and is divided by"),
        ("p/v", "v > -1", "v", "can be 0 (from 0 to 14), and is divided by"),
        ("p/v", "v < 3", "v", "can be 0 (from 0 to 3), and is divided by"),
        ("p/v", "v > 1 or i > 1", "v", "can be 0 (from 0 to 14), and is divided by"),
        ("p/(i*v)", None, "i*v", "can be 0 (from -70 to 840), and is divided by"),
        ("p/(u - 10)", None, "u - 10", "can be 0 (from -1 to 4), and is divided by"),
        ("p/(10 - u)", None, "10 - u", "can be 0 (from -4 to 1), and is divided by"),
        ("p/(w + u - 9)", None, "w + u - 9", "can be 0 (from -1 to 6), and is divided by"),
        ("p/max(v, w)", None, "max(v, w)", "can be 0 (from 0 to 14), and is divided by"),
        ("p/min(u, i)", None, "min(u, i)", "can be 0 (from -5 to 14), and is divided by"),
        ("p/abs(i)", None, "abs(i)", "can be 0 (from 0 to 60), and is divided by"),
        ("p/sin(v)", None, "sin(v)", "can be 0 (from -1 to 1), and is divided by"),
        ("p/cos(v)", None, "cos(v)", "can be 0 (from -1 to 1), and is divided by"),
        ("p/atan(i)", None, "atan(i)", "can be 0 (from -1.3734 to 1.55413), and is divided by"),
        ("p/sign(i)", None, "sign(i)", "can be 0 (from -1 to 1), and is divided by"),
        ("p/sqrt(v)", None, "sqrt(v)", "can be 0 (from 0 to 3.74166), and is divided by"),
        ("p/hypot(v, w)", None, "hypot(v, w)", "can be 0 (from 0 to 14.0357), and is divided by"),
        ("p/previous(v)", None, "previous(v)", "can be 0 (from 0 to 14), and is divided by"),
        ("p/lowpass(v, 1)", "v > 0", "lowpass(v, 1)", "can be 0 (from 0 to 14), and is divided by"),
        ("p/v**2", None, "v**2", "can be 0 (from 0 to 196), and is divided by"),
        ("p/-v", None, "-v", "can be 0 (from -14 to -0), and is divided by"),
        ("p/+v", None, "+v", "can be 0 (from 0 to 14), and is divided by"),
        ("p/(v if p > 0 else u)", None, "v if p > 0 else u", "can be 0 (from 0 to 14), and is"),
        ("p/0", None, "0", "can be 0 (from 0 to 0), and is divided by"),
        ("p/i if i == 0 else 0", None, "i", "can be 0 (from 0 to 0), and is divided by"),
        ("1 if p/i > 3 else 0", None, "i", "can be 0 (from -5 to 60), and is divided by"),
        ("1 if p > 1 and p/i > 3 else 0", None, "i", "can be 0 (from -5 to 60), and is divided"),
        ("1 if not p/i > 3 else 0", None, "i", "can be 0 (from -5 to 60), and is divided by"),
        ("1 if i > 0 or p/i > 3 else 0", None, "i", "can be 0 (from -5 to 0), and is divided by"),
        ("v**-1", None, "v", "can be 0 (from 0 to 14), and its exponent negative"),
        ("v**n", None, "v", "can be 0 (from 0 to 14), and its exponent negative"),
        ("i**0.5", None, "i", "can be negative (from -5 to 60), its exponent not whole"),
        ("i**v", None, "i", "can be negative (from -5 to 60), its exponent not whole"),
        ("sqrt(i)", None, "i", "can be from -5 to 60, where sqrt has no value"),
        ("log(v)", None, "v", "can be from 0 to 14, where log has no value"),
        ("log10(i)", None, "i", "can be from -5 to 60, where log10 has no value"),
        ("asin(v)", None, "v", "can be from 0 to 14, where asin has no value"),
        ("acos(i)", None, "i", "can be from -5 to 60, where acos has no value"),
        ("1/i**3", None, "i**3", "can be 0 (from -125 to 216000), and is divided by"),
        ("sqrt(i**3)", None, "i**3", "can be from -125 to 216000, where sqrt has no value"),
        ("1/floor(v)", None, "floor(v)", "can be 0 (from 0 to 14), and is divided by"),
        ("1/ceil(w)", None, "ceil(w)", "can be 0 (from -1 to 1), and is divided by"),
        ("1/log(u - 8)", None, "log(u - 8)", "can be 0 (from 0 to 1.79176), and is divided by"),
        ("1/log10(v + 1)", None, "log10(v + 1)", "can be 0 (from 0 to 1.17609), and is divided"),
        ("1/atan2(w, 1)", None, "atan2(w, 1)", "can be 0 (from -0.785398 to 0.785398), and is"),
        ("1/asin(w)", None, "asin(w)", "can be 0 (from -1.5708 to 1.5708), and is divided by"),
        ("1/acos(w)", None, "acos(w)", "can be 0 (from 0 to 3.14159), and is divided by"),
        ("1/tan(w)", None, "tan(w)", "can be 0 (from -1.55741 to 1.55741), and is divided by"),
        ("1/(i // u)", None, "i // u", "can be 0 (from -1 to 6), and is divided by"),
        ("1/derivative(i)", None, "derivative(i)", "can be 0 (from -inf to inf), and is divided"),
        ("1/integral(u)", None, "integral(u)", "can be 0 (from -inf to inf), and is divided by"),
        ("lowpass(i, 0)", None, "0", "can be from 0 to 0, where lowpass has no value"),
        ("lowpass(i, v)", None, "v", "can be from 0 to 14, where lowpass has no value"),
        ("p/previous(i)", "i > 1", "previous(i)", "can be 0 (from -5 to 60), and is divided by"),
        ("p/lowpass(i, 1)", "i > 1", "lowpass(i, 1)", "can be 0 (from -5 to 60), and is divided"),
        ("exp(100*v)", None, "exp(100*v)", "can be too large for a number"),
        ("1/exp(-100*v)", None, "exp(-100*v)", "can be 0 (from 0 to 1), and is divided by"),
        ("(9*v)**99*(9*v)**99", None, "(9*v)**99*(9*v)**99", "can be too large"),
    ],
)
def test_what_can_have_no_value_is_found(
    text: str, constraint: Optional[str], part: str, reason: str
) -> None:
    (found,) = troubles(text, constraint)
    assert found[0] == part and found[1].startswith(reason)


@pytest.mark.parametrize(
    "text, constraint",
    [
        ("p/u", None),
        ("p/n", None),
        ("p/unknown", None),
        ("p/(unknown*v)", None),
        ("p//u", None),
        ("p % u", None),
        ("p/v", "v > 0"),
        ("p/v", "0 < v"),
        ("p/v", "v >= 1"),
        ("p/v", "v > 10 and i > 3"),
        ("p/v", "v != 0"),
        ("p/i", "i < 0"),
        ("p/i", "i <= -1"),
        ("p/i", "i == 3"),
        ("p/i", "1 < i < 3"),
        ("p/i", "3 > i > 1"),
        ("p/i", "abs(i) > 0.1"),
        ("p/i", "abs(i) > 0"),
        ("p/i", "0.1 < abs(i)"),
        ("p/i", "not i <= 0"),
        ("p/i", "not (i <= 0 or v > 1)"),
        ("p/i", "not not i > 0"),
        ("p/abs(i)", "i != 0"),
        ("p/i if i != 0 else 0", None),
        ("0 if i == 0 else p/i", None),
        ("p/i if i > 0 else p/u", None),
        ("1 if i > 0 and p/i > 3 else 0", None),
        ("1 if i == 0 or p/i > 3 else 0", None),
        ("p/max(v, 1)", None),
        ("p/min(n, w)", None),
        ("p/(v + 1)", None),
        ("p/(u*n)", None),
        ("p/(u/n)", None),
        ("p/(1/v)", "v > 0"),
        ("p/(v*u)", "v > 0"),
        ("p/sqrt(u)", None),
        ("p/atan(u)", None),
        ("p/sign(n)", None),
        ("p/exp(v)", None),
        ("p/hypot(u, v)", None),
        ("p/u**2", None),
        ("p/dt", None),
        ("p/pi", None),
        ("p/2", None),
        ("p/-u", None),
        ("p/previous(u)", None),
        ("p/lowpass(u, 1)", None),
        ("p/derivative(unknown)", None),
        ("p/tan(unknown)", None),
        ("p/floor(unknown)", None),
        ("p/(u if v > 1 else n)", None),
        ("sqrt(v)", None),
        ("sqrt(abs(i))", None),
        ("sqrt(i)", "i >= 0"),
        ("log(v)", "v > 0"),
        ("log(u)", None),
        ("asin(w)", None),
        ("acos(v/14)", None),
        ("asin(i)", "abs(i) <= 1"),
        ("sqrt(unknown)", None),
        ("v**0.5", None),
        ("v**2", None),
        ("i**3", None),
        ("u**-1", None),
        ("unknown**-1", None),
        ("unknown**0.5", None),
        ("u**-0.5", None),
        ("1/u**3", None),
        ("1/n**3", None),
        ("sqrt(v**3)", None),
        ("1/floor(u)", None),
        ("1/log(u)", None),
        ("1/atan2(u, w)", None),
        ("1/cos(w)", None),
        ("1/(u // n)", None),
        ("1/u**w", None),
        ("lowpass(i, 0.5)", None),
        ("1/derivative(unknown)", None),
        ("lowpass(i, unknown)", None),
    ],
)
def test_what_always_has_a_value_is_left_alone(text: str, constraint: Optional[str]) -> None:
    assert troubles(text, constraint) == []


def test_one_trouble_is_told_once_and_does_not_make_more() -> None:
    assert len(troubles("1/v + 1/v")) == 1
    assert len(troubles("1/(1/v)")) == 1


@pytest.mark.parametrize(
    "text, low, high",
    [
        ("i + w", -6.0, 61.0),
        ("i - w", -6.0, 61.0),
        ("i*w", -60.0, 60.0),
        ("n*n", 1.0, 9.0),
        ("n*0", 0.0, 0.0),
        ("unknown*0", 0.0, 0.0),
        ("u/n", -14.0, -3.0),
        ("i % u", 0.0, 14.0),
        ("i % n", -3.0, 0.0),
        ("unknown/max(unknown, 1)", -math.inf, math.inf),
        ("-i", -60.0, 5.0),
        ("abs(i)", 0.0, 60.0),
        ("abs(n)", 1.0, 3.0),
        ("abs(u)", 9.0, 14.0),
        ("min(v, w)", -1.0, 1.0),
        ("max(v, w, n)", 0.0, 14.0),
        ("sqrt(u)", 3.0, math.sqrt(14.0)),
        ("i if v > 1 else n", -5.0, 60.0),
        ("n if v > 1 else u", -3.0, 14.0),
        ("2.5", 2.5, 2.5),
        ("-2.5", -2.5, -2.5),
    ],
)
def test_ends(text: str, low: float, high: float) -> None:
    found = interval(text)
    assert (found.low, found.high) == pytest.approx((low, high))


def test_narrowing_leaves_what_it_cannot_use() -> None:
    def ranges(text: str, holds: bool = True) -> Mapping[str, Interval]:
        return narrow(parse_constraint(text).tree(), RANGES, holds)

    assert ranges("i + v > 3") == RANGES
    assert ranges("v > 20") == dict(RANGES, v=RANGES["v"])
    assert ranges("1 < i < 3", holds=False) == RANGES
    assert ranges("i > 0 and v > 1", holds=False) == RANGES
    assert ranges("i > u")["i"] == Interval(9.0, 60.0, nonzero=True)
    assert ranges("i > u")["u"] == Interval(9.0, 14.0, nonzero=False)
    assert ranges("new > 3")["new"] == Interval(3.0, math.inf, True, False)
    assert ranges("i < v", holds=False)["i"] == Interval(0.0, 60.0)
    assert ranges("abs(i) < 2")["i"] == Interval(-2.0, 2.0)
    assert ranges("abs(i) == 2")["i"] == Interval(-2.0, 2.0, True)
    assert ranges("i == 2")["i"] == Interval(2.0, 2.0, True)
    assert ranges("v <= 0")["v"] == Interval(0.0, 0.0)
    assert ranges("max(i, 1) > 2") == RANGES


def test_zero() -> None:
    assert Interval(0.0, 1.0).has_zero and Interval(-1.0, 0.0).has_zero
    assert not Interval(0.0, 1.0, nonzero=True).has_zero
    assert not Interval(0.1, 1.0).has_zero and not Interval(-1.0, -0.1).has_zero
    assert ANYTHING.has_zero and not ANYTHING.known


def test_every_function_has_an_interval() -> None:
    assert set(RULES) == set(CALLS)
    for name, function in CALLS.items():
        assert interval(f"{name}({', '.join(['u'] * function.least)})").low is not None


@pytest.mark.parametrize(
    "level",
    [
        "(i if {} > 0 else v)",
        "(i if i < {} else v)",
        "(i if {} > {} else v)",
        "({} if i > 0 else v)",
    ],
)
def test_nested_choices_take_no_exponential_time(level: str) -> None:
    text = "v"
    for _ in range(40 if level.count("{}") == 1 else 5):
        text = level.replace("{}", text)
    assert troubles(f"1/{text}")


@pytest.mark.parametrize(
    "text, low, high",
    [
        ("tanh(w)", math.tanh(-1.0), math.tanh(1.0)),
        ("clip(i, 0, 3)", 0.0, 3.0),
        ("clip(i, w, 3)", -1.0, 3.0),
        ("dot(2, w, -1, u)", -16.0, -7.0),
        ("rbf(0.1, u, 10)", math.exp(-1.6), 1.0),
        ("rbf(0.1, unknown, 10)", 0.0, 1.0),
        ("table(w, -9, 0, 0, 5, 9, 0)", 40.0 / 9.0, 5.0),
        ("table(unknown, 0, 3, 1, 2, 2, 7)", 2.0, 7.0),
        ("table(w, -1, i, 1, u)", -5.0, 60.0),
        ("delay(i, 0.5)", -5.0, 60.0),
    ],
)
def test_ends_of_the_functions_of_fitted_models(text: str, low: float, high: float) -> None:
    found = interval(text)
    assert (found.low, found.high) == pytest.approx((low, high))


@pytest.mark.parametrize(
    "text, constraint, part",
    [
        ("1/dot(2, w, -1, w)", None, "dot(2, w, -1, w)"),
        ("1/clip(u, 0, 3) + 1/clip(i, 0, 3)", None, "clip(i, 0, 3)"),
        ("1/table(w, -1, 1, 1, 0)", None, "table(w, -1, 1, 1, 0)"),
        ("1/tanh(w)", None, "tanh(w)"),
        ("1/delay(i, 1)", "i > 1", "delay(i, 1)"),
        ("rbf(-1, 100*v, 0)", None, "rbf(-1, 100*v, 0)"),
        ("dot(1e300, exp(50*v), 1, u)", None, "dot(1e300, exp(50*v), 1, u)"),
    ],
)
def test_what_fitted_models_can_have_no_value_for_is_found(
    text: str, constraint: Optional[str], part: str
) -> None:
    assert [found for found, _ in troubles(text, constraint)] == [part]


def test_a_thousand_terms_have_an_interval() -> None:
    assert interval("+".join(["2*u"] * 500)) == Interval(9000.0, 14000.0)
    assert interval("*".join(["u/u"] * 290)).known
