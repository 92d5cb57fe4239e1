"""Rewrites the checked expressions of a substitute before they are compiled.

Operations in a row are taken one after the other: they may be deeper than calls may be.
"""
import ast
import functools
import math
from typing import Callable, List, Mapping, Optional, Tuple

from shsa_core.language.functions import CONSTANTS, ELAPSED, STATEFUL
from shsa_core.language.trees import literal, row

MOST_WRITTEN_OUT = 64  # arguments
MemoryOf = Callable[[str], Tuple[str, str]]
"""Make a memory for one use of a stateful function; return its name and its value's."""


class Fill(ast.NodeTransformer):
    """Puts parts into the places that their names hold."""

    def __init__(self, parts: Mapping[str, ast.expr]) -> None:
        self._parts = parts

    def visit_Name(self, node: ast.Name) -> ast.expr:
        return self._parts.get(node.id, node)


class Inline(ast.NodeTransformer):
    """Rewrites the expressions of one relation over the program's variables.

    `calls`: variables, and the stateful calls that give their values; `ready`: the variables that
    must have values before the relation has one. Without `memory_of` a stateful call is its first
    argument, which it becomes once all arguments stand still.
    """

    def __init__(self, arguments: Mapping[str, str], memory_of: Optional[MemoryOf]) -> None:
        self.variables = dict(arguments)
        self._memory_of = memory_of
        self.calls: List[Tuple[str, ast.expr]] = []
        self.ready: List[str] = []
        self.uses_time = False

    def visit_Constant(self, node: ast.Constant) -> ast.expr:
        return ast.Constant(float(node.value))

    def visit_Name(self, node: ast.Name) -> ast.expr:
        self.uses_time = self.uses_time or node.id == ELAPSED
        if node.id in CONSTANTS:
            return ast.Constant(CONSTANTS[node.id])
        return ast.Name(self.variables.get(node.id, node.id), ast.Load())

    def visit_BinOp(self, node: ast.BinOp) -> ast.expr:
        first, operations = row(node)
        result = self.visit(first)
        for each in operations:
            right = self.visit(each.right)
            exponent = literal(right) if isinstance(each.op, ast.Pow) else 0.0
            if exponent is None or exponent != math.floor(exponent):
                result = ast.Call(ast.Name("power", ast.Load()), [result, right], [])
            else:
                result = ast.BinOp(result, each.op, right)
        return result

    def visit_Call(self, node: ast.Call) -> ast.expr:
        self.generic_visit(node)
        assert isinstance(node.func, ast.Name)
        if node.func.id == "dot":
            return _written_out(node)
        if node.func.id not in STATEFUL:
            return node
        if self._memory_of is None:
            return node.args[0]
        memory, result = self._memory_of(node.func.id)
        arguments = [*node.args, ast.Name("now", ast.Load())]
        self.calls.append((result, ast.Call(ast.Name(memory, ast.Load()), arguments, [])))
        return ast.Name(result, ast.Load())


def _written_out(dot: ast.Call) -> ast.expr:
    """Write out a short sum of products of numbers and variables: a call costs as much again."""
    if len(dot.args) > MOST_WRITTEN_OUT or not all(
        literal(a) is not None or isinstance(a, ast.Name) for a in dot.args
    ):
        return dot
    products = [ast.BinOp(w, ast.Mult(), x) for w, x in zip(dot.args[::2], dot.args[1::2])]
    return functools.reduce(lambda left, right: ast.BinOp(left, ast.Add(), right), products)
