"""Vectors and matrices, unfolded into numbers when a file is read.

Nothing else knows them: element 2 of the vector `joints` is the property `joints_2`.
"""
import ast
from typing import Any, List, Mapping, Optional, Tuple, Union

from shsa_core.errors import ExpressionError
from shsa_core.language.syntax import MAX_LENGTH, cleaned, syntax_tree

LONGEST = 1000
"""Elements of a vector."""

Vector = Tuple[Any, ...]
"""The names of a vector's elements; of a matrix, those of each row."""
Vectors = Mapping[str, Vector]


def elements(name: str, length: int) -> Tuple[str, ...]:
    """Return the names of a vector's elements."""
    return tuple(f"{name}_{place}" for place in range(length))


def unfold(text: str, vectors: Vectors, length: int, place: Optional[int]) -> str:
    """Return the text of the element at a `place` of a vector of this length; None: of a number.

    A vector stands for its element there; `dot`, `min` and `max` take whole ones, and `dot` a
    matrix. Raises ExpressionError.
    """
    text = cleaned(text)
    nodes = [n for n in ast.walk(syntax_tree(text)) if isinstance(n, (ast.Call, ast.Name))]
    pieces: List[str] = []
    end = size = 0
    for node in sorted(nodes, key=lambda each: (each.col_offset, isinstance(each, ast.Name))):
        found = "" if node.col_offset < end else _unfolded(node, vectors, length, place)
        if found:
            pieces += [text[end : node.col_offset], found]
            end, size = node.end_col_offset or 0, size + len(found)
        if size > MAX_LENGTH:
            raise ExpressionError(f"with all elements it has more than {MAX_LENGTH} characters")
    return "".join(pieces) + text[end:]


def _unfolded(
    node: Union[ast.Call, ast.Name], vectors: Vectors, length: int, place: Optional[int]
) -> str:
    """Return what stands for a vector, or a function of vectors; empty for all else."""

    def at_place(vector: Vector) -> Any:
        if place is None or len(vector) != length:
            needed = "a number" if place is None else f"a vector of {length}"
            raise ExpressionError(f"a vector of {len(vector)} stands where {needed} is computed")
        return vector[place]

    if isinstance(node, ast.Name):
        return str(at_place(_numbers(vectors[node.id]))) if node.id in vectors else ""
    function = getattr(node.func, "id", "")
    parts = [vectors.get(getattr(each, "id", ""), ()) for each in node.args]
    if not all(parts) or (function, len(parts)) not in (("dot", 2), ("min", 1), ("max", 1)):
        return ""
    if function != "dot":
        return f"{function}({', '.join(_numbers(parts[0]))})"
    row = parts[0] if isinstance(parts[0][0], str) else at_place(parts[0])
    values = _numbers(parts[1])
    if len(row) != len(values):
        raise ExpressionError(f"dot(...) of {len(row)} and {len(values)} elements")
    return f"dot({', '.join(f'{w}, {x}' for w, x in zip(row, values))})"


def _numbers(vector: Vector) -> Vector:
    if not isinstance(vector[0], str):
        raise ExpressionError("a matrix can be used in dot(MATRIX, VECTOR) alone")
    return vector
