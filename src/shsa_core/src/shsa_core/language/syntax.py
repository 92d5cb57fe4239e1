"""Checks that a text is within the language: nothing is ever run as free Python."""
import ast
import builtins
import keyword
import math
import operator
import re
from typing import Callable, Dict, List, NoReturn, Tuple

from shsa_core.errors import ExpressionError
from shsa_core.language.functions import CALLS, CONSTANTS, ELAPSED, FUNCTIONS, RESERVED, STATEFUL
from shsa_core.language.functions import Fixed
from shsa_core.language.trees import is_condition, literal, name_nodes, row
from shsa_core.text import nearest, short

MAX_LENGTH = 40_000
MAX_NODES = 10_000
MAX_DEPTH = 100
MAX_ROW = 600
"""Operations in a row: the compiler allows 1000 of them, of levels and of its callers together."""
MAX_EXPONENT = 100
MAX_STEPS = 100
"""Steps of a law."""

NO_FILE = ""
"""The name of the parsed file: the parser would open a named one to quote a line."""

NAMING = "a name has letters, digits and _, does not begin with a digit and is not a reserved word"
_NAME = re.compile(r"[A-Za-z_][A-Za-z0-9_]*\Z")
_TAKEN = re.compile(r"_.*|[it][0-9]+|[xy]")
_NOT_ALLOWED = re.compile(r"[^A-Za-z0-9_+\-*/%.,<>=!() ]")
_COMPARISONS = (ast.Lt, ast.LtE, ast.Gt, ast.GtE, ast.Eq, ast.NotEq)
_LANGUAGE = (
    "numbers, names, + - * / // % **, comparisons, and, or, not, 'a if c else b', "
    "dt, pi, and the functions " + ", ".join(CALLS)
)


def is_name(text: str) -> bool:
    """Return True if a property or a constant may have this name."""
    return bool(_NAME.match(text)) and not keyword.iskeyword(text) and text not in RESERVED


def is_free(name: str) -> bool:
    """Return True if a step may have this name, in generated code as well."""
    return is_name(name) and not _TAKEN.fullmatch(name) and not hasattr(builtins, name)


def check_tree(tree: ast.expr, condition: bool, final: bool = False) -> Tuple[str, ...]:
    """Return the names in the tree; `final`: it has no constants. Raises ExpressionError."""
    checker = _Checker(final)
    if condition:
        checker.condition(tree, depth=0, always=True)
    else:
        checker.number(tree, depth=0, always=True)
    return tuple(dict.fromkeys(node.id for node in name_nodes(tree) if node.id not in RESERVED))


def checked_text(text: str, condition: bool) -> Tuple[str, Tuple[str, ...]]:
    """Return the text with single spaces, and its names in order. Raises ExpressionError."""
    text = cleaned(text)
    return text, check_tree(syntax_tree(text), condition)


def cleaned(text: str) -> str:
    """Return the text with single spaces. Raises ExpressionError if it is too long or foreign."""
    text = " ".join(text.split())
    if not text:
        raise ExpressionError("the expression is empty")
    if len(text) > MAX_LENGTH:
        raise ExpressionError(
            f"the expression has {len(text)} characters; at most {MAX_LENGTH} are allowed"
        )
    foreign = _NOT_ALLOWED.search(text)
    if foreign:
        raise ExpressionError(
            f"character {foreign.group()!a} at position {foreign.start() + 1} "
            f"is not part of the language; allowed: {_LANGUAGE}"
        )
    return text


def syntax_tree(text: str) -> ast.expr:
    """Return the syntax tree of a text. Raises ExpressionError."""
    try:
        return ast.parse(text, NO_FILE, mode="eval").body
    except SyntaxError as error:
        hint = "; a ( is not closed" if text.count("(") > text.count(")") else ""
        if hint and re.search(r"\w ?\(", text):
            hint += ": a comma within {...} ends what is not quoted"
        raise ExpressionError(  # an offset of 0 stands for the end
            f"not an expression: it cannot be read from position {error.offset or len(text)} of "
            f"'{short(text)}'{hint}"
        ) from error
    except (MemoryError, RecursionError, ValueError, OverflowError) as error:
        raise ExpressionError(f"nested too deeply: '{short(text)}'") from error


class _Checker:
    """Walks a tree and refuses everything that is not in the language.

    `always` is False within a part that is not evaluated every time, where a stateful function
    would miss samples.
    """

    def __init__(self, final: bool) -> None:
        self._final = final
        self._nodes = 0
        self._row = 0

    def number(self, node: ast.expr, depth: int, always: bool) -> None:
        """Check a part that must be a number."""
        self._enter(depth)
        value = literal(node)
        if value is not None:
            if not math.isfinite(value):
                raise ExpressionError("a number is too large; the largest is about 1.8e308")
        elif isinstance(node, ast.Name):
            if node.id in RESERVED and node.id != ELAPSED and node.id not in CONSTANTS:
                raise ExpressionError(f"'{node.id}' is a function: write {node.id}(...)")
        elif isinstance(node, ast.UnaryOp) and isinstance(node.op, (ast.USub, ast.UAdd)):
            self.number(node.operand, depth + 1, always)
        elif isinstance(node, ast.BinOp):
            self._operations(node, depth, always)
        elif isinstance(node, ast.IfExp):
            self.condition(node.test, depth + 1, always)
            self.number(node.body, depth + 1, False)
            self.number(node.orelse, depth + 1, False)
        elif isinstance(node, ast.Call):
            self._call(node, depth, always)
        elif is_condition(node):
            raise ExpressionError(
                "a condition stands where a number is needed; write '1 if condition else 0'"
            )
        else:
            _refuse(node)

    def condition(self, node: ast.expr, depth: int, always: bool) -> None:
        """Check a part that must be true or false."""
        self._enter(depth)
        if isinstance(node, ast.Compare):
            for comparison in node.ops:
                if not isinstance(comparison, _COMPARISONS):
                    _refuse(comparison)
            self.number(node.left, depth + 1, always)
            self.number(node.comparators[0], depth + 1, always)
            for part in node.comparators[1:]:
                self.number(part, depth + 1, False)
        elif isinstance(node, ast.BoolOp):
            self.condition(node.values[0], depth + 1, always)
            for part in node.values[1:]:
                self.condition(part, depth + 1, False)
        elif isinstance(node, ast.UnaryOp) and isinstance(node.op, ast.Not):
            self.condition(node.operand, depth + 1, always)
        elif isinstance(
            node, (ast.Constant, ast.Name, ast.UnaryOp, ast.BinOp, ast.IfExp, ast.Call)
        ):
            raise ExpressionError(
                "a number stands where a condition is needed; write a comparison such as 'a > 0'"
            )
        else:
            _refuse(node)

    def _operations(self, node: ast.BinOp, depth: int, always: bool) -> None:
        first, operations = row(node)
        self._row += len(operations)
        if self._row > MAX_ROW:
            raise ExpressionError(f"the expression has more than {MAX_ROW} operations in a row")
        self.number(first, depth + 1, always)
        for operation in operations:
            if type(operation.op) not in _ARITHMETIC:
                _refuse(operation)
            if operation is not node:
                self._enter(depth)
            self.number(operation.right, depth + 1, always)
            if isinstance(operation.op, ast.Pow):
                _check_exponent(operation.right)
        self._row -= len(operations)

    def _enter(self, depth: int) -> None:
        self._nodes += 1
        if self._nodes > MAX_NODES:
            raise ExpressionError(f"the expression has more than {MAX_NODES} parts")
        if depth > MAX_DEPTH:
            raise ExpressionError(f"the expression is nested more than {MAX_DEPTH} deep")

    def _call(self, node: ast.Call, depth: int, always: bool) -> None:
        if not isinstance(node.func, ast.Name):
            _refuse(node.func)
        name = node.func.id
        function = CALLS.get(name)
        if function is None:
            hint = nearest(name, CALLS)
            raise ExpressionError(f"there is no function '{name}'{hint}; allowed: {_LANGUAGE}")
        if name in STATEFUL and not always:
            raise ExpressionError(
                f"{name}(...) stands where it is not evaluated every time, so it would miss "
                "samples; give it a property and a relation of its own"
            )
        if node.keywords:
            raise ExpressionError(f"{name}(...) takes no arguments by name")
        least, most, each, count = function.least, function.most, function.each, len(node.args)
        if count < least or (most is not None and count > most) or (count - least) % each:
            number = str(least) if most == least else f"{least} or more"
            if each > 1:
                number = f"{least}, {least + each}, ..."
            several = "" if number == "1" else "s"
            raise ExpressionError(f"{name}(...) takes {number} argument{several}, not {count}")
        for argument in node.args:
            self.number(argument, depth + 1, always)
        if function.fixed is not None:
            self._check_fixed(name, function.fixed, node.args)

    def _check_fixed(self, name: str, fixed: Fixed, arguments: List[ast.expr]) -> None:
        places = range(*fixed.places.indices(len(arguments)))
        values = [literal(arguments[place]) for place in places]
        for place, value in zip(places, values):
            node = arguments[place]
            constant = not self._final and isinstance(node, ast.Name) and node.id not in RESERVED
            if value is None and fixed.must and not constant:
                what = f"argument {place + 1} must be a number or a constant"
                raise ExpressionError(f"{name}(...): {what}")
        known = [value for value in values if value is not None]
        wrong = fixed.wrong(known) if len(known) == len(values) else None
        if wrong:
            raise ExpressionError(f"{name}(...): {wrong}")


def _check_exponent(node: ast.expr) -> None:
    if any(child.id not in RESERVED or child.id == ELAPSED for child in name_nodes(node)):
        return
    for child in ast.walk(node):
        if isinstance(child, ast.IfExp) or getattr(child, "id", "") in STATEFUL:
            raise ExpressionError(
                "an exponent without names must be made of numbers and arithmetic alone"
            )
    try:
        value = _constant(node)
    except (ArithmeticError, ValueError) as error:
        raise ExpressionError("the exponent has no value") from error
    if not math.isfinite(value):
        raise ExpressionError("the exponent has no value")
    if abs(value) > MAX_EXPONENT:
        raise ExpressionError(f"the exponent is {value:g}; at most {MAX_EXPONENT} is allowed")


def _constant(node: ast.expr) -> float:
    """Return the value of a checked number without names. Raises ArithmeticError or ValueError."""
    value = literal(node)
    if value is not None:
        return value
    if isinstance(node, ast.Name):
        return CONSTANTS[node.id]
    if isinstance(node, ast.UnaryOp):
        inner = _constant(node.operand)
        return -inner if isinstance(node.op, ast.USub) else inner
    if isinstance(node, ast.BinOp):
        first, operations = row(node)
        result = _constant(first)
        for each in operations:
            result = _ARITHMETIC[type(each.op)](result, _constant(each.right))
        return result
    assert isinstance(node, ast.Call) and isinstance(node.func, ast.Name)
    return float(FUNCTIONS[node.func.id].call(*map(_constant, node.args)))


_ARITHMETIC: Dict[type, Callable[[float, float], float]] = {
    ast.Add: operator.add,
    ast.Sub: operator.sub,
    ast.Mult: operator.mul,
    ast.Div: operator.truediv,
    ast.FloorDiv: operator.floordiv,
    ast.Mod: operator.mod,
    ast.Pow: math.pow,
}
_PARTS: Dict[type, str] = {
    ast.Attribute: "an attribute (a.b)",
    ast.Subscript: "a subscript (a[b])",
    ast.Constant: "a value that is not a number",
    ast.Starred: "a starred argument (*a)",
    ast.Tuple: "a tuple (a, b)",
    ast.Call: "a call of a result",
    ast.Is: "the operator 'is'",
    ast.IsNot: "the operator 'is not'",
    ast.In: "the operator 'in'",
    ast.NotIn: "the operator 'not in'",
    ast.GeneratorExp: "a loop (... for ... in ...)",
}


def _refuse(node: ast.AST) -> NoReturn:
    part: ast.AST = node.op if isinstance(node, (ast.UnaryOp, ast.BinOp)) else node
    what = _PARTS.get(type(part), f"'{type(part).__name__}'")
    raise ExpressionError(f"{what} is not part of the language; allowed: {_LANGUAGE}")
