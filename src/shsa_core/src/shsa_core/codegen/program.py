"""Compiles a substitute's checked code into one Python function."""
import ast
import math
from dataclasses import dataclass
from typing import Any, Callable, Dict, Iterable, List, Mapping, Optional, Sequence, Set, Tuple

from shsa_core.codegen.checked_code import CheckedCode, CheckedRelation, check_code
from shsa_core.errors import CodeError
from shsa_core.language.functions import CONSTANTS, ELAPSED, FILTER, FUNCTIONS, STATEFUL
from shsa_core.language.memory import MAX_GAP_S, Memory, derivative, integral, longest_gap, previous
from shsa_core.language.memory import unwrapped
from shsa_core.language.trees import literal, row
from shsa_core.model.field import is_angle

INTEGRAL, DERIVATIVE = "integral", "derivative"
Remembered = Callable[[str, List[ast.expr]], ast.expr]
"""Return what stands for the call of a stateful function, by its name and arguments."""
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
    code: str, n_inputs: int, n_outputs: int, max_gap: float = MAX_GAP_S
) -> CompiledProgram:
    """Check the code and compile it; memories start anew after `max_gap` s. Raises CodeError."""
    return _Compiler(max_gap).compile(check_code(code, n_inputs, n_outputs))


def compile_periodic(
    code: str,
    inputs: Sequence[Tuple[str, Optional[float]]],
    n_outputs: int,
    period: Optional[float],
    correct: Correct = None,
) -> CompiledProgram:
    """Compile code that is evaluated once a `period`, in s; `inputs`: the field and period of each.

    Derivatives are taken over half a period at least, as shorter ones are wild; those of angles,
    and filters, go the shorter way. `correct` gets an output's number and value, and returns what
    all else is computed from.
    """
    gap = longest_gap(period)
    slowest = max((each or 0.0 for _, each in inputs), default=0.0)
    over = 0.5 * (period or 0.0), max(gap, longest_gap(slowest))
    angles = [is_angle(field) for field, _ in inputs]
    return _Compiler(gap, correct, over, angles).compile(check_code(code, len(inputs), n_outputs))


def compile_steady(code: str, n_inputs: int, n_outputs: int) -> Optional[Step]:
    """Compile what the code gives once its inputs stand still; None: it needs changes."""
    checked = check_code(code, n_inputs, n_outputs)
    moving = {ELAPSED, *(name for name, each in STATEFUL.items() if not each.rests)}
    if not all(moving.isdisjoint(each.names) for each in checked.relations):
        return None
    return _Compiler(None).compile(checked).step


class Fill(ast.NodeTransformer):
    """Puts parts into the places that their names hold."""

    def __init__(self, parts: Mapping[str, ast.expr]) -> None:
        self._parts = parts

    def visit_Name(self, node: ast.Name) -> ast.expr:
        return self._parts.get(node.id, node)


class _Inline(ast.NodeTransformer):
    """Rewrites the expressions of one relation over the program's `variables`.

    Operations in a row are taken one after the other: they may be deeper than calls may be.
    """

    def __init__(self, variables: Mapping[str, str], remembered: Remembered) -> None:
        self._variables, self._remembered = variables, remembered

    def visit_Constant(self, node: ast.Constant) -> ast.expr:
        return ast.Constant(float(node.value))

    def visit_Name(self, node: ast.Name) -> ast.expr:
        if node.id in CONSTANTS:
            return ast.Constant(CONSTANTS[node.id])
        return _variable(self._variables.get(node.id, node.id))

    def visit_BinOp(self, node: ast.BinOp) -> ast.expr:
        first, operations = row(node)
        result = self.visit(first)
        for each in operations:
            right = self.visit(each.right)
            exponent = literal(right) if isinstance(each.op, ast.Pow) else 0.0
            if exponent is None or exponent != math.floor(exponent):
                result = _call("power", result, right)
            else:
                result = ast.BinOp(result, each.op, right)
        return result

    def visit_Call(self, node: ast.Call) -> ast.expr:
        self.generic_visit(node)
        assert isinstance(node.func, ast.Name)
        return self._remembered(node.func.id, node.args) if node.func.id in STATEFUL else node


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
        if any(ELAPSED in each.names for each in code.relations):
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
        lines: List[str] = []
        ready: List[str] = []  # the variables that must have values before the relation has one
        variables, timed = dict(relation.arguments), ELAPSED in relation.names

        def evaluate(name: str, tree: ast.expr) -> None:
            used = {node.id for node in ast.walk(tree) if isinstance(node, ast.Name)}
            needed = [each for each in ready if each in used]
            lines.extend([f"{name} = nan", *self._assign(name, tree, needed)])
            ready.append(name)

        def remembered(function: str, arguments: List[ast.expr]) -> ast.expr:
            if self._steady:
                return arguments[0]  # which it becomes once all of them stand still
            name, call = self._memory_of(function, arguments)
            evaluate(name, call)
            return _variable(name)

        visit = _Inline(variables, remembered).visit
        constraint = visit(relation.constraint) if relation.constraint else None
        for number, (name, tree) in enumerate(relation.steps, 1):
            evaluate(f"{relation.result}_{number}", visit(tree))
            variables[name] = ready[-1]
        expression = visit(relation.expression)
        if isinstance(expression, ast.Name) and expression.id in self._sums:
            self._sums[relation.result] = self._sums.pop(expression.id)
        ready += [ELAPSED] if timed else []
        holds = [] if constraint is None else [self._part(constraint)]
        lines += self._assign(relation.result, expression, ready, holds)
        if relation.arguments:
            guard = f"if {_finite(relation.arguments.values())}:"
            lines = [guard] + ["  " + line for line in lines]
        return [f"{relation.result} = nan"] + lines

    def _assign(
        self, name: str, tree: ast.expr, needed: Sequence[str], holds: Sequence[str] = ()
    ) -> List[str]:
        """Evaluate the tree into a variable where those `needed` have values, and all `holds`."""
        self._angles.update([name] if self._turns(tree) else ())
        self._times[name] = self._times_of(tree)
        conditions = " and ".join([*([_finite(needed)] if needed else []), *holds])
        guard = f"if {conditions}: " if conditions else ""
        line = f"  {guard}{name} = {self._part(tree)}"
        return ["try:", line, "except (ArithmeticError, ValueError): pass"]  # it has no value

    def _memory_of(self, function: str, arguments: Sequence[ast.expr]) -> Tuple[str, ast.expr]:
        """Make a memory for one use of a stateful function; return its value's name, and the call.

        A derivative is by the time of its value. It and a filter follow an angle by its turns.
        """
        (value, *others), now = arguments, _variable("now")
        turns = function in (DERIVATIVE, FILTER) and self._turns(value)
        total = [0.0]
        if function == INTEGRAL:
            memory = self._remember(integral(self._max_gap, total))
            self._sums[f"value_of{memory}"] = total
        elif function == DERIVATIVE:
            memory = self._remember(derivative(self._over[1], self._over[0]))
            now = self._moment(value)
        else:
            memory = self._remember(STATEFUL[function].call(self._max_gap))
        if turns:
            value = _call(self._remember(unwrapped()), value)
        name, call = f"value_of{memory}", _call(memory, value, *others, now)
        if turns and function == FILTER:
            self._angles.add(name)
            call = _call("wrapped", call)
        return name, call

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


def _variable(name: str) -> ast.expr:
    return ast.Name(name, ast.Load())


def _call(function: str, *arguments: ast.expr) -> ast.expr:
    return ast.Call(ast.Name(function, ast.Load()), list(arguments), [])


def _finite(names: Iterable[str]) -> str:
    """Return the fastest test that floats are finite: inf - inf and nan - nan are not 0."""
    return " == ".join([f"{name} - {name}" for name in names] + ["0.0"])
