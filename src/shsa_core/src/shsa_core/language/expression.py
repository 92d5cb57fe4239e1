"""Expressions of the ontology: the law of a relation, and the condition under which it holds."""
import ast
from dataclasses import dataclass
from typing import Any, Dict, List, Mapping, Optional, Tuple

from shsa_core.language.interval import Interval
from shsa_core.language.range_check import Trouble, find_troubles, narrow
from shsa_core.language.syntax import check_tree, checked_text, is_name, syntax_tree
from shsa_core.language.trees import literal, name_nodes
from shsa_core.language.unit_check import Mismatch, find_mismatches, find_mismatches_of_condition
from shsa_core.language.units import Unit

__all__ = [
    "Condition",
    "Expression",
    "check_tree",
    "is_name",
    "literal",
    "parse_constraint",
    "parse_expression",
]


@dataclass(frozen=True)
class _Text:
    """A checked text of the language, and the names it uses, in order of first use."""

    text: str
    names: Tuple[str, ...]

    def tree(self) -> ast.expr:
        """The syntax tree of the text."""
        return syntax_tree(self.text)

    def code(self, inputs: Mapping[str, str]) -> str:
        """The text with each name replaced; every name must have a replacement."""
        pieces: List[str] = []
        end = 0
        for node in name_nodes(self.tree()):
            if node.id in self.names:
                pieces += [self.text[end : node.col_offset], inputs[node.id]]
                end = node.col_offset + len(node.id)
        return "".join(pieces) + self.text[end:]


@dataclass(frozen=True)
class Expression(_Text):
    """A number made of numbers, names and the fixed functions: a Law."""

    @property
    def entry(self) -> Mapping[str, Any]:
        """As it stands in an ontology file."""
        return {"function": self.text}

    def body(self, inputs: Mapping[str, str]) -> List[str]:
        """The line of the generated function."""
        return [f"return {self.code(inputs)}"]

    def mismatches(
        self, units: Mapping[str, Optional[Unit]], result: Optional[Unit]
    ) -> List[Mismatch]:
        """What cannot match if it should give the unit `result`."""
        return find_mismatches(self.tree(), units, result)

    def troubles(
        self,
        ranges: Mapping[str, Interval],
        always: Optional[Mapping[str, Interval]] = None,
    ) -> List[Trouble]:
        """Where it may have no value."""
        return find_troubles(self.text, self.tree(), ranges, always)


@dataclass(frozen=True)
class Condition(_Text):
    """What must hold for a law to have a value, such as `battery_voltage > 10`."""

    def mismatches(self, units: Mapping[str, Optional[Unit]]) -> List[Mismatch]:
        """What cannot match."""
        return find_mismatches_of_condition(self.tree(), units)

    def troubles(self, ranges: Mapping[str, Interval]) -> List[Trouble]:
        """Where it may be neither true nor false."""
        return find_troubles(self.text, self.tree(), ranges)

    def narrowed(self, ranges: Mapping[str, Interval]) -> Dict[str, Interval]:
        """The ranges where it holds."""
        return narrow(self.tree(), ranges, True)


def parse_expression(text: str) -> Expression:
    """The expression that `text` is. Raises ExpressionError if it is anything else."""
    return Expression(*checked_text(text, condition=False))


def parse_constraint(text: str) -> Condition:
    """The condition that `text` is. Raises ExpressionError if it is anything else."""
    return Condition(*checked_text(text, condition=True))
