"""Fitted models as relations: what is generated computes what the model does."""
import sys
from itertools import combinations_with_replacement
from typing import Callable, Dict, List, Mapping, Sequence

import numpy as np
import pytest

from shsa_core.codegen.generator import generate
from shsa_core.codegen.program import CompiledProgram, compile_program, compile_steady
from shsa_core.errors import CodeError
from shsa_core.language.expression import Law, compose, parse_expression
from shsa_core.model.ontology import TransferFunction
from shsa_core.model.service import Provision, Service
from shsa_core.search.derivation import Derivation

NAMES = ("v", "a", "w", "alpha", "u")
Step = Callable[[Sequence[float]], float]


def law(function: str, where: Mapping[str, str] = {}) -> Law:
    steps = {name: parse_expression(text) for name, text in where.items()}
    return compose(steps, parse_expression(function))


def generated(of: Law) -> Step:
    """The law as a substitute evaluates it, on the values of NAMES."""
    sources = {
        name: Service(name, "/" + name, "p/T", "/n", 0.02, (Provision(name, "data"),)).sources[0]
        for name in NAMES
    }
    inputs = tuple(Derivation(name, sources[name], None) for name in of.names)
    function = TransferFunction("r", "i", of.names, of, text=of.text)
    program = generate([(Derivation("i", None, function, inputs), "/i/data")], {})
    step = compile_program(program.code, len(of.names), 1).step

    def evaluate(x: Sequence[float]) -> float:
        by_name: Dict[str, float] = dict(zip(NAMES, x))
        result = step([by_name[name] for name in of.names], 0.0)
        assert result is not None
        return result[0]

    return evaluate


def number(value: float) -> str:
    return f"({value!r})" if value < 0 else repr(value)


def total(terms: Sequence[str]) -> str:
    return " + ".join(terms)


def agree(step: Step, expected: Callable[[np.ndarray], np.ndarray]) -> None:
    x = np.random.RandomState(5).uniform(-3.0, 3.0, (200, len(NAMES)))
    results = np.array([step([float(each) for each in row]) for row in x])
    assert np.max(np.abs(results - expected(x))) < 1e-9


@pytest.mark.parametrize("by_dot", [False, True])
def test_a_network_of_16_neurons(by_dot: bool) -> None:
    random = np.random.RandomState(1)
    hidden, bias = random.normal(size=(16, 5)), random.normal(size=16)
    output, offset = random.normal(size=16), 8.1

    def weighted(weights: np.ndarray, names: Sequence[str]) -> str:
        pairs = [(number(float(w)), name) for w, name in zip(weights, names)]
        if by_dot:
            return f"dot({', '.join(each for pair in pairs for each in pair)})"
        return total([f"{w}*{name}" for w, name in pairs])

    where = {
        f"h{k}": f"tanh({weighted(row, NAMES)} + {number(float(b))})"
        for k, (row, b) in enumerate(zip(hidden, bias), 1)
    }
    step = generated(law(f"{weighted(output, list(where))} + {offset}", where))
    agree(step, lambda x: np.tanh(x @ hidden.T + bias) @ output + offset)


def test_a_network_of_two_layers_with_inputs_brought_to_one_scale() -> None:
    random = np.random.RandomState(2)
    first, second = random.normal(size=(8, 5)), random.normal(size=(6, 8))
    output, mean, scale = random.normal(size=6), random.normal(size=5), 1.5
    where = {
        f"z{k}": f"(clip({name}, -2, 2) - {number(float(m))})/{scale}"
        for k, (name, m) in enumerate(zip(NAMES, mean))
    }
    layers = [("z", first, "p"), ("p", second, "q")]
    for before, weights, after in layers:
        for k, row in enumerate(weights):
            terms = [f"{number(float(w))}*{before}{j}" for j, w in enumerate(row)]
            where[f"{after}{k}"] = f"tanh({total(terms)})"
    function = total([f"{number(float(w))}*q{k}" for k, w in enumerate(output)])

    def expected(x: np.ndarray) -> np.ndarray:
        z = (np.clip(x, -2, 2) - mean) / scale
        return np.tanh(np.tanh(z @ first.T) @ second.T) @ output

    agree(generated(law(function, where)), expected)


def test_a_polynomial_of_degree_3() -> None:
    powers = [p for d in range(4) for p in combinations_with_replacement(range(5), d)]
    weights = np.random.RandomState(3).normal(size=len(powers))
    terms = ["*".join([number(float(w)), *(NAMES[i] for i in p)]) for w, p in zip(weights, powers)]

    def expected(x: np.ndarray) -> np.ndarray:
        columns = [np.prod(x[:, list(p)], axis=1) for p in powers]
        return np.stack(columns, axis=1) @ weights

    agree(generated(law(total(terms))), expected)


def test_support_vectors() -> None:
    random = np.random.RandomState(4)
    vectors, weights, gamma = random.normal(size=(200, 5)), random.normal(size=200), 0.3

    def bell(vector: np.ndarray) -> str:
        pairs = [f"{name}, {number(float(c))}" for name, c in zip(NAMES, vector)]
        return f"rbf({gamma}, {', '.join(pairs)})"

    terms = [f"{number(float(w))}*{bell(v)}" for w, v in zip(weights, vectors)]

    def expected(x: np.ndarray) -> np.ndarray:
        squares = ((x[:, None, :] - vectors[None]) ** 2).sum(axis=2)
        return np.exp(-gamma * squares) @ weights - 0.25

    agree(generated(law(total(terms) + " - 0.25")), expected)


def test_a_table() -> None:
    xs, ys = [-2.0, -0.5, 1.0, 2.5], [4.0, -1.0, 0.5, 9.0]
    points = ", ".join(f"{x}, {y}" for x, y in zip(xs, ys))
    agree(generated(law(f"table(v, {points})")), lambda x: np.interp(x[:, 0], xs, ys))


@pytest.mark.parametrize("count", [2, 16, 17, 64, 65, 500])
def test_a_sum_of_products_however_long(count: int) -> None:
    weights = np.random.RandomState(6).normal(size=count)
    pairs: List[str] = []
    for k, w in enumerate(weights):
        pairs += [number(float(w)), NAMES[k % 5]]
    columns = [k % 5 for k in range(count)]
    agree(generated(law(f"dot({', '.join(pairs)})")), lambda x: x[:, columns] @ weights)


@pytest.mark.parametrize("sign, count", [("+", 500), ("-", 500), ("*", 500), ("/", 500)])
def test_terms_in_a_row(sign: str, count: int) -> None:
    text = f" {sign} ".join(["(1.1 + 0*v)"] * count)
    expected = {"+": 550.0, "-": 1.1 - 1.1 * 499, "*": 1.1**500, "/": 1.1**-498}[sign]
    assert generated(law(text))([0.5] * 5) == pytest.approx(expected, rel=1e-9)


def test_what_it_computes_at_rest() -> None:
    terms = " + ".join(["lowpass(i1, 0.5)"] * 500)
    code = f"t0=x[0];\ndef _tf1(i1):\n  h=delay(i1, 0.1)\n  return h + {terms}\nt1=_tf1(t0)\ny=t1\n"
    steady = compile_steady(code, 1, 1)
    assert steady is not None and steady((2.0,), 0.0) == (1002.0,)


@pytest.mark.skipif(sys.version_info < (3, 9), reason="the older parser has room of its own")
def test_where_the_interpreter_has_no_room_left_it_is_refused() -> None:
    code = f"t0=x[0];\ndef _tf1(i1):\n  return {'+'.join(['i1'] * 500)}\nt1=_tf1(t0)\ny=t1\n"

    def called(depth: int) -> CompiledProgram:
        return called(depth - 1) if depth else compile_program(code, 1, 1)

    assert called(0).step((2.0,), 0.0) == (1000.0,)
    with pytest.raises(CodeError, match="^the code is nested too deeply to be compiled here$"):
        called(sys.getrecursionlimit() - 350)


def test_the_deepest_law_that_is_read_can_be_compiled() -> None:
    """As deep as may be in every way at once: nested, and in a row."""
    text = "dot(" + ", ".join(["0.5", "v"] * 32) + ")"
    for level in range(48):
        text = f"abs({text}" + " - v" * 11 + ")"
    text += " + v" * 12
    assert generated(law(text))([0.0] * 5) == 0.0
