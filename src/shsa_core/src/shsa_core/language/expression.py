"""The laws of relations, and the constraints under which they hold, as an ontology states them."""
import ast
from dataclasses import dataclass
from fractions import Fraction
from typing import Dict, List, Mapping, Optional, Sequence, Tuple

from shsa_core.errors import ExpressionError
from shsa_core.language.functions import CALLS, CONSTANTS, ELAPSED
from shsa_core.language.syntax import MAX_LENGTH, MAX_STEPS, checked_text, is_free, syntax_tree
from shsa_core.language.trees import is_condition, literal, name_nodes, row
from shsa_core.language.units import NO_UNIT, SECOND, Number, Quantity, Unit, match, raised, times


Mismatch = Tuple[str, bool]
"""Two units that cannot match, in words. False: a number may carry a unit that makes them match."""


@dataclass(frozen=True)
class Expression:
    """A checked text of the language, and the names it uses, in order of first use."""

    text: str
    names: Tuple[str, ...]

    def tree(self) -> ast.expr:
        """Return the syntax tree of the text."""
        return syntax_tree(self.text)

    def code(self, inputs: Mapping[str, str]) -> str:
        """Return the text with each name replaced; every name must have a replacement."""
        pieces: List[str] = []
        end = 0
        for node in name_nodes(self.tree()):
            if node.id in self.names:
                pieces += [self.text[end : node.col_offset], inputs[node.id]]
                end = node.col_offset + len(node.id)
        return "".join(pieces) + self.text[end:]


@dataclass(frozen=True)
class Condition(Expression):
    """An expression that is true or false, such as `battery_voltage > 10`."""

    def mismatches(self, units: Mapping[str, Optional[Unit]]) -> List[Mismatch]:
        """Return the units in it that cannot match."""
        return find_mismatches([("", self.tree())], units)


@dataclass(frozen=True)
class Law:
    """The function of a relation: an expression, and named `steps` before it.

    A step may use the steps before it. `compose` makes a law that is valid.
    """

    steps: Tuple[Tuple[str, Expression], ...]
    result: Expression

    @property
    def text(self) -> str:
        """The whole law in one line."""
        return "; ".join([*(f"{name} = {e.text}" for name, e in self.steps), self.result.text])

    @property
    def names(self) -> Tuple[str, ...]:
        """Its inputs, properties and constants, in order of first use."""
        steps = dict(self.steps)
        used = [name for each in (*steps.values(), self.result) for name in each.names]
        return tuple(dict.fromkeys(name for name in used if name not in steps))

    def mismatches(
        self, units: Mapping[str, Optional[Unit]], result: Optional[Unit]
    ) -> List[Mismatch]:
        """Return units that cannot match, of inputs in `units` and the output; None: unknown."""
        parts = [(name, each.tree()) for name, each in (*self.steps, ("", self.result))]
        return find_mismatches(parts, units, result)

    def body(self, inputs: Mapping[str, str]) -> List[str]:
        """Return the lines of the generated function, with each input as it is called there."""
        known = {**inputs, **{name: name for name, _ in self.steps}}
        lines = [f"{name}={step.code(known)}" for name, step in self.steps]
        return [*lines, f"return {self.result.code(known)}"]


def compose(steps: Mapping[str, Expression], result: Expression) -> Law:
    """Return the law of some steps, in order, and its result. Raises ExpressionError."""
    law = Law(tuple(steps.items()), result)
    if len(steps) > MAX_STEPS:
        raise ExpressionError(f"'where' has {len(steps)} entries; 1 to {MAX_STEPS} are allowed")
    if len(law.text) > MAX_LENGTH:
        raise ExpressionError(
            f"all expressions have {len(law.text)} characters; at most {MAX_LENGTH} are allowed"
        )
    later = set(steps)
    used = set(result.names)
    for name, step in steps.items():
        if not is_free(name):
            raise ExpressionError(
                f"a value under 'where' cannot be named {name!a}: take letters, digits and _, no "
                "word of Python or the language, and none of generated code (_a, x, y, t0, i1)"
            )
        early = [each for each in step.names if each in later]
        if early:
            raise ExpressionError(f"{name} uses {early[0]}, which has no value before it")
        later.remove(name)
        used.update(step.names)
    idle = [name for name in steps if name not in used]
    if idle:
        raise ExpressionError(f"{idle[0]} stands under 'where' and is not used")
    return law


def parse_expression(text: str) -> Expression:
    """Return the number that `text` is. Raises ExpressionError if it is anything else."""
    return Expression(*checked_text(text, condition=False))


def parse_constraint(text: str) -> Condition:
    """Return the condition that `text` is. Raises ExpressionError if it is anything else."""
    return Condition(*checked_text(text, condition=True))


def parse_law(text: str) -> Law:
    """Return the law with this text: steps and its result, apart by `;`. Raises ExpressionError."""
    *parts, last = text.split(";")
    steps: Dict[str, Expression] = {}
    for part in parts:
        name, _, expression = part.partition("=")
        if name.strip() in steps:
            raise ExpressionError(f"{name.strip()!a} has a value already")
        steps[name.strip()] = parse_expression(expression)
    return compose(steps, parse_expression(last))


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
