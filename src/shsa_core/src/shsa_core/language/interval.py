"""Ranges of expressions: where a division by zero is possible (interval arithmetic)."""
import ast
import math
import operator
from dataclasses import dataclass, replace
from typing import Callable, Dict, List, Mapping, Optional, Sequence, Tuple, Type

from shsa_core.language.expression import literal
from shsa_core.language.functions import CONSTANTS, ELAPSED


@dataclass(frozen=True)
class Interval:
    """Every value from `low` to `high`; not 0 if `nonzero`. `known`: only declared ranges went into it."""

    low: float = -math.inf
    high: float = math.inf
    nonzero: bool = False
    known: bool = True

    @property
    def has_zero(self) -> bool:
        """Whether 0 is one of the values."""
        return self.low <= 0.0 <= self.high and not self.nonzero


ANYTHING = Interval(known=False)


@dataclass(frozen=True)
class Trouble:
    """A part of an expression that may have no value: `part` and why, in words."""

    part: str
    reason: str


def find_troubles(
    text: str, tree: ast.expr, constraint: Optional[ast.expr], ranges: Mapping[str, Interval]
) -> List[Trouble]:
    """Where the expression can have no value while each name stays in its declared range and the constraint holds.

    Names that have no range are not taken into account.
    """
    analysis = _Analysis()
    if constraint is not None:
        ranges = narrow(constraint, ranges, True)
    analysis.interval(tree, ranges)
    found = [
        Trouble(ast.get_source_segment(text, node) or text, reason)
        for node, reason in analysis.troubles
    ]
    return list(dict.fromkeys(found))


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
            return _hull(
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
            return _from_corners(_product, left, right)
        if isinstance(node.op, ast.Pow):
            return self._power(node, left, right)
        if right.has_zero:
            if right.known:
                self.troubles.append((node.right, f"can be 0 ({_text(right)}), and is divided by"))
            return ANYTHING
        if isinstance(node.op, ast.Mod):
            return Interval(min(right.low, 0.0), max(right.high, 0.0), known=right.known)
        if isinstance(node.op, ast.FloorDiv):
            return ANYTHING
        if right.low <= 0.0 <= right.high:
            return Interval(nonzero=not left.has_zero, known=known)
        return _from_corners(operator.truediv, left, right)

    def _power(self, node: ast.BinOp, base: Interval, exponent: Interval) -> Interval:
        known = base.known and exponent.known
        whole = exponent.low == exponent.high and exponent.low == round(exponent.low)
        if known and exponent.low < 0.0 and base.has_zero:
            self.troubles.append(
                (node.left, f"can be 0 ({_text(base)}), and its exponent negative")
            )
        elif known and not whole and base.low < 0.0:
            self.troubles.append(
                (node.left, f"can be negative ({_text(base)}), its exponent not whole")
            )
        elif whole and exponent.low % 2.0 == 0.0:
            return Interval(0.0, math.inf, not base.has_zero, known)
        return ANYTHING

    def _call(self, node: ast.Call, name: str, parts: Sequence[Interval]) -> Interval:
        first = parts[0]
        known = all(part.known for part in parts)
        if name == "previous":
            return first
        if name == "lowpass":
            return replace(first, nonzero=False)
        if name == "abs":
            ends = (abs(first.low), abs(first.high))
            low = 0.0 if first.low <= 0.0 <= first.high else min(ends)
            return Interval(low, max(ends), first.nonzero, known)
        if name in ("min", "max"):
            pick = min if name == "min" else max
            low, high = pick(part.low for part in parts), pick(part.high for part in parts)
            return Interval(low, high, not any(part.has_zero for part in parts), known)
        if name == "exp":
            return Interval(0.0, math.inf, True)
        if name == "hypot":
            return Interval(0.0, math.inf, not all(part.has_zero for part in parts), known)
        if name == "atan":
            return replace(first, low=math.atan(first.low), high=math.atan(first.high))
        if name == "sign":
            return Interval(-1.0, 1.0, not first.has_zero, known)
        if name in ("sin", "cos"):
            return Interval(-1.0, 1.0, known=known)
        if name in _DOMAINS and known:
            low, high, zero = _DOMAINS[name]
            if first.low < low or first.high > high or (first.has_zero and not zero):
                self.troubles.append(
                    (node.args[0], f"can be {_text(first)}, where {name} has no value")
                )
            elif name == "sqrt":
                return replace(first, low=math.sqrt(first.low), high=math.sqrt(first.high))
        return ANYTHING


# lowest, highest, and whether 0 is accepted
_DOMAINS: Mapping[str, Tuple[float, float, bool]] = {
    "sqrt": (0.0, math.inf, True),
    "log": (0.0, math.inf, False),
    "log10": (0.0, math.inf, False),
    "asin": (-1.0, 1.0, True),
    "acos": (-1.0, 1.0, True),
}


def _text(interval: Interval) -> str:
    return f"from {interval.low:g} to {interval.high:g}"


def _hull(one: Interval, other: Interval) -> Interval:
    return Interval(
        min(one.low, other.low),
        max(one.high, other.high),
        not one.has_zero and not other.has_zero,
        one.known and other.known,
    )


def _product(left: float, right: float) -> float:
    return 0.0 if 0.0 in (left, right) else left * right


def _from_corners(
    operation: Callable[[float, float], float], left: Interval, right: Interval
) -> Interval:
    ends = [operation(a, b) for a in (left.low, left.high) for b in (right.low, right.high)]
    nonzero = not left.has_zero and not right.has_zero
    if any(math.isnan(end) for end in ends):
        return Interval(nonzero=nonzero, known=left.known and right.known)
    return Interval(min(ends), max(ends), nonzero, left.known and right.known)
