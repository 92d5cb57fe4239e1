"""Dimensional analysis: what cannot match is found, what can is left alone."""
import subprocess
import sys
from fractions import Fraction
from pathlib import Path
from typing import List, Optional, Tuple

import pytest
from hypothesis import given, settings, strategies as st

from shsa_core.files.ontology_file import read_ontology
from shsa_core.language.expression import parse_constraint, parse_law
from shsa_learning.units.mismatches import check_units, condition_mismatches, law_mismatches
from shsa_learning.units.unit import Unit, UnitError, parse_unit
from shsa_testing.thorough import many

UNITS = {
    name: parse_unit(text)
    for name, text in {
        "v": "m/s",
        "a": "m/s^2",
        "i": "A",
        "u": "V",
        "p": "W",
        "x": "m",
        "t": "s",
        "m": "kg",
        "angle": "rad",
        "degrees": "deg",
        "kmh": "km/h",
        "share": "1",
        "warm": "degC",
        "any": "",
        "k": "",
    }.items()
}


def mismatches(text: str, unit: str, constraint: Optional[str] = None) -> List[Tuple[str, bool]]:
    found = law_mismatches(parse_law(text), UNITS, parse_unit(unit))
    return found + (condition_mismatches(parse_constraint(constraint), UNITS) if constraint else [])


@pytest.mark.parametrize(
    "text, same",
    [
        ("m/s^2", "m/s**2"),
        ("m/s^2", "m s^-2"),
        ("m/s^2", "m*s^-2"),
        ("m / s / s", "m/s^2"),
        ("V*A", "W"),
        ("N*m", "J"),
        ("kg*m^2/s^3", "W"),
        ("A h", "Ah"),
        ("\u03a9", "ohm"),
        ("\u00b5V", "microvolt"),
        ("%", "percent"),
        ("\u00b0", "deg"),
        ("1", "rad"),
        ("1/s", "Hz"),
        ("1/s", "rad/s"),
        ("\u00b0C", "degC"),
        ("m^2/m", "m"),
        (" A ", "A"),
    ],
)
def test_units_are_read(text: str, same: str) -> None:
    assert parse_unit(text) == parse_unit(same)


def test_units_have_a_scale() -> None:
    def unit(text: str) -> Unit:
        found = parse_unit(text)
        assert found is not None
        return found

    assert unit("km/h").scale == pytest.approx(1 / 3.6)
    assert unit("Ah").scale == pytest.approx(3600.0)
    assert unit("%").scale == pytest.approx(0.01)
    assert unit("degC").scale is None
    assert unit("deg").scale == pytest.approx(0.0174532925)
    assert unit("A").powers == (("ampere", Fraction(1)),)
    assert parse_unit("") is None and parse_unit("  ") is None


@pytest.mark.parametrize(
    "text",
    [
        "foo",
        "m**9**9",
        "9**9",
        "m^99",
        "m^0",
        "m^-0",
        "m^1.5",
        "2 m",
        "m+s",
        "m-s",
        "(m)",
        "m/",
        "/s",
        "*",
        "m**",
        "m//s",
        "__import__('os')",
        "m; s",
        "a.b",
        "m\ns\n^",
        "[m]",
        "x" * 41,
        "'m'",
        "!A",
        "11",
    ],
)
def test_other_texts_are_refused(text: str) -> None:
    with pytest.raises(UnitError):
        parse_unit(text)


def test_refusal_says_how_a_unit_is_written() -> None:
    with pytest.raises(
        UnitError, match="'m\\^1.5' is not a unit; write it like A or ampere, m/s\\^2 or"
    ):
        parse_unit("m^1.5")
    how = "write it like A or ampere, m/s^2 or W*h"
    for text, what in {
        "foo": f"there is no unit 'foo'; {how}",
        "Amper": f"there is no unit 'Amper'; {how}; did you mean ampere?",
        "m/secnd": f"there is no unit 'secnd' in 'm/secnd'; {how}; did you mean second?",
    }.items():
        with pytest.raises(UnitError) as caught:
            parse_unit(text)
        assert str(caught.value) == what


@pytest.mark.parametrize(
    "text, shown",
    [
        ("A", "A"),
        ("m/s", "m*s^-1"),
        ("V", "V"),
        ("A*V", "W"),
        ("km/h", "0.277778 m*s^-1"),
        ("1", "(no unit)"),
        ("%", "0.01 (no unit)"),
        ("degC", "K"),
    ],
)
def test_units_are_shown(text: str, shown: str) -> None:
    assert str(parse_unit(text)) == shown


def test_roots_of_units_are_shown() -> None:
    assert str(Unit((("meter", Fraction(1, 2)),))) == "m^(1/2)"


@pytest.mark.parametrize(
    "text, unit",
    [
        ("48.67 - 0.03*abs(v) - 1.17*abs(a)", "A"),
        ("u*i", "W"),
        ("p/u", "A"),
        ("p//u", "A"),
        ("v", "m/s"),
        ("2*v", "m/s"),
        ("v*2 + v/2", "m/s"),
        ("-v + +v - 3", "m/s"),
        ("0.5*m*v**2", "J"),
        ("1/t", "Hz"),
        ("v**0.5*v**0.5", "m/s"),
        ("sqrt(x*a)", "m/s"),
        ("sqrt(2*x*a)", "m/s"),
        ("sqrt(2)*v", "m/s"),
        ("sqrt(any)", "m/s"),
        ("(x**2)**(1/2) + any", "m"),
        ("derivative(v)", "m/s^2"),
        ("integral(a)", "m/s"),
        ("previous(v)", "m/s"),
        ("lowpass(v, t)", "m/s"),
        ("lowpass(v, 0.5)", "m/s"),
        ("v*dt", "m"),
        ("(v - previous(v))/dt", "m/s^2"),
        ("atan2(x, v*t)", "rad"),
        ("hypot(v, v)", "m/s"),
        ("max(v, 0, 3)", "m/s"),
        ("min(1, 2)", "m/s"),
        ("sin(angle) + exp(v*t/x) + log(share) + cos(pi/2)", "1"),
        ("asin(share)", "rad"),
        ("sign(v)", "1"),
        ("floor(v) + ceil(v)", "m/s"),
        ("v % 2 + v % v", "m/s"),
        ("v if i > 3 else 0", "m/s"),
        ("v if i > 3 and not u < 2 else 2*v", "m/s"),
        ("any*v", "A"),
        ("any + v", "m/s"),
        ("v + any", "m/s"),
        ("any**share", "A"),
        ("2**share", "1"),
        ("share**angle", "1"),
        ("x**(1/2)", "m"),
        ("v", ""),
        ("5", "A"),
        ("pi", "A"),
        ("3.6*v", "km/h"),
        ("kmh/3.6", "m/s"),
        ("kmh", "km/h"),
        ("kmh + kmh", "km/h"),
        ("warm", "degC"),
        ("warm + 273.15", "K"),
        ("v**0", "1"),
        ("0.5*v", "m/s"),
    ],
)
def test_what_can_match_is_left_alone(text: str, unit: str) -> None:
    assert mismatches(text, unit) == []


@pytest.mark.parametrize(
    "text, unit, message, sure",
    [
        ("v", "A", "the function gives m*s^-1, its property is in A", True),
        ("u*i", "A", "the function gives W, its property is in A", True),
        ("u + i", "A", "V and A are added or subtracted", True),
        ("u - i", "A", "V and A are added or subtracted", True),
        ("u % i", "V", "V % A", True),
        ("max(u, i)", "V", "max of V and A", True),
        ("hypot(u, i)", "V", "hypot of V and A", True),
        ("atan2(u, i)", "1", "atan2 of V and A", True),
        ("sin(v)", "1", "sin of m*s^-1, it needs (no unit)", True),
        ("exp(v)", "1", "exp of m*s^-1, it needs (no unit)", True),
        ("sin(degrees)", "1", "sin of 0.0174533 (no unit), it needs (no unit)", True),
        ("lowpass(v, i)", "m/s", "the time constant of lowpass is in A, not in s", True),
        ("v**i", "m/s", "an exponent is in A, it must be in (no unit)", True),
        ("v**share", "m/s", "m*s^-1 has an exponent that is not a number", True),
        ("v if u > i else v", "m/s", "V is compared with A", True),
        ("v if u > 1 and u > i else v", "m/s", "V is compared with A", True),
        ("v if not u > i else v", "m/s", "V is compared with A", True),
        ("v if 1 > 0 else a", "m/s", "the two sides of if ... else are in m*s^-1 and m*s^-2", True),
        ("kmh", "m/s", "the function gives 0.277778 m*s^-1, its property is in m*s^-1", True),
        ("kmh + v", "m/s", "0.277778 m*s^-1 and m*s^-1 are added or subtracted", True),
        ("derivative(v)", "m/s", "the function gives m*s^-2, its property is in m*s^-1", True),
        ("integral(v)", "m/s", "the function gives m, its property is in m*s^-1", True),
        ("v**2", "m/s", "the function gives m^2*s^-2, its property is in m*s^-1", True),
        ("sign(v)", "m/s", "the function gives (no unit), its property is in m*s^-1", True),
        ("1/t", "s", "the function gives s^-1, its property is in s", False),
        ("2*v", "A", "the function gives m*s^-1, its property is in A", False),
        ("v*2", "A", "the function gives m*s^-1, its property is in A", False),
        ("v/2", "A", "the function gives m*s^-1, its property is in A", False),
        ("2/v", "s", "the function gives m^-1*s, its property is in s", False),
        ("0.5*v*v", "A", "the function gives m^2*s^-2, its property is in A", False),
        ("pi*v", "A", "the function gives m*s^-1, its property is in A", False),
        ("-2*v + a", "A", "m*s^-1 and m*s^-2 are added or subtracted", False),
    ],
)
def test_what_cannot_match_is_found(text: str, unit: str, message: str, sure: bool) -> None:
    assert mismatches(text, unit) == [(message, sure)]


def test_units_of_a_constraint() -> None:
    assert mismatches("v", "m/s", constraint="u > i") == [("V is compared with A", True)]
    assert mismatches("v", "m/s", constraint="u > 3 and i < 4") == []


def test_everything_that_does_not_match_is_told_once() -> None:
    assert len(mismatches("(u + i) + (u + i) + (v + a)*any", "A")) == 2


@pytest.mark.parametrize(
    "old, new, what",
    [
        ("0.3*v", "v", "tanh of m*s^-1, it needs (no unit)"),
        ("sum_ + 8.1", "0*sum_ + h1*u", "the function gives V, its property is in A"),
        ("1.2*h1 - 0.4*h2", "h1 + h2*0 + u", "(no unit) and V are added or subtracted"),
        ("-0.7*u + 0.2*v", "delay(0.2*v, k)", None),
        ("-0.7*u + 0.2*v", "0.2*delay(v, u)", "the time of delay is in V, not in s"),
        ("-0.7*u + 0.2*v", "rbf(0.3, u, v)", "rbf of V from m*s^-1"),
        ("-0.7*u + 0.2*v", "table(u, 0, v, 1, 2)", "tanh of m*s^-1, it needs (no unit)"),
        ("-0.7*u + 0.2*v", "dot(1, u, 2, v)", "dot adds V and m*s^-1"),
        ("-0.7*u + 0.2*v", "dot(0.3, u, 0.2, v)", None),
        ("-0.7*u + 0.2*v", "clip(u, 0, v)", "clip of V and m*s^-1"),
    ],
)
def test_units_are_followed_through_steps(old: str, new: str, what: Optional[str]) -> None:
    law = "h1 = tanh(0.3*v + k); h2 = tanh(-0.7*u + 0.2*v); sum_ = 1.2*h1 - 0.4*h2; sum_ + 8.1"
    assert old in law
    found = [text for text, _ in mismatches(law.replace(old, new), "A")]
    assert [each for each in found if what is not None and what in each] or not (what or found)


def test_a_file_is_told_where_its_units_are_wrong(tmp_path: Path) -> None:
    path = tmp_path / "o.yaml"
    path.write_text(
        "properties: {v: {unit: m/s}, u: {unit: foo}, i: {unit: A}}\n"
        "relations:\n  net: {i: {function: 0.5*v, constraint: v > 3}}\n"
    )
    found = [str(each) for each in check_units(read_ontology(str(path)))]
    assert [text.rpartition("o.yaml")[2].split(": ")[:3] for text in found] == [
        [":1", "error", "u"],
        [":3", "warning", "units of net for i"],
    ]


def test_who_does_not_check_units_does_not_pay_for_them() -> None:
    code = "import sys, shsa_core.analysis.check; sys.exit('pint' in sys.modules)"
    assert subprocess.call([sys.executable, "-c", code]) == 0


@settings(derandomize=True, max_examples=many(400), deadline=None)
@given(st.text(alphabet="mskgAVWhrad*/^ -123%\u00b0\u00b5\u03a9C", max_size=14))
def test_random_texts_are_units_or_refused(text: str) -> None:
    try:
        parse_unit(text)
    except UnitError as error:
        assert str(error)
