"""The laws of relations, and the constraints under which they hold, as an ontology states them."""
import ast
from dataclasses import dataclass
from typing import Dict, List, Mapping, Tuple

from shsa_core.errors import ExpressionError
from shsa_core.language.syntax import MAX_LENGTH, MAX_STEPS, checked_text, is_free, syntax_tree
from shsa_core.language.trees import name_nodes


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
