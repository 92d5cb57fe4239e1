"""Formulas of past-time temporal logic over conditions, judged sample by sample.

The operators are those of signal temporal logic (O. Maler, D. Nickovic: Monitoring Temporal
Properties of Continuous Signals, 2004) that look back, each over a bounded time. What cannot be
told yet, as nothing was seen before the first sample, is neither true nor false.
"""
import ast
from dataclasses import dataclass
from functools import lru_cache
from math import inf
from typing import Callable, Dict, List, Mapping, Optional, Sequence, Tuple

from shsa_core.errors import ExpressionError
from shsa_core.language.expression import Expression, parse_constraint, parse_expression
from shsa_core.language.syntax import MAX_DEPTH, cleaned, syntax_tree
from shsa_core.language.trees import literal, name_nodes

ATOM = "atom"
OPERATORS: Mapping[str, Tuple[str, str]] = {
    "always": ("a, T", "a held at all messages of the last T s"),
    "once": ("a, T", "a held at one message of the last T s"),
    "since": ("a, b, T", "b held at one message of the last T s, and a at all after it"),
    "within": ("a, b, T", "no a waits for b longer than T s"),
}
"""The operators with time: their conditions, or formulas, and their time; when they are true."""

Truth = Optional[bool]
"""None: not known yet."""
Moment = Tuple[float, float]
"""The time in s at which a sample came at the latest, and at the earliest: in doubt all is well."""
Decide = Callable[[Moment, Sequence[Truth]], Truth]
"""Judge the truth of the parts at a moment; it remembers what it needs of earlier ones."""


@dataclass(frozen=True)
class Part:
    """A part of a formula: an operator and its parts, or the condition number `place`."""

    operator: str
    parts: Tuple["Part", ...] = ()
    time: float = 0.0
    place: int = 0

    def judge(self) -> Decide:
        """Return what judges it, given the truth of all conditions, from the first sample on."""
        if self.operator == ATOM:
            return lambda now, truths: truths[self.place]
        parts, decide = [part.judge() for part in self.parts], _DECIDE[self.operator](self.time)
        return lambda now, truths: decide(now, [part(now, truths) for part in parts])


@dataclass(frozen=True)
class Formula:
    """A checked formula; `conditions`: those in it, each as an expression that is 1 or 0."""

    text: str
    conditions: Tuple[Expression, ...]
    root: Part

    @property
    def names(self) -> Tuple[str, ...]:
        """The properties that it uses, in order of first use."""
        return tuple(dict.fromkeys(name for each in self.conditions for name in each.names))


@lru_cache(maxsize=1000)
def parse_formula(text: str) -> Formula:
    """Return the formula that `text` is. Raises ExpressionError if it is anything else."""
    text = cleaned(text)
    conditions: List[Expression] = []
    root = _part(text, syntax_tree(text), conditions, 0)
    return Formula(text, tuple(conditions), root)


def _part(text: str, node: ast.expr, conditions: List[Expression], depth: int) -> Part:
    if depth > MAX_DEPTH:
        raise ExpressionError(f"the formula is nested more than {MAX_DEPTH} deep")
    operator, time, inner = "", 0.0, [node]
    if isinstance(node, ast.BoolOp):
        operator, inner = "and" if isinstance(node.op, ast.And) else "or", node.values
    elif isinstance(node, ast.UnaryOp) and isinstance(node.op, ast.Not):
        operator, inner = "not", [node.operand]
    elif isinstance(node, ast.Call) and getattr(node.func, "id", "") in OPERATORS:
        operator = getattr(node.func, "id")
        time, inner = _time(operator, node), node.args[:-1]
    if operator:
        parts = tuple(_part(text, each, conditions, depth + 1) for each in inner)
        return Part(operator, parts, time)
    for name in (each.id for each in name_nodes(node) if each.id in OPERATORS):
        raise ExpressionError(f"{name}(...) is true or false; it stands where a number is needed")
    condition = parse_constraint(ast.get_source_segment(text, node) or "")
    conditions.append(parse_expression(f"1 if {condition.text} else 0"))
    return Part(ATOM, place=len(conditions) - 1)


def _time(operator: str, node: ast.Call) -> float:
    takes, _ = OPERATORS[operator]
    time = literal(node.args[-1]) if node.args else None
    if node.keywords or len(node.args) != takes.count(",") + 1 or time is None:
        raise ExpressionError(f"write {operator}({takes}): T is a number of seconds")
    if not 0.0 < time < inf:
        raise ExpressionError(f"{operator}(...): the time must be above 0 s, not {time:g}")
    return time


def _not(truth: Truth) -> Truth:
    return None if truth is None else not truth


def _all(parts: Sequence[Truth]) -> Truth:
    return False if False in parts else None if None in parts else True


def _since(time: float) -> Decide:
    true_at, maybe_at = -inf, inf  # when `came` was true, and may have been; inf: before all

    def decide(now: Moment, parts: Sequence[Truth]) -> Truth:
        nonlocal true_at, maybe_at
        (latest, earliest), (holds, came) = now, parts
        maybe_at = min(maybe_at, latest)
        if not holds:
            maybe_at = -inf if holds is False else max(true_at, maybe_at)
            true_at = -inf
        if came:
            true_at = latest
        elif came is None:
            maybe_at = latest
        if earliest - true_at <= time:
            return True
        return None if earliest - maybe_at <= time else False

    return decide


def _once(time: float) -> Decide:
    since = _since(time)
    return lambda now, parts: since(now, (True, *parts))


def _always(time: float) -> Decide:
    once = _once(time)
    return lambda now, parts: _not(once(now, [_not(parts[0])]))


def _within(time: float) -> Decide:
    asked_at = inf

    def decide(now: Moment, parts: Sequence[Truth]) -> Truth:
        nonlocal asked_at
        (latest, earliest), (asked, answered) = now, parts
        if answered is not False:
            asked_at = inf
        elif asked:
            asked_at = min(asked_at, latest)
        return earliest - asked_at <= time

    return decide


_DECIDE: Dict[str, Callable[[float], Decide]] = {
    "not": lambda time: lambda now, parts: _not(parts[0]),
    "and": lambda time: lambda now, parts: _all(parts),
    "or": lambda time: lambda now, parts: _not(_all([_not(each) for each in parts])),
    "always": _always,
    "once": _once,
    "since": _since,
    "within": _within,
}
