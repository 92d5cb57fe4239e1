"""Range check: where an expression may have no value, as by a division by zero."""
import ast
import math
import operator
from dataclasses import dataclass, replace
from typing import Dict, List, Mapping, Sequence, Tuple, Type

from shsa_core.language.functions import CALLS, CONSTANTS, ELAPSED
from shsa_core.language.interval import ANYTHING, Interval, from_corners, hull, product
from shsa_core.language.syntax import literal


@dataclass(frozen=True)
class Trouble:
    """A part of an expression that may have no value: `part` and why, in words."""

    part: str
    reason: str


def find_troubles(text: str, tree: ast.expr, ranges: Mapping[str, Interval]) -> List[Trouble]:
    """Where the expression can have no value while each name stays in its range.

    Names that have no range are not taken into account.
    """
    analysis = _Analysis()
    analysis.interval(tree, ranges)
    found = [
        Trouble(ast.get_source_segment(text, node) or text, reason)
        for node, reason in analysis.troubles
    ]
    return list(dict.fromkeys(found))


def interval_of(tree: ast.expr, ranges: Mapping[str, Interval]) -> Interval:
    """The values that an expression can have."""
    return _Analysis().interval(tree, ranges)


def narrow(test: ast.expr, ranges: Mapping[str, Interval], holds: bool) -> Dict[str, Interval]:
    """The ranges once it is known whether the test holds."""
    result = dict(ranges)
    if isinstance(test, ast.UnaryOp):
        return narrow(test.operand, result, not holds)
    if isinstance(test, ast.BoolOp):
        if isinstance(test.op, ast.And) == holds:
            for part in test.values:
                result = narrow(part, result, holds)
    elif isinstance(test, ast.Compare) and (holds or len(test.ops) == 1):
        sides = [test.left, *test.comparators]
        for left, op, right in zip(sides, test.ops, sides[1:]):
            comparison = type(op) if holds else _OPPOSITE[type(op)]
            _narrow(left, comparison, right, result)
            _narrow(right, _MIRRORED[comparison], left, result)
    return result


_OPPOSITE: Mapping[Type[ast.cmpop], Type[ast.cmpop]] = {
    ast.Lt: ast.GtE,
    ast.GtE: ast.Lt,
    ast.Gt: ast.LtE,
    ast.LtE: ast.Gt,
    ast.Eq: ast.NotEq,
    ast.NotEq: ast.Eq,
}
_MIRRORED: Mapping[Type[ast.cmpop], Type[ast.cmpop]] = {
    ast.Lt: ast.Gt,
    ast.Gt: ast.Lt,
    ast.LtE: ast.GtE,
    ast.GtE: ast.LtE,
    ast.Eq: ast.Eq,
    ast.NotEq: ast.NotEq,
}


def _narrow(
    node: ast.expr, comparison: Type[ast.cmpop], bound: ast.expr, ranges: Dict[str, Interval]
) -> None:
    """Narrows the range of a name, or of the name in abs(name), by one comparison with a bound."""
    absolute = isinstance(node, ast.Call) and getattr(node.func, "id", "") == "abs"
    if absolute and isinstance(node, ast.Call):
        node = node.args[0]
    if not isinstance(node, ast.Name) or any(isinstance(n, ast.IfExp) for n in ast.walk(bound)):
        return  # choices in bounds of choices would take exponential time
    limit = _Analysis().interval(bound, ranges)
    old = ranges.get(node.id, ANYTHING)
    excludes = (
        (comparison is ast.Gt and limit.low >= 0.0)
        or (comparison is ast.GtE and limit.low > 0.0)
        or (comparison is ast.Lt and limit.high <= 0.0)
        or (comparison is ast.LtE and limit.high < 0.0)
        or (comparison is ast.NotEq and limit.low == limit.high == 0.0)
        or (comparison is ast.Eq and not limit.has_zero)
    )
    new = replace(old, nonzero=old.nonzero or excludes)
    if absolute:
        if comparison in (ast.Lt, ast.LtE, ast.Eq):
            new = replace(new, low=max(old.low, -limit.high), high=min(old.high, limit.high))
    else:
        if comparison in (ast.Gt, ast.GtE, ast.Eq):
            new = replace(new, low=max(old.low, limit.low))
        if comparison in (ast.Lt, ast.LtE, ast.Eq):
            new = replace(new, high=min(old.high, limit.high))
    if new.low <= new.high:
        ranges[node.id] = new


class _Analysis:
    """Finds the interval of each part of a tree and collects the troubles."""

    def __init__(self) -> None:
        self.troubles: List[Tuple[ast.expr, str]] = []

    def interval(self, node: ast.expr, ranges: Mapping[str, Interval]) -> Interval:
        """The values that a number can have."""
        value = literal(node)
        if value is not None:
            return Interval(value, value)
        if isinstance(node, ast.Name):
            if node.id in CONSTANTS:
                return Interval(CONSTANTS[node.id], CONSTANTS[node.id])
            if node.id == ELAPSED:
                return Interval(0.0, math.inf, nonzero=True)
            return ranges.get(node.id, ANYTHING)
        if isinstance(node, ast.UnaryOp):
            inner = self.interval(node.operand, ranges)
            if isinstance(node.op, ast.USub):
                return replace(inner, low=-inner.high, high=-inner.low)
            return inner
        if isinstance(node, ast.IfExp):
            self._condition(node.test, ranges)
            return hull(
                self.interval(node.body, narrow(node.test, ranges, True)),
                self.interval(node.orelse, narrow(node.test, ranges, False)),
            )
        if isinstance(node, ast.BinOp):
            left, right = self.interval(node.left, ranges), self.interval(node.right, ranges)
            return self._operation(node, left, right)
        assert isinstance(node, ast.Call) and isinstance(node.func, ast.Name)
        parts = [self.interval(argument, ranges) for argument in node.args]
        return self._call(node, node.func.id, parts)

    def _condition(self, node: ast.expr, ranges: Mapping[str, Interval]) -> None:
        if isinstance(node, ast.Compare):
            for part in (node.left, *node.comparators):
                self.interval(part, ranges)
        elif isinstance(node, ast.BoolOp):
            for part in node.values:
                self._condition(part, ranges)
                ranges = narrow(part, ranges, isinstance(node.op, ast.And))
        elif isinstance(node, ast.UnaryOp):
            self._condition(node.operand, ranges)

    def _operation(self, node: ast.BinOp, left: Interval, right: Interval) -> Interval:
        known = left.known and right.known
        if isinstance(node.op, ast.Add):
            return Interval(left.low + right.low, left.high + right.high, known=known)
        if isinstance(node.op, ast.Sub):
            return Interval(left.low - right.high, left.high - right.low, known=known)
        if isinstance(node.op, ast.Mult):
            return from_corners(product, left, right)
        if isinstance(node.op, ast.Pow):
            return self._power(node, left, right)
        if right.has_zero:
            if right.known:
                self.troubles.append((node.right, f"can be 0 ({right}), and is divided by"))
            return ANYTHING
        if isinstance(node.op, ast.Mod):
            return Interval(min(right.low, 0.0), max(right.high, 0.0), known=right.known)
        if isinstance(node.op, ast.FloorDiv):
            return ANYTHING
        if right.low <= 0.0 <= right.high:
            return Interval(nonzero=not left.has_zero, known=known)
        return from_corners(operator.truediv, left, right)

    def _power(self, node: ast.BinOp, base: Interval, exponent: Interval) -> Interval:
        known = base.known and exponent.known
        whole = exponent.low == exponent.high and exponent.low == round(exponent.low)
        if known and exponent.low < 0.0 and base.has_zero:
            self.troubles.append((node.left, f"can be 0 ({base}), and its exponent negative"))
        elif known and not whole and base.low < 0.0:
            self.troubles.append((node.left, f"can be negative ({base}), its exponent not whole"))
        elif whole and exponent.low % 2.0 == 0.0:
            return Interval(0.0, math.inf, not base.has_zero, known)
        return ANYTHING

    def _call(self, node: ast.Call, name: str, parts: Sequence[Interval]) -> Interval:
        function = CALLS[name]
        if function.domain is not None:
            if not parts[0].known:
                return ANYTHING
            if not function.domain.has(parts[0]):
                self.troubles.append(
                    (node.args[0], f"can be {parts[0]}, where {name} has no value")
                )
                return ANYTHING
        return function.range(parts)
