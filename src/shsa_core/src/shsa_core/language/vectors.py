"""Vectors and matrices, unfolded into numbers when a file is read.

Nothing else knows them: element 2 of the vector `joints` is the property `joints_2`.
"""
import ast
from typing import Iterable, List, Mapping, Sequence, Tuple, Union

from shsa_core.errors import ExpressionError
from shsa_core.language.syntax import MAX_DEPTH, MAX_LENGTH, cleaned, syntax_tree

LONGEST = 1000
"""Elements of a vector."""
MAX_TEXT = 10 * MAX_LENGTH
"""Characters of all elements of an expression."""

Names = Tuple[str, ...]
Vector = Union[Names, Tuple[Names, ...]]
"""The names of a vector's elements; of a matrix, those of each row."""
Vectors = Mapping[str, Vector]
Texts = Union[str, List[str]]
"""A number's expression, or those of a vector's elements."""


def elements(name: str, length: int) -> Names:
    """Return the names of a vector's elements."""
    return tuple(f"{name}_{place}" for place in range(length))


def unfold(text: str, vectors: Vectors) -> Texts:
    """Return the expression of a number, or one for each element of a vector.

    Operations and functions are taken element by element. `dot` of two vectors, or of a matrix and
    a vector, is their product; `min` and `max` of a vector are those of its elements. Raises
    ExpressionError.
    """
    text = cleaned(text)
    return _unfold(text, syntax_tree(text), vectors, 0)


def _unfold(text: str, tree: ast.expr, vectors: Vectors, depth: int) -> Texts:
    """Put the elements of each vector in a part of a text to where the vector stands."""
    if depth > MAX_DEPTH:
        raise ExpressionError(f"the expression is nested more than {MAX_DEPTH} deep")
    found: List[Tuple[int, int, Union[str, Sequence[str]]]] = []
    open_: List[ast.AST] = [tree]
    while open_:
        node = open_.pop()
        part = _part(text, node, vectors, depth)
        if part is None or not isinstance(node, ast.expr):
            open_.extend(ast.iter_child_nodes(node))
        else:
            found.append((node.col_offset, node.end_col_offset or 0, part))
    found.sort(key=lambda each: each[0])
    vectors_in = [part for *_, part in found if not isinstance(part, str)]
    lengths = sorted({len(part) for part in vectors_in})
    if len(lengths) > 1:
        raise ExpressionError(f"vectors of {lengths[0]} and {lengths[1]} elements stand together")
    texts: List[str] = []
    for place in range(lengths[0] if lengths else 1):
        pieces, end = [], tree.col_offset
        for start, stop, part in found:
            pieces += [text[end:start], part if isinstance(part, str) else part[place]]
            end = stop
        texts.append("".join(pieces) + text[end : tree.end_col_offset])
    if sum(map(len, texts)) > MAX_TEXT:
        raise ExpressionError(f"its elements have more than {MAX_TEXT} characters together")
    return texts if lengths else texts[0]


def _part(
    text: str, node: ast.AST, vectors: Vectors, depth: int
) -> Union[None, str, Sequence[str]]:
    """Return what stands for a vector, or for a function of one as a whole; None for all else."""
    if isinstance(node, ast.Name):
        vector = vectors.get(node.id)
        if vector is not None and not isinstance(vector[0], str):
            raise ExpressionError(f"the matrix {node.id} can stand in dot({node.id}, VECTOR) alone")
        return vector  # type: ignore[return-value]
    name = node.func.id if isinstance(node, ast.Call) and isinstance(node.func, ast.Name) else ""
    arguments = node.args if isinstance(node, ast.Call) else []
    if name in ("min", "max") and len(arguments) == 1:
        inner = _unfold(text, arguments[0], vectors, depth + 1)
        return None if isinstance(inner, str) else f"{name}({', '.join(inner)})"
    if name != "dot" or len(arguments) != 2:
        return None
    first, matrix = arguments[0], None
    if isinstance(first, ast.Name) and not isinstance(vectors.get(first.id, ("",))[0], str):
        matrix = vectors[first.id]
    rows = matrix or [_unfold(text, first, vectors, depth + 1)]
    vector = _unfold(text, arguments[1], vectors, depth + 1)
    if isinstance(vector, str) and isinstance(rows[0], str):
        return None  # of two numbers
    products = [_product(row, vector) for row in rows]
    return products if matrix else products[0]


def _product(row: Union[str, Iterable[str]], vector: Texts) -> str:
    weights = [row] if isinstance(row, str) else list(row)
    if isinstance(row, str) or isinstance(vector, str) or len(weights) != len(vector):
        counts = [1 if isinstance(each, str) else len(each) for each in (weights, vector)]
        raise ExpressionError(f"dot(...) of {counts[0]} and {counts[1]} elements")
    product = f"dot({', '.join(f'{w}, {x}' for w, x in zip(weights, vector))})"
    if len(product) > MAX_LENGTH:
        raise ExpressionError(f"dot(...) is longer than {MAX_LENGTH} characters")
    return product
