"""Finds where an expression may have no value, as by a division by zero."""
import ast
import math
import operator
from dataclasses import dataclass, replace
from typing import Callable, Dict, List, Mapping, Optional, Sequence, Tuple, Type, Union

from shsa_core.language.expression import Condition, Expression, Law
from shsa_core.language.functions import CONSTANTS, ELAPSED, FUNCTIONS, STATEFUL
from shsa_core.language.trees import is_condition, literal, row
from shsa_learning.ranges.interval import ANYTHING, Interval, from_corners, hull, negative
from shsa_learning.ranges.interval import product, raised, total
from shsa_learning.ranges.rules import RULES


@dataclass(frozen=True)
class Trouble:
    """A part of an expression that may have no value: `part` and why, in words."""

    part: str
    reason: str


def find_troubles(
    law: Union[Law, Expression],
    ranges: Mapping[str, Interval],
    always: Optional[Mapping[str, Interval]] = None,
) -> List[Trouble]:
    """Return where a law or a condition can have no value while each name stays in its range.

    Names that have no range are not taken into account. `ranges` hold where there is to be an
    output, `always` at every sample, which the functions with a memory have seen.
    """
    parts = (*law.steps, ("", law.result)) if isinstance(law, Law) else (("", law),)
    here = dict(ranges)
    before = here if always is None or always is ranges else dict(always)
    analysis = _Analysis(before)
    found: List[Trouble] = []
    for name, each in parts:
        tree = each.tree()
        if is_condition(tree):
            analysis.condition(tree, here)
        else:
            value = analysis.interval(tree, here)
            if before is not here:
                before[name] = interval_of(tree, before)
            here[name] = value
        found += analysis.told(each.text)
    return list(dict.fromkeys(found))


def interval_of(tree: ast.expr, ranges: Mapping[str, Interval]) -> Interval:
    """Return the range of an expression."""
    return _Analysis(ranges).interval(tree, ranges)


def narrowed(condition: Condition, ranges: Mapping[str, Interval]) -> Dict[str, Interval]:
    """Return the ranges for which a condition holds."""
    return narrow(condition.tree(), ranges, True)


def narrow(test: ast.expr, ranges: Mapping[str, Interval], holds: bool) -> Dict[str, Interval]:
    """Return the ranges for which the test holds, or does not."""
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
    """Narrow the range of a name, or of the name in abs(name), by one comparison with a bound."""
    absolute = isinstance(node, ast.Call) and getattr(node.func, "id", "") == "abs"
    if absolute and isinstance(node, ast.Call):
        node = node.args[0]
    if not isinstance(node, ast.Name) or any(isinstance(n, ast.IfExp) for n in ast.walk(bound)):
        return  # choices in bounds of choices would take exponential time
    limit = _Analysis(ranges).interval(bound, ranges)
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

    def __init__(self, always: Mapping[str, Interval]) -> None:
        self._troubles: List[Tuple[ast.expr, str]] = []
        self._always = always

    def told(self, text: str) -> List[Trouble]:
        """Return the troubles found since the last call, which are of this text."""
        found = [(ast.get_source_segment(text, node), reason) for node, reason in self._troubles]
        self._troubles.clear()
        return [Trouble(part or text, reason) for part, reason in found]

    def interval(self, node: ast.expr, ranges: Mapping[str, Interval]) -> Interval:
        """Return the range of a number."""
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
                return negative(inner)
            return inner
        if isinstance(node, ast.IfExp):
            self.condition(node.test, ranges)
            return hull(
                self.interval(node.body, narrow(node.test, ranges, True)),
                self.interval(node.orelse, narrow(node.test, ranges, False)),
            )
        if isinstance(node, ast.BinOp):
            first, operations = row(node)
            result = self.interval(first, ranges)
            for each in operations:
                result = self._operation(each, result, self.interval(each.right, ranges))
            return result
        assert isinstance(node, ast.Call) and isinstance(node.func, ast.Name)
        return self._call(node, node.func.id, ranges)

    def condition(self, node: ast.expr, ranges: Mapping[str, Interval]) -> None:
        """Collect the troubles of a condition."""
        if isinstance(node, ast.Compare):
            for part in (node.left, *node.comparators):
                self.interval(part, ranges)
        elif isinstance(node, ast.BoolOp):
            for part in node.values:
                self.condition(part, ranges)
                ranges = narrow(part, ranges, isinstance(node.op, ast.And))
        elif isinstance(node, ast.UnaryOp):
            self.condition(node.operand, ranges)

    def _operation(self, node: ast.BinOp, left: Interval, right: Interval) -> Interval:
        if isinstance(node.op, ast.Pow):
            result = self._power(node, left, right)
        elif isinstance(node.op, (ast.Div, ast.FloorDiv, ast.Mod)) and right.has_zero:
            if right.known:
                self._troubles.append((node.right, f"can be 0 ({right}), and is divided by"))
            return ANYTHING
        else:
            result = _OPERATIONS[type(node.op)](left, right)
        return self._finite(node, result, [left, right])

    def _power(self, node: ast.BinOp, base: Interval, exponent: Interval) -> Interval:
        known = base.known and exponent.known
        whole = exponent.low == exponent.high and exponent.low == round(exponent.low)
        if known and exponent.low < 0.0 and base.has_zero:
            self._troubles.append((node.left, f"can be 0 ({base}), and its exponent negative"))
            return ANYTHING
        if known and not whole and base.low < 0.0:
            self._troubles.append((node.left, f"can be negative ({base}), its exponent not whole"))
            return ANYTHING
        return raised(base, exponent)

    def _call(self, node: ast.Call, name: str, ranges: Mapping[str, Interval]) -> Interval:
        rule = RULES[name]
        parts = [self.interval(argument, ranges) for argument in node.args]
        domain = rule.domain
        if domain is not None:
            part = parts[domain.argument]
            if not part.known:
                return ANYTHING
            if not domain.has(part):
                argument = node.args[domain.argument]
                self._troubles.append((argument, f"can be {part}, where {name} has no value"))
                return ANYTHING
        if name in STATEFUL and ranges is not self._always:
            before = _Analysis(self._always)
            parts = [before.interval(argument, self._always) for argument in node.args]
        return self._finite(node, rule.range(parts), parts if name in FUNCTIONS else ())

    def _finite(self, node: ast.expr, result: Interval, parts: Sequence[Interval]) -> Interval:
        """Return the result; note a trouble if it can overflow though its parts are finite."""
        if parts and result.known and all(part.finite for part in parts) and not result.finite:
            if not any(part.spans_zero and part.nonzero for part in parts):
                self._troubles.append((node, "can be too large for a number"))
                return ANYTHING
        return result


def _divided(left: Interval, right: Interval) -> Interval:
    if right.spans_zero:
        return Interval(nonzero=not left.has_zero, known=left.known and right.known)
    return from_corners(operator.truediv, left, right)


def _floored(left: Interval, right: Interval) -> Interval:
    if right.spans_zero:
        return Interval(known=left.known and right.known)
    return from_corners(operator.floordiv, left, right)


def _remainder(left: Interval, right: Interval) -> Interval:
    return Interval(min(right.low, 0.0), max(right.high, 0.0), known=right.known)


_OPERATIONS: Mapping[Type[ast.operator], Callable[[Interval, Interval], Interval]] = {
    ast.Add: total,
    ast.Sub: lambda left, right: total(left, negative(right)),
    ast.Mult: product,
    ast.Div: _divided,
    ast.FloorDiv: _floored,
    ast.Mod: _remainder,
}
