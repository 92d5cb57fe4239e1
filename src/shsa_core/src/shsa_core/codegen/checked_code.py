"""Reads a substitute's code and checks it anew, whoever sent it."""
import ast
import re
from dataclasses import dataclass
from typing import Any, Dict, List, Mapping, NoReturn, Optional, Sequence, Set, Tuple, Union

from shsa_core.errors import CodeError, ExpressionError
from shsa_core.language.functions import DELAY
from shsa_core.language.syntax import MAX_STEPS, NO_FILE, check_tree, is_free
from shsa_core.language.trees import name_nodes

MAX_CODE = 100_000
MAX_RELATIONS = 1000
MAX_DELAYS = 200
"""Delays in the code; each may hold a thousand samples, about 100 kB."""

_NOT_ALLOWED = re.compile(r"[^A-Za-z0-9_+\-*/%.,<>=!() \[\];:#\n\\]|\\(?!\n)")


@dataclass(frozen=True)
class CheckedRelation:
    """One `def` and its call: `result = expression(arguments)` where the constraint holds.

    `steps` are named expressions, in order, over arguments and the names before them.
    """

    result: str
    arguments: Mapping[str, str]
    constraint: Optional[ast.expr]
    steps: Tuple[Tuple[str, ast.expr], ...]
    expression: ast.expr

    @property
    def names(self) -> Set[str]:
        """All names in it."""
        constraint = () if self.constraint is None else (self.constraint,)
        trees = (*constraint, *(tree for _, tree in self.steps), self.expression)
        return {node.id for tree in trees for node in name_nodes(tree)}


@dataclass(frozen=True)
class CheckedCode:
    """The relations of a substitute's code in order, and the variables of its outputs."""

    n_inputs: int
    relations: Tuple[CheckedRelation, ...]
    outputs: Tuple[str, ...]


def check_code(code: str, n_inputs: int, n_outputs: int) -> CheckedCode:
    """Return the meaning of code of the shape of the paper's listing. Raises CodeError."""
    if len(code) > MAX_CODE:
        raise CodeError(f"the code has {len(code)} characters; at most {MAX_CODE} are allowed")
    foreign = _NOT_ALLOWED.search(code)
    if foreign:
        line = code.count("\n", 0, foreign.start()) + 1
        raise CodeError(f"line {line}: the character {foreign.group()!a} is not allowed in code")
    try:
        return _Reader(ast.parse(code, NO_FILE).body).read(n_inputs, n_outputs)
    except SyntaxError as error:
        raise CodeError(f"line {error.lineno}: not Python: {error.msg}") from error
    except (MemoryError, RecursionError, ValueError, OverflowError) as error:
        raise CodeError("the code is nested too deeply") from error


class _Reader:
    """Reads the statements one after the other; each must be one that may stand there."""

    def __init__(self, body: Sequence[ast.stmt]) -> None:
        self._body = list(body)
        self._lines: Dict[str, int] = {}
        self._used: Set[str] = set()
        self._delays = 0

    def read(self, n_inputs: int, n_outputs: int) -> CheckedCode:
        """Return the meaning of the code."""
        for index in range(n_inputs):
            line = f"t{index}=x[{index}]"
            self._expect(self._take(f"'{line}'"), line, f"'{line}'")
        relations: List[CheckedRelation] = []
        while self._body and isinstance(self._body[0], ast.FunctionDef):
            definition = self._body[0]
            del self._body[0]
            if len(relations) == MAX_RELATIONS:
                self._fail(definition, f"at most {MAX_RELATIONS} functions are allowed")
            relations.append(self._read_relation(definition, f"_tf{len(relations) + 1}"))
        outputs = self._read_outputs(n_outputs)
        for name, line_number in self._lines.items():
            if name not in self._used:
                raise CodeError(f"line {line_number}: {name} is computed but not used")
        return CheckedCode(n_inputs, tuple(relations), outputs)

    def _take(self, what: str) -> ast.stmt:
        if not self._body:
            raise CodeError(f"the code ends where {what} is due")
        return self._body.pop(0)

    def _fail(self, node: Union[ast.stmt, ast.expr], what: str) -> NoReturn:
        raise CodeError(f"line {node.lineno}: {what}")

    def _expect(self, statement: ast.stmt, line: str, what: str) -> None:
        """Check that a statement is this line, which gives the next variable a value."""
        if ast.dump(statement) != ast.dump(ast.parse(line).body[0]):
            self._fail(statement, f"{what} is due here")
        self._lines[f"t{len(self._lines)}"] = statement.lineno

    def _use(self, node: ast.expr) -> str:
        """Return the variable that the node names."""
        if not isinstance(node, ast.Name) or node.id not in self._lines:
            self._fail(node, "only a variable that has a value, such as t0, is allowed here")
        self._used.add(node.id)
        return node.id

    def _read_relation(self, definition: ast.FunctionDef, name: str) -> CheckedRelation:
        parameters = [f"i{index + 1}" for index in range(len(definition.args.args))]
        plain: Any = ast.parse(f"def {name}({','.join(parameters)}): pass").body[0]
        extra = definition.decorator_list or definition.returns
        if definition.name != name or extra or ast.dump(definition.args) != ast.dump(plain.args):
            self._fail(definition, f"'def {name}(i1,i2,...)' is due here")
        constraint, steps, expression = self._read_body(definition, parameters)
        result = f"t{len(self._lines)}"
        what = f"'{result}={name}(...)' with {len(parameters)} arguments"
        statement = self._take(what)
        call = statement.value if isinstance(statement, ast.Assign) else None
        given = call.args if isinstance(call, ast.Call) else []
        if len(given) != len(parameters):
            self._fail(statement, f"{what} is due here")
        arguments = [self._use(argument) for argument in given]
        self._expect(statement, f"{result}={name}({','.join(arguments)})", what)
        if len(set(arguments)) < len(arguments):
            self._fail(statement, f"{name} gets the same argument twice")
        inputs = dict(zip(parameters, arguments))
        return CheckedRelation(result, inputs, constraint, tuple(steps), expression)

    def _read_body(
        self, definition: ast.FunctionDef, parameters: Sequence[str]
    ) -> Tuple[Optional[ast.expr], List[Tuple[str, ast.expr]], ast.expr]:
        """Read `require(...)` if it is there, any number of `name=...`, and `return ...`."""
        body = list(definition.body)
        last = body.pop()
        if not isinstance(last, ast.Return) or last.value is None:
            self._fail(definition, f"{definition.name} must end with 'return ...'")
        known, used = set(parameters), set()
        constraint: Optional[ast.expr] = None
        if body and isinstance(body[0], ast.Expr):
            constraint = self._read_require(body.pop(0))
            used |= self._check(constraint, known, condition=True)
        if len(body) > MAX_STEPS:
            self._fail(definition, f"{definition.name} has more than {MAX_STEPS} assignments")
        steps: List[Tuple[str, ast.expr]] = []
        for statement in body:
            name, tree = self._read_step(statement, known)
            used |= self._check(tree, known, condition=False)
            known.add(name)
            steps.append((name, tree))
        used |= self._check(last.value, known, condition=False)
        idle = sorted(known - used)
        if idle:
            self._fail(definition, f"{definition.name} does not use {', '.join(idle)}")
        return constraint, steps, last.value

    def _read_step(self, statement: ast.stmt, known: Set[str]) -> Tuple[str, ast.expr]:
        name = _assigned(statement)
        if name is None or not isinstance(statement, ast.Assign):
            self._fail(statement, "'name=...' or 'return ...' is due here")
        if name in known:
            self._fail(statement, f"{name} has a value already")
        if not is_free(name):
            self._fail(statement, f"{name} may not be assigned; take another name")
        return name, statement.value

    def _read_require(self, statement: ast.stmt) -> ast.expr:
        call = statement.value if isinstance(statement, ast.Expr) else None
        arguments = call.args if isinstance(call, ast.Call) and not call.keywords else []
        if getattr(getattr(call, "func", None), "id", "") != "require" or len(arguments) != 1:
            self._fail(statement, "'require(condition)' is due here")
        return arguments[0]

    def _check(self, tree: ast.expr, known: Set[str], condition: bool) -> Set[str]:
        """Return the names that the tree uses."""
        try:
            used = check_tree(tree, condition, final=True)
        except ExpressionError as error:
            raise CodeError(f"line {tree.lineno}: {error}") from error
        for name in used:
            if name not in known:
                self._fail(tree, f"{name} has no value here")
        self._delays += sum(node.id == DELAY for node in name_nodes(tree))
        if self._delays > MAX_DELAYS:
            self._fail(tree, f"{DELAY}(...) stands more than {MAX_DELAYS} times in the code")
        return set(used)

    def _read_outputs(self, n_outputs: int) -> Tuple[str, ...]:
        statement = self._take("'y=...'")
        if not isinstance(statement, ast.Assign) or _assigned(statement) != "y":
            self._fail(statement, "'y=...' is due here")
        if self._body:
            self._fail(self._body[0], "nothing may follow 'y=...'")
        value = statement.value
        nodes = [value] if n_outputs == 1 else value.elts if isinstance(value, ast.Tuple) else []
        if len(nodes) != n_outputs:
            self._fail(statement, f"y must have {n_outputs} values")
        return tuple(self._use(node) for node in nodes)


def _assigned(statement: ast.stmt) -> Optional[str]:
    """Return the name of `name=...`, None for any other statement."""
    targets = statement.targets if isinstance(statement, ast.Assign) else []
    alone = targets[0] if len(targets) == 1 else None
    return alone.id if isinstance(alone, ast.Name) else None
