"""Dimensional analysis of expressions."""
import ast
from fractions import Fraction
from typing import Dict, List, Mapping, Optional, Sequence, Tuple

from shsa_core.language.functions import CALLS, CONSTANTS, ELAPSED
from shsa_core.language.trees import is_condition, literal, row
from shsa_core.language.units import NO_UNIT, SECOND, Number, Quantity, Unit
from shsa_core.language.units import match, raised, times

Mismatch = Tuple[str, bool]
"""Two units that cannot match, in words. False: a number may carry a unit that makes them match."""


def find_mismatches(
    parts: Sequence[Tuple[str, ast.expr]],
    units: Mapping[str, Optional[Unit]],
    result: Optional[Unit] = None,
) -> List[Mismatch]:
    """Return the units that cannot match in expressions of which the last gives the unit `result`.

    Each of `parts` has the name by which the parts behind it know it. None: not known.
    """
    known: Dict[str, Quantity] = dict(units)
    analysis = _Analysis(known)
    for name, tree in parts:
        if is_condition(tree):
            analysis.condition(tree)
            result = known[name] = None
        else:
            known[name] = analysis.quantity(tree)
    last = known[parts[-1][0]]
    analysis.common([last, result], "the function gives {}, its property is in {}")
    return list(dict.fromkeys(analysis.mismatches))


class _Analysis:
    """Finds the quantity of each part of a tree and collects mismatches."""

    def __init__(self, units: Mapping[str, Quantity]) -> None:
        self._units = units
        self.mismatches: List[Tuple[str, bool]] = []

    def quantity(self, node: ast.expr) -> Quantity:
        """Return the quantity of a number."""
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
            first, operations = row(node)
            result = self.quantity(first)
            for each in operations:
                result = self._operation(each, result, self.quantity(each.right))
            return result
        if isinstance(node, ast.IfExp):
            self.condition(node.test)
            parts = [self.quantity(node.body), self.quantity(node.orelse)]
            return self.common(parts, "the two sides of if ... else are in {} and {}")
        assert isinstance(node, ast.Call) and isinstance(node.func, ast.Name)
        parts = [self.quantity(argument) for argument in node.args]
        return CALLS[node.func.id].units(node.func.id, parts, self.common)

    def condition(self, node: ast.expr) -> None:
        """Check a part that is true or false."""
        if isinstance(node, ast.Compare):
            parts = [self.quantity(part) for part in (node.left, *node.comparators)]
            self.common(parts, "{} is compared with {}")
        elif isinstance(node, ast.BoolOp):
            for part in node.values:
                self.condition(part)
        elif isinstance(node, ast.UnaryOp):
            self.condition(node.operand)

    def common(self, parts: Sequence[Quantity], message: str) -> Quantity:
        """Return the quantity that all parts have; note a mismatch where two differ."""
        units = [part for part in parts if isinstance(part, Unit)]
        for unit in units[1:]:
            if not match(units[0], unit):
                sure = units[0].sure and unit.sure
                self.mismatches.append((message.format(units[0], unit), sure))
                return None
        if units:
            return units[0]
        numbers = all(isinstance(part, Number) for part in parts)
        return Number(all(part.plain for part in parts)) if numbers else None

    def _operation(self, node: ast.BinOp, left: Quantity, right: Quantity) -> Quantity:
        if isinstance(node.op, (ast.Add, ast.Sub)):
            return self.common([left, right], "{} and {} are added or subtracted")
        if isinstance(node.op, ast.Mod):
            return self.common([left, right], "{} % {}")
        if isinstance(node.op, ast.Pow):
            return self._power(left, right, node.right)
        return times(left, right, 1 if isinstance(node.op, ast.Mult) else -1)

    def _power(self, base: Quantity, exponent: Quantity, node: ast.expr) -> Quantity:
        if self.common([exponent, NO_UNIT], "an exponent is in {}, it must be in {}") is None:
            return None
        value = literal(node)
        if value is not None:
            return raised(base, Fraction(value).limit_denominator(12))
        if isinstance(base, Unit) and base.powers:
            if not isinstance(exponent, Number):
                self.mismatches.append((f"{base} has an exponent that is not a number", base.sure))
            return None
        return base
