"""Units of expressions: dimensional analysis of a relation's function."""
import ast
import functools
import math
import re
from dataclasses import dataclass
from fractions import Fraction
from typing import Any, Dict, List, Mapping, Optional, Sequence, Tuple

from shsa_core.errors import UnitError
from shsa_core.language.expression import literal
from shsa_core.language.functions import CONSTANTS, ELAPSED

_UNIT = re.compile(
    r"""\s*(1|[A-Za-zµμΩ°%]+)(\s*(\^|\*\*)\s*-?[1-9](?!\d))?"""
    r"""(\s*[*/ ]\s*(1|[A-Za-zµμΩ°%]+)(\s*(\^|\*\*)\s*-?[1-9](?!\d))?)*\s*\Z"""
)
_MAX_LENGTH = 40
_BASE = {"meter": "m", "second": "s", "kilogram": "kg", "gram": "g", "ampere": "A", "kelvin": "K"}
_SPELLINGS = (("°C", "degC"), ("°", "degree"), ("%", "percent"), ("^", "**"))


@dataclass(frozen=True)
class Unit:
    """Powers of base units, and how many of them one unit is.

    `scale` is None where it is not known. `sure` is false where a plain factor such as 2 was taken to have no unit.
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
    """A number as it is written: in a sum it takes any unit; a plain one such as 2 is a factor without a unit."""

    plain: bool


Quantity = Any  # Unit, Number, or None: anything
SECOND = Unit((("second", Fraction(1)),))
NO_UNIT = Unit()


def parse_unit(text: str) -> Optional[Unit]:
    """The unit that `text` names: `A`, `m/s^2`, `1` for none; None if the text is empty (not known).

    Raises UnitError if there is no such unit.
    """
    return _parse_unit(text.strip()) if text.strip() else None


def find_mismatches(
    function: ast.expr,
    constraint: Optional[ast.expr],
    units: Mapping[str, Optional[Unit]],
    result: Optional[Unit],
) -> List[Tuple[str, bool]]:
    """What cannot match in a relation whose function should give the unit `result`, in words.

    The flag is true where no number could make it match, and false where a number may carry a unit.
    """
    analysis = _Analysis(units)
    found = analysis.quantity(function)
    analysis.common([found, result], "the function gives {}, its property is in {}")
    if constraint is not None:
        analysis.condition(constraint)
    return list(dict.fromkeys(analysis.mismatches))


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
        raise UnitError(f"{text[:_MAX_LENGTH]!r} is not a unit; write it like A, m/s^2 or W*h")
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
        raise UnitError(f"there is no unit {text!r}: {error}") from error
    powers = {str(name): Fraction(n).limit_denominator(12) for name, n in base._units.items()}
    powers.pop("radian", None)
    scale = None if "deg" in spelled and unit.dimensionality else float(factor)
    return Unit(tuple(sorted(powers.items())), scale)


def _power_text(power: Fraction) -> str:
    return str(power) if power.denominator == 1 else f"({power})"


def _times(left: Quantity, right: Quantity, sign: int = 1) -> Quantity:
    """The quantity of a product (`sign` 1) or a quotient (-1)."""
    if isinstance(left, Number) and isinstance(right, Number):
        return Number(left.plain and right.plain)
    for one, other, other_sign in ((left, right, sign), (right, left, 1)):
        if isinstance(one, Number):
            if not one.plain or not isinstance(other, Unit):
                return None
            factor = _raise(other, Fraction(other_sign))
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


def _raise(unit: Quantity, exponent: Fraction) -> Quantity:
    if not isinstance(unit, Unit):
        return unit
    scale = None if unit.scale is None else unit.scale ** float(exponent)
    powers = tuple((name, power * exponent) for name, power in unit.powers if exponent)
    return Unit(powers, scale, unit.sure)


class _Analysis:
    """Finds the quantity of each part of a tree and collects what does not match."""

    def __init__(self, units: Mapping[str, Optional[Unit]]) -> None:
        self._units = units
        self.mismatches: List[Tuple[str, bool]] = []

    def quantity(self, node: ast.expr) -> Quantity:
        """The quantity of a number."""
        value = literal(node)
        if value is not None:
            return Number(plain=value == round(value) or abs(value) == 0.5)
        if isinstance(node, ast.Name):
            if node.id in CONSTANTS:
                return Number(plain=True)
            return SECOND if node.id == ELAPSED else self._units[node.id]
        if isinstance(node, ast.UnaryOp):
            return self.quantity(node.operand)
        if isinstance(node, ast.BinOp):
            return self._operation(node)
        if isinstance(node, ast.IfExp):
            self.condition(node.test)
            parts = [self.quantity(node.body), self.quantity(node.orelse)]
            return self.common(parts, "the two sides of if ... else are in {} and {}")
        assert isinstance(node, ast.Call) and isinstance(node.func, ast.Name)
        return self._call(node.func.id, [self.quantity(argument) for argument in node.args])

    def condition(self, node: ast.expr) -> None:
        """Checks a part that is true or false."""
        if isinstance(node, ast.Compare):
            parts = [self.quantity(part) for part in (node.left, *node.comparators)]
            self.common(parts, "{} is compared with {}")
        elif isinstance(node, ast.BoolOp):
            for part in node.values:
                self.condition(part)
        elif isinstance(node, ast.UnaryOp):
            self.condition(node.operand)

    def common(self, parts: Sequence[Quantity], message: str) -> Quantity:
        """The quantity that all parts have, and a mismatch where two have not the same."""
        units = [part for part in parts if isinstance(part, Unit)]
        for unit in units[1:]:
            if not _match(units[0], unit):
                sure = units[0].sure and unit.sure
                self.mismatches.append((message.format(units[0], unit), sure))
                return None
        if units:
            return units[0]
        numbers = all(isinstance(part, Number) for part in parts)
        return Number(all(part.plain for part in parts)) if numbers else None

    def _operation(self, node: ast.BinOp) -> Quantity:
        left, right = self.quantity(node.left), self.quantity(node.right)
        if isinstance(node.op, (ast.Add, ast.Sub)):
            return self.common([left, right], "{} and {} are added or subtracted")
        if isinstance(node.op, ast.Mod):
            return self.common([left, right], "{} % {}")
        if isinstance(node.op, ast.Pow):
            return self._power(left, right, node.right)
        return _times(left, right, 1 if isinstance(node.op, ast.Mult) else -1)

    def _power(self, base: Quantity, exponent: Quantity, node: ast.expr) -> Quantity:
        if self.common([exponent, NO_UNIT], "an exponent is in {}, it must be in {}") is None:
            return None
        value = literal(node)
        if value is not None:
            return _raise(base, Fraction(value).limit_denominator(12))
        if isinstance(base, Unit) and base.powers:
            if not isinstance(exponent, Number):
                self.mismatches.append((f"{base} has an exponent that is not a number", base.sure))
            return None
        return base

    def _call(self, name: str, parts: List[Quantity]) -> Quantity:
        if name in ("abs", "floor", "ceil", "previous"):
            return parts[0]
        if name in ("min", "max", "hypot"):
            return self.common(parts, name + " of {} and {}")
        if name == "sqrt":
            return _raise(parts[0], Fraction(1, 2))
        if name == "derivative":
            return _times(parts[0], SECOND, -1)
        if name == "integral":
            return _times(parts[0], SECOND)
        if name == "lowpass":
            self.common([parts[1], SECOND], "the time constant of lowpass is in {}, not in {}")
            return parts[0]
        if name == "atan2":
            self.common(parts, "atan2 of {} and {}")
        elif name != "sign":
            self.common([parts[0], NO_UNIT], name + " of {}, it needs {}")
        return NO_UNIT


def _match(one: Unit, other: Unit) -> bool:
    if one.powers != other.powers:
        return False
    if one.scale is None or other.scale is None:
        return True
    return math.isclose(one.scale, other.scale, rel_tol=1e-9)
