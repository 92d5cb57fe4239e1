"""Compiles a substitute's checked code into one Python function."""
import ast
import math
from dataclasses import dataclass
from typing import Any, Callable, Dict, Iterable, List, Mapping, Optional, Sequence, Set, Tuple

from shsa_core.codegen.checked_code import CheckedCode, CheckedRelation, check_code
from shsa_core.errors import CodeError
from shsa_core.language.functions import CONSTANTS, ELAPSED, FILTER, FUNCTIONS, STATEFUL
from shsa_core.language.memory import MAX_GAP_S, Memory, derivative, integral, previous, unwrapped
from shsa_core.language.trees import literal, name_nodes, row

INTEGRAL, DERIVATIVE = "integral", "derivative"
MemoryOf = Callable[[str], Tuple[str, str]]
"""Make a memory for one use of a stateful function; return its name and its value's."""
Step = Callable[..., Optional[Tuple[float, ...]]]
Over = Optional[Tuple[float, float]]
Correct = Optional[Callable[[int, float], float]]


@dataclass(frozen=True)
class CompiledProgram:
    """A substitute that can be evaluated.

    `step(x, now)` takes the inputs (floats, in order) and the time `now` (s, one clock). It returns
    the outputs, all finite, or None: an input is not finite, a constraint is false, a result is not
    defined (a division by zero, the root of a negative number, an overflow), or a stateful function
    needs more samples. `step(x, now, at)` has also the times of the inputs (s, one clock, which may
    be another); a derivative is by those, so that an input that is held has no spikes.

    `integrals`: for each output that is nothing but an integral, its sum, which may be set; else
    None. `hidden`: there are other integrals, which start at 0. `remembers`: it must see every
    sample. `timed`: it uses the times of inputs.
    """

    step: Step
    integrals: Tuple[Optional[List[float]], ...] = ()
    hidden: bool = False
    remembers: bool = False
    timed: bool = False


def compile_program(
    code: str, n_inputs: int, n_outputs: int, max_gap: float = MAX_GAP_S, **how: Any
) -> CompiledProgram:
    """Check the code and compile it; memories start anew after `max_gap` s. Raises CodeError.

    `how`: `correct` gets an output's number and value, and returns what all else is computed from;
    derivatives are taken `over` so many s, from and to; inputs are `angles`, or not: derivatives
    and filters of them go the shorter way.
    """
    return _Compiler(max_gap, **how).compile(check_code(code, n_inputs, n_outputs))


def compile_steady(code: str, n_inputs: int, n_outputs: int) -> Optional[Step]:
    """Compile what the code gives once its inputs stand still; None: it needs changes."""
    checked = check_code(code, n_inputs, n_outputs)
    moving = {ELAPSED, *(name for name, each in STATEFUL.items() if not each.rests)}
    if not moving.isdisjoint(_names(checked)):
        return None
    return _Compiler(None).compile(checked).step


class Fill(ast.NodeTransformer):
    """Puts parts into the places that their names hold."""

    def __init__(self, parts: Mapping[str, ast.expr]) -> None:
        self._parts = parts

    def visit_Name(self, node: ast.Name) -> ast.expr:
        return self._parts.get(node.id, node)


class Inline(ast.NodeTransformer):
    """Rewrites the expressions of one relation over the program's variables.

    Operations in a row are taken one after the other: they may be deeper than calls may be.

    `calls`: variables, and the stateful calls that give their values; `ready`: the variables that
    must have values before the relation has one. Without `memory_of` a stateful call is its first
    argument, which it becomes once all arguments stand still.
    """

    def __init__(self, arguments: Mapping[str, str], memory_of: Optional[MemoryOf]) -> None:
        self.variables = dict(arguments)
        self._memory_of = memory_of
        self.calls: List[Tuple[str, ast.Call]] = []
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
        if node.func.id not in STATEFUL:
            return node
        if self._memory_of is None:
            return node.args[0]
        memory, result = self._memory_of(node.func.id)
        arguments = [*node.args, ast.Name("now", ast.Load())]
        self.calls.append((result, ast.Call(ast.Name(memory, ast.Load()), arguments, [])))
        return ast.Name(result, ast.Load())


class _Compiler:
    """Turns checked code into one Python function.

    A variable that is not finite has no value: a relation is evaluated where its inputs have values
    and its constraint holds. Stateful functions are taken out of the expressions and evaluated
    before, so that each sees every sample. Without `max_gap` (s) the inputs stand still.
    """

    def __init__(
        self, max_gap: Optional[float], correct: Correct = None, over: Over = None, angles: Any = ()
    ) -> None:
        self._max_gap = MAX_GAP_S if max_gap is None else max_gap
        self._over = over or (0.0, self._max_gap)
        self._steady = max_gap is None
        self._memories = 0
        self._sums: Dict[str, List[float]] = {}  # of integrals, by the variable that holds them
        self._parts: Dict[str, ast.expr] = {}
        self._angles = {f"t{number}" for number, turns in enumerate(angles) if turns}
        self._functions: Dict[str, str] = {}  # by the variable that holds the value
        self._times: Dict[str, Set[str]] = {"now": {"now"}, ELAPSED: {"now"}}  # of variables
        self._timed = False
        self._names: Dict[str, Any] = {"__builtins__": {}, "power": math.pow, "nan": math.nan}
        self._names.update({name: each.call for name, each in FUNCTIONS.items()}, correct=correct)
        self._names["wrapped"] = lambda angle: math.remainder(angle, math.tau)
        self._names.update({"ArithmeticError": ArithmeticError, "ValueError": ValueError})

    def compile(self, code: CheckedCode) -> CompiledProgram:
        """Compile the whole program."""
        lines = ["def step(x, now, at=None):"]
        inputs = [f"t{i}" for i in range(code.n_inputs)]
        times = [f"a{i}" for i in range(code.n_inputs)]
        self._times.update({name: {time} for name, time in zip(inputs, times)})
        if inputs:
            lines.append(f"  {', '.join(inputs)}, = x")
        outputs = enumerate(code.outputs if self._names["correct"] else ())
        correct = {name: [f"  {name} = correct({n}, {name})"] for n, name in outputs}
        lines += [line for name in inputs for line in correct.get(name, ())]
        if ELAPSED in _names(code):
            lines.append(f"  {ELAPSED} = now - {self._remember(previous(self._max_gap))}(now, now)")
        for relation in code.relations:
            lines += ["  " + line for line in self._relation(relation)]
            lines += correct.get(relation.result, ())
        if self._timed:
            lines.insert(1, f"  {', '.join(times)}, = at or (now,) * {len(times)}")
        lines.append(f"  if {_finite(code.outputs)}: return ({', '.join(code.outputs)},)")
        lines.append("  return None")
        tree = Fill(self._parts).visit(ast.parse("\n".join(lines)))
        for each in ast.walk(tree):
            if isinstance(each, ast.expr):
                each.lineno, each.col_offset = 1, 0
        try:
            # code from checked parts alone
            exec(compile(tree, "<substitute>", "exec"), self._names)
        except RecursionError as error:  # who calls is deep in calls already
            raise CodeError("the code is nested too deeply to be compiled here") from error
        step = self._names["step"]
        sums = tuple(self._sums.get(output) for output in code.outputs)
        hidden = any(all(each is not sum_ for sum_ in sums) for each in self._sums.values())
        return CompiledProgram(step, sums, hidden, self._memories > 0, self._timed)

    def _relation(self, relation: CheckedRelation) -> List[str]:
        """Return the lines that give the relation its value; each step is evaluated for itself."""
        inline = Inline(relation.arguments, None if self._steady else self.memory_of)
        constraint = inline.visit(relation.constraint) if relation.constraint else None
        lines = self._take_calls(inline)
        for number, (name, tree) in enumerate(relation.steps, 1):
            variable = f"{relation.result}_{number}"
            value = inline.visit(tree)
            lines += self._take_calls(inline)
            lines += self._assign(variable, value, inline.ready)
            inline.ready.append(variable)
            inline.variables[name] = variable
        expression = inline.visit(relation.expression)
        lines += self._take_calls(inline)
        if isinstance(expression, ast.Name) and expression.id in self._sums:
            self._sums[relation.result] = self._sums.pop(expression.id)
        ready = inline.ready + ([ELAPSED] if inline.uses_time else [])
        conditions = [_finite(ready)] if ready else []
        if constraint is not None:
            conditions.append(self._part(constraint))
        holds = f"if {' and '.join(conditions)}: " if conditions else ""
        lines += _attempt(f"{holds}{relation.result} = {self._part(expression)}")
        if relation.arguments:
            guard = f"if {_finite(relation.arguments.values())}:"
            lines = [guard] + ["  " + line for line in lines]
        self._times[relation.result] = self._times_of(expression)
        self._angles.update([relation.result] if self._turns(expression) else ())
        return [f"{relation.result} = nan"] + lines

    def _take_calls(self, inline: Inline) -> List[str]:
        """Evaluate the stateful calls met since the last time, each into its variable."""
        lines: List[str] = []
        for name, call in inline.calls:
            lines += self._assign(name, self._call(name, call), inline.ready)
            inline.ready.append(name)
        inline.calls.clear()
        return lines

    def _assign(self, name: str, tree: ast.expr, ready: Sequence[str]) -> List[str]:
        """Evaluate the tree into a variable, if those of `ready` that it uses have values."""
        used = {node.id for node in ast.walk(tree) if isinstance(node, ast.Name)}
        self._angles.update([name] if self._turns(tree) else ())
        needed = [each for each in ready if each in used]
        self._times[name] = self._times_of(tree)
        holds = f"if {_finite(needed)}: " if needed else ""
        return [f"{name} = nan", *_attempt(f"{holds}{name} = {self._part(tree)}")]

    def _call(self, name: str, call: ast.Call) -> ast.expr:
        """Return the stateful call that gives a variable its value: of its time, by its turns."""
        function, (value, *_) = self._functions[name], call.args
        if function == DERIVATIVE:
            call.args[-1] = self._moment(value)
        if function not in (DERIVATIVE, FILTER) or not self._turns(value):
            return call
        follow = ast.Name(self._remember(unwrapped()), ast.Load())
        call.args[0] = ast.Call(follow, [value], [])
        if function == DERIVATIVE:
            return call
        self._angles.add(name)
        return ast.Call(ast.Name("wrapped", ast.Load()), [call], [])

    def _turns(self, tree: ast.expr) -> bool:
        """Tell if a value is an angle, or a sum with one: it means the same after a turn."""
        parts = [tree]
        for part in parts:
            if isinstance(part, ast.UnaryOp):
                parts.append(part.operand)
            elif isinstance(part, ast.BinOp) and isinstance(part.op, (ast.Add, ast.Sub)):
                parts += [part.left, part.right]
        return any(isinstance(part, ast.Name) and part.id in self._angles for part in parts)

    def _times_of(self, tree: ast.AST) -> Set[str]:
        """Return the variables with the times of what a tree is computed from."""
        names = (node.id for node in ast.walk(tree) if isinstance(node, ast.Name))
        return set().union(*(self._times.get(name, ()) for name in names))

    def _moment(self, tree: ast.expr) -> ast.expr:
        """Return the time of a value: of its newest input, or now if another memory gives it."""
        found = self._times_of(tree) or {"now"}
        self._timed = self._timed or "now" not in found
        text = "now" if "now" in found else f"max([{', '.join(sorted(found))}])"
        return ast.parse(text, mode="eval").body

    def _part(self, tree: ast.expr) -> str:
        name = f"_part{len(self._parts)}"
        self._parts[name] = tree
        return name

    def _remember(self, memory: Memory) -> str:
        name = f"_memory{self._memories}"
        self._memories += 1
        self._names[name] = memory
        return name

    def memory_of(self, function: str) -> Tuple[str, str]:
        """Make a memory for one use of a stateful function; return its name and its value's."""
        total = [0.0]
        if function == INTEGRAL:
            memory = self._remember(integral(self._max_gap, total))
            self._sums[f"value_of{memory}"] = total
        elif function == DERIVATIVE:
            memory = self._remember(derivative(self._over[1], self._over[0]))
        else:
            memory = self._remember(STATEFUL[function].call(self._max_gap))
        self._functions[f"value_of{memory}"] = function
        return memory, f"value_of{memory}"


def _names(code: CheckedCode) -> Set[str]:
    trees = [tree for relation in code.relations for tree in relation.trees]
    return {node.id for tree in trees for node in name_nodes(tree)}


def _attempt(line: str) -> List[str]:
    """Return what runs a line, which ends where something has no value."""
    return ["try:", "  " + line, "except (ArithmeticError, ValueError): pass"]


def _finite(names: Iterable[str]) -> str:
    """Return the fastest test that floats are finite: inf - inf and nan - nan are not 0."""
    return " == ".join([f"{name} - {name}" for name in names] + ["0.0"])
