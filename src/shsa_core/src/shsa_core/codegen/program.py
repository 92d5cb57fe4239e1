"""Compiles a substitute's code, once it is checked, so that it can be evaluated at every step."""
import ast
import math
from dataclasses import dataclass
from typing import Any, Callable, Dict, Iterable, List, Mapping, Optional, Sequence, Tuple

from shsa_core.codegen.checked_code import CheckedCode, CheckedRelation, check_code
from shsa_core.language.functions import CONSTANTS, ELAPSED, STATEFUL, namespace, power
from shsa_core.language.memory import MAX_GAP_S, Memory, elapsed
from shsa_core.language.syntax import literal

Step = Callable[[Sequence[float], float], Optional[Tuple[float, ...]]]


@dataclass(frozen=True)
class CompiledProgram:
    """A substitute that can be evaluated.

    `step(x, now)` takes the inputs (floats, in order) and the time `now` (s, one clock). It returns
    the outputs, all finite, or None: an input is not finite, a constraint is false, a result is not
    defined (a division by zero, the root of a negative number, an overflow), or a stateful function
    needs more samples.
    """

    step: Step


def compile_program(
    code: str, n_inputs: int, n_outputs: int, max_gap: float = MAX_GAP_S
) -> CompiledProgram:
    """Checks the code and compiles it.

    Stateful functions start anew after a gap of more than `max_gap` (s).

    Raises CodeError for everything that has not the shape of the generator's code.
    """
    return _Compiler(max_gap).compile(check_code(code, n_inputs, n_outputs))


class _Compiler:
    """Turns checked code into one Python function.

    A variable that is not finite has no value: a relation is evaluated where its inputs have values
    and its constraint holds. Stateful functions are taken out of the expressions and evaluated
    before, so that each sees every sample.
    """

    def __init__(self, max_gap: float) -> None:
        self._max_gap = max_gap
        self._memories = 0
        self._parts: Dict[str, ast.expr] = {}
        self._names: Dict[str, Any] = {"__builtins__": {}, "power": power, "nan": math.nan}
        self._names.update(namespace())
        self._names.update({"ArithmeticError": ArithmeticError, "ValueError": ValueError})

    def compile(self, code: CheckedCode) -> CompiledProgram:
        """The function of the whole program."""
        lines = ["def step(x, now):"]
        inputs = [f"t{i}" for i in range(code.n_inputs)]
        if inputs:
            lines.append(f"  {', '.join(inputs)}, = x")
        uses_time = any(
            isinstance(n, ast.Name) and n.id == ELAPSED
            for relation in code.relations
            for tree in relation.trees
            for n in ast.walk(tree)
        )
        if uses_time:
            lines.append(f"  {ELAPSED} = {self._remember(elapsed(self._max_gap))}(0.0, now)")
        for relation in code.relations:
            lines += ["  " + line for line in self._relation(relation)]
        lines.append(f"  if {_finite(code.outputs)}: return ({', '.join(code.outputs)},)")
        lines.append("  return None")
        tree = _Fill(self._parts).visit(ast.parse("\n".join(lines)))
        ast.fix_missing_locations(tree)
        exec(compile(tree, "<substitute>", "exec"), self._names)  # code from checked parts alone
        return CompiledProgram(self._names["step"])

    def _relation(self, relation: CheckedRelation) -> List[str]:
        inline = _Inline(relation.arguments, self)
        constraint = inline.visit(relation.constraint) if relation.constraint else None
        lines = self._take_calls(inline)
        for number, (name, tree) in enumerate(relation.steps, 1):
            variable = f"{relation.result}_{number}"
            value = inline.visit(tree)
            lines += [*self._take_calls(inline), *self._assign(variable, value, inline.ready)]
            inline.variables[name] = variable
            inline.ready.append(variable)
        expression = inline.visit(relation.expression)
        lines += self._take_calls(inline)
        ready = inline.ready + ([ELAPSED] if inline.uses_time else [])
        conditions = [_finite(ready)] if ready else []
        if constraint is not None:
            conditions.append(self._part(constraint))
        holds = f"if {' and '.join(conditions)}: " if conditions else ""
        lines += _attempt(f"{holds}{relation.result} = {self._part(expression)}")
        if relation.arguments:
            guard = f"if {_finite(relation.arguments.values())}:"
            lines = [guard] + ["  " + line for line in lines]
        return [f"{relation.result} = nan"] + lines

    def _take_calls(self, inline: "_Inline") -> List[str]:
        """The stateful calls met since the last time, each evaluated into its variable."""
        lines: List[str] = []
        for name, call in inline.calls:
            lines += self._assign(name, call, inline.ready)
            inline.ready.append(name)
        inline.calls.clear()
        return lines

    def _assign(self, name: str, tree: ast.expr, ready: Sequence[str]) -> List[str]:
        """Evaluates the tree into a variable, where those of `ready` that it uses have values."""
        used = {node.id for node in ast.walk(tree) if isinstance(node, ast.Name)}
        needed = [each for each in ready if each in used]
        holds = f"if {_finite(needed)}: " if needed else ""
        return [f"{name} = nan", *_attempt(f"{holds}{name} = {self._part(tree)}")]

    def _part(self, tree: ast.expr) -> str:
        name = f"_part{len(self._parts)}"
        self._parts[name] = tree
        return name

    def _remember(self, memory: Memory) -> str:
        name = f"_memory{self._memories}"
        self._memories += 1
        self._names[name] = memory
        return name

    def memory_of(self, function: str) -> str:
        """The name of a new memory for one use of a stateful function."""
        return self._remember(STATEFUL[function].make(self._max_gap))


def _attempt(statement: str) -> List[str]:
    """The statement, without effect where it has no value."""
    return ["try:", "  " + statement, "except (ArithmeticError, ValueError): pass"]


def _finite(names: Iterable[str]) -> str:
    """The fastest test in Python that floats are finite: inf - inf and nan - nan are not 0."""
    return " == ".join([f"{name} - {name}" for name in names] + ["0.0"])


class _Fill(ast.NodeTransformer):
    """Puts parts into the places that their names hold."""

    def __init__(self, parts: Mapping[str, ast.expr]) -> None:
        self._parts = parts

    def visit_Name(self, node: ast.Name) -> ast.expr:
        return self._parts.get(node.id, node)


class _Inline(ast.NodeTransformer):
    """Rewrites the expressions of one relation over the program's variables.

    `calls`: variables, and the stateful calls that give their values; `ready`: the variables that
    must have values before the relation has one.
    """

    def __init__(self, arguments: Mapping[str, str], compiler: _Compiler) -> None:
        self.variables = dict(arguments)
        self._compiler = compiler
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
        self.generic_visit(node)
        if isinstance(node.op, ast.Pow):
            exponent = literal(node.right)
            if exponent is None or exponent != math.floor(exponent):
                return ast.Call(ast.Name("power", ast.Load()), [node.left, node.right], [])
        return node

    def visit_Call(self, node: ast.Call) -> ast.expr:
        self.generic_visit(node)
        assert isinstance(node.func, ast.Name)
        if node.func.id not in STATEFUL:
            return node
        memory = self._compiler.memory_of(node.func.id)
        arguments = [*node.args, ast.Name("now", ast.Load())]
        result = "value_of" + memory
        self.calls.append((result, ast.Call(ast.Name(memory, ast.Load()), arguments, [])))
        return ast.Name(result, ast.Load())
