"""Reads names, numbers and rows of operations from syntax trees."""
import ast
import math
from typing import List, Optional, Tuple


def name_nodes(tree: ast.AST) -> List[ast.Name]:
    """Return every name in the tree, functions included, in the order of the text."""
    nodes = [node for node in ast.walk(tree) if isinstance(node, ast.Name)]
    return sorted(nodes, key=lambda node: (node.lineno, node.col_offset))


def row(node: ast.expr) -> Tuple[ast.expr, List[ast.BinOp]]:
    """Return the first operand and the operations of a row, by no recursion: it may be long."""
    operations: List[ast.BinOp] = []
    while isinstance(node, ast.BinOp):
        operations.append(node)
        node = node.left
    return node, operations[::-1]


def is_condition(node: ast.expr) -> bool:
    """Return True for a comparison, or what `and`, `or` and `not` make of them."""
    negation = isinstance(node, ast.UnaryOp) and isinstance(node.op, ast.Not)
    return negation or isinstance(node, (ast.Compare, ast.BoolOp))


def literal(node: ast.expr) -> Optional[float]:
    """Return the value of a number as it is written, sign included; None for anything else."""
    if isinstance(node, ast.UnaryOp) and isinstance(node.op, ast.USub):
        value = literal(node.operand) if isinstance(node.operand, ast.Constant) else None
        return None if value is None else -value
    if isinstance(node, ast.Constant) and type(node.value) in (int, float):
        try:
            return float(node.value)
        except OverflowError:
            return math.inf
    return None
