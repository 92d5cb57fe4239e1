"""What is read from syntax trees: names, numbers, and operations in a row."""
import ast
import math
from typing import List, Optional, Tuple


def name_nodes(tree: ast.AST) -> List[ast.Name]:
    """Every name in the tree, functions included, in the order of the text."""
    nodes = [node for node in ast.walk(tree) if isinstance(node, ast.Name)]
    return sorted(nodes, key=lambda node: (node.lineno, node.col_offset))


def row(node: ast.expr) -> Tuple[ast.expr, List[ast.BinOp]]:
    """The first operand of a sum, a product or the like, and its operations, as they are done.

    However many there are: a tree of a thousand terms is a thousand deep.
    """
    operations: List[ast.BinOp] = []
    while isinstance(node, ast.BinOp):
        operations.append(node)
        node = node.left
    return node, operations[::-1]


def literal(node: ast.expr) -> Optional[float]:
    """The value of a number as it is written, sign included; None if the node is anything else."""
    if isinstance(node, ast.UnaryOp) and isinstance(node.op, ast.USub):
        value = literal(node.operand) if isinstance(node.operand, ast.Constant) else None
        return None if value is None else -value
    if isinstance(node, ast.Constant) and type(node.value) in (int, float):
        try:
            value = float(node.value)
        except OverflowError:
            return math.inf
        return value
    return None
