"""Units, and the quantities of the parts of an expression."""
import functools
import math
import re
from dataclasses import dataclass
from fractions import Fraction
from typing import Any, Dict, Mapping, Optional, Tuple

from shsa_core.errors import ShsaError
from shsa_core.text import nearest

_UNIT = re.compile(
    r"""\s*(1|[A-Za-zµμΩ°%]+)(\s*(\^|\*\*)\s*-?[1-9](?!\d))?"""
    r"""(\s*[*/ ]\s*(1|[A-Za-zµμΩ°%]+)(\s*(\^|\*\*)\s*-?[1-9](?!\d))?)*\s*\Z"""
)
_MAX_LENGTH = 40
_BASE = {"meter": "m", "second": "s", "kilogram": "kg", "gram": "g", "ampere": "A", "kelvin": "K"}
_WORDS = (
    *("ampere", "volt", "watt", "ohm", "coulomb", "farad", "tesla", "meter", "gram", "kilogram"),
    *("second", "minute", "hour", "hertz", "radian", "degree", "newton", "joule", "pascal", "bar"),
    *("kelvin", "celsius", "liter", "lux", "percent"),
)
"""The units that are proposed."""
_FORM = "write it like A or ampere, m/s^2 or W*h"
_SPELLINGS = (("°C", "degC"), ("°", "degree"), ("%", "percent"), ("^", "**"))


class UnitError(ShsaError):
    """A text is not a unit."""


@dataclass(frozen=True)
class Unit:
    """Powers of base units, and the `scale` of one unit in them, None if it is not known.

    `sure` is False where a plain factor such as 2 was taken to have no unit.
    """

    powers: Tuple[Tuple[str, Fraction], ...] = ()
    scale: Optional[float] = 1.0
    sure: bool = True

    def __str__(self) -> str:
        parts = [
            _BASE.get(name, name) + ("" if power == 1 else f"^{_power_text(power)}")
            for name, power in self.powers
        ]
        text = _derived().get(self.powers) or "*".join(parts) or "(no unit)"
        known = self.scale is not None and not math.isclose(self.scale, 1.0)
        return f"{self.scale:g} {text}" if known else text


@dataclass(frozen=True)
class Number:
    """A literal number: it takes any unit in a sum; a plain one such as 2 is a factor of none."""

    plain: bool


Quantity = Any  # Unit, Number, or None: anything
SECOND = Unit((("second", Fraction(1)),))
NO_UNIT = Unit()


def parse_unit(text: str) -> Optional[Unit]:
    """Return the unit `text`: `A`, `m/s^2`, `1` for none; None if it is empty. Raises UnitError."""
    return _parse_unit(text.strip()) if text.strip() else None


@functools.lru_cache(maxsize=None)
def _registry() -> Any:
    import pint  # takes a third of a second: only who checks units pays for it

    registry = pint.UnitRegistry()
    try:
        registry.parse_units("percent")
    except AttributeError:  # older versions do not have it
        registry.define("percent = 0.01")
    return registry


@functools.lru_cache(maxsize=None)
def _derived() -> Mapping[Tuple[Tuple[str, Fraction], ...], str]:
    return {_parse_unit(name).powers: name for name in ("N", "J", "W", "C", "V", "ohm", "F")}


@functools.lru_cache(maxsize=4096)
def _parse_unit(text: str) -> Unit:
    if len(text) > _MAX_LENGTH or not _UNIT.match(text):
        raise UnitError(f"{text[:_MAX_LENGTH]!r} is not a unit; {_FORM}")
    spelled = re.sub(r"(?<=[\w°%])\s+(?=[A-Za-zµμΩ°%1])", "*", text)
    for ours, theirs in _SPELLINGS:
        spelled = spelled.replace(ours, theirs)
    # To older versions h is Planck's constant, and there is no Ah.
    spelled = re.sub(r"\bh\b", "hour", re.sub(r"\bAh\b", "(A*h)", spelled))
    registry = _registry()
    try:
        unit = registry.parse_units("" if spelled == "1" else spelled)
        factor, base = registry.get_base_units(unit)
    except (AttributeError, TypeError, ValueError, ArithmeticError, SyntaxError) as error:
        raise UnitError(_unknown(text, str(error))) from error
    powers = {str(name): Fraction(n).limit_denominator(12) for name, n in base._units.items()}
    powers.pop("radian", None)
    scale = None if "deg" in spelled and unit.dimensionality else float(factor)
    return Unit(tuple(sorted(powers.items())), scale)


def _unknown(text: str, why: str) -> str:
    """Return why a text is no unit, once, where Pint says it of the text or of a part: `why`."""
    part = re.match(r"'(.+)' is not defined", why)
    name = part.group(1) if part else text
    told = f"there is no unit {name!r}" + (f" in {text!r}" if name != text else "")
    told += "" if part else f": {why}"
    return f"{told}; {_FORM}{nearest(name.lower(), _WORDS)}"


def _power_text(power: Fraction) -> str:
    return str(power) if power.denominator == 1 else f"({power})"


def times(left: Quantity, right: Quantity, sign: int = 1) -> Quantity:
    """Return the quantity of a product (`sign` 1) or a quotient (-1)."""
    if isinstance(left, Number) and isinstance(right, Number):
        return Number(left.plain and right.plain)
    for one, other, other_sign in ((left, right, sign), (right, left, 1)):
        if isinstance(one, Number):
            if not one.plain or not isinstance(other, Unit):
                return None
            factor = raised(other, Fraction(other_sign))
            return Unit(factor.powers, None, False)
    if left is None or right is None:
        return None
    powers: Dict[str, Fraction] = dict(left.powers)
    for name, power in right.powers:
        powers[name] = powers.get(name, Fraction(0)) + sign * power
    scale = None
    if left.scale is not None and right.scale is not None:
        scale = left.scale * right.scale**sign
    kept = tuple(sorted((name, power) for name, power in powers.items() if power))
    return Unit(kept, scale, left.sure and right.sure)


def raised(unit: Quantity, exponent: Fraction) -> Quantity:
    """Return the quantity of a power."""
    if not isinstance(unit, Unit):
        return unit
    scale = None if unit.scale is None else unit.scale ** float(exponent)
    powers = tuple((name, power * exponent) for name, power in unit.powers if exponent)
    return Unit(powers, scale, unit.sure)


def match(one: Unit, other: Unit) -> bool:
    """Return True if two units are the same, as far as their scales are known."""
    if one.powers != other.powers:
        return False
    if one.scale is None or other.scale is None:
        return True
    return math.isclose(one.scale, other.scale, rel_tol=1e-9)
