"""Cost of one evaluation of a substitute, beside a hand-written function.

Both get the same inputs in turn, in many short rounds, so that other work on the machine hits both;
the time is that of the processor. Prints the ratio (median and 95th percentile over the rounds) and
writes evaluate.csv and evaluate_goals.csv.
"""
import argparse
import csv
import math
import random
import time
import timeit
from pathlib import Path
from typing import Any, Callable, Dict, List, NamedTuple, Optional, Sequence, Tuple

from report import Goals, print_table, summary

from shsa_core.codegen.generator import generate
from shsa_core.codegen.program import compile_program
from shsa_core.language.expression import parse_constraint, parse_law
from shsa_core.model.ontology import Constant, TransferFunction
from shsa_core.model.service import Provision, Service
from shsa_core.search.derivation import Derivation

ROOT = Path(__file__).resolve().parents[3]
GOAL = 2.0

Hand = Callable[[Sequence[float], float], Optional[float]]


class Case(NamedTuple):
    """A substitute: the laws of its relations in order, and the same by hand."""

    name: str
    laws: Sequence[Tuple[str, str, Optional[str]]]
    inputs: Sequence[str]
    hand: Hand
    x: Tuple[float, ...]


def f1_by_hand(x: Sequence[float], now: float) -> Optional[float]:
    """Return the published terms of relation f1 of the paper."""
    return 48.67 - 0.03 * abs(x[0]) - 1.17 * abs(x[1])


def current_by_hand(x: Sequence[float], now: float) -> Optional[float]:
    """Current from power and voltage, with a constraint."""
    if not x[1] > 10:
        return None
    return x[0] / x[1]


def chain_by_hand(x: Sequence[float], now: float) -> Optional[float]:
    """Wheels to velocity to power to current."""
    velocity = (x[0] + x[1]) / 2
    power = 29.7 * velocity * x[2] + 18.8 * abs(velocity) + 8.0 * velocity**2 + 30.57
    return power / x[3]


def polynomial_by_hand(x: Sequence[float], now: float) -> Optional[float]:
    """Twelve terms of three inputs."""
    a, b, c = x
    return (
        1.5
        + 0.1 * a
        - 0.2 * b
        + 0.3 * c
        + 0.4 * a * b
        - 0.5 * b * c
        + 0.6 * a * c
        + 0.7 * a**2
        - 0.8 * b**2
        + 0.9 * c**2
        + math.sin(a)
        - math.sqrt(c)
    )


class FilterByHand:
    """The derivative of a first-order low-pass, with the same care for gaps."""

    def __init__(self) -> None:
        self.time = math.nan
        self.filtered = math.nan

    def __call__(self, x: Sequence[float], now: float) -> Optional[float]:
        elapsed = now - self.time
        before = self.filtered
        self.time = now
        if not 0.0 < elapsed <= 1.0 or not math.isfinite(x[0]):
            self.filtered = x[0]
            return None
        self.filtered = before + (x[0] - before) * -math.expm1(-elapsed / 0.5)
        return (self.filtered - before) / elapsed


def network(neurons: int, names: Sequence[str], sums: str) -> Tuple[str, Hand]:
    """The law of a layer of tanh neurons, its sums as such or by `dot`, and the same by hand.

    By hand: every neuron a line of arithmetic.
    """
    draw = random.Random(1)
    weights = [[round(draw.gauss(0.0, 1.0), 3) for _ in names] for _ in range(neurons)]
    lines, steps = ["def hand(x, now):", f"  {', '.join(names)} = x"], []
    for number, row in enumerate(weights):
        written = " + ".join(f"{weight}*{name}" for weight, name in zip(row, names))
        pairs = ", ".join(f"{weight}, {name}" for weight, name in zip(row, names))
        lines.append(f"  h{number} = tanh({written} + 0.1)")
        steps.append(f"h{number} = tanh({written if sums == '+' else f'dot({pairs})'} + 0.1)")
    result = " + ".join(f"{0.1 * number:.1f}*h{number}" for number in range(neurons))
    known: Dict[str, Any] = {"tanh": math.tanh}
    exec("\n".join([*lines, f"  return {result} + 8.1"]), known)
    return "; ".join([*steps, f"{result} + 8.1"]), known["hand"]


FIVE = ("v", "a", "w", "alpha", "u")
NETWORK, NETWORK_BY_HAND = network(16, FIVE, "+")
NETWORK_BY_DOT, _ = network(16, FIVE, "dot")
POLYNOMIAL = (
    "1.5 + 0.1*a - 0.2*b + 0.3*c + 0.4*a*b - 0.5*b*c + 0.6*a*c "
    "+ 0.7*a**2 - 0.8*b**2 + 0.9*c**2 + sin(a) - sqrt(c)"
)
CASES = (
    Case("passed on", (), ("a",), lambda x, now: x[0], (1.5,)),
    Case(
        "f1 of the paper (published terms)",
        (("i", "48.67 - 0.03*abs(v) - 1.17*abs(a)", None),),
        ("v", "a"),
        f1_by_hand,
        (0.8, -0.3),
    ),
    Case(
        "one division with a constraint",
        (("i", "p/u", "u > 10"),),
        ("p", "u"),
        current_by_hand,
        (120.0, 12.4),
    ),
    Case(
        "three relations in a row",
        (
            ("v", "(l + r)/2", None),
            ("p", "mass*v*a + 18.8*abs(v) + 8.0*v**2 + 30.57", None),
            ("i", "p/u", None),
        ),
        ("l", "r", "a", "u"),
        chain_by_hand,
        (0.7, 0.9, 0.2, 12.4),
    ),
    Case(
        "twelve terms",
        (("z", POLYNOMIAL, None),),
        ("a", "b", "c"),
        polynomial_by_hand,
        (0.5, 2.0, 3.0),
    ),
    Case(
        "network of 16 neurons",
        (("i", NETWORK, None),),
        FIVE,
        NETWORK_BY_HAND,
        (0.8, -0.3, 0.5, 0.1, 1.2),
    ),
    Case(
        "network of 16 neurons, by dot",
        (("i", NETWORK_BY_DOT, None),),
        FIVE,
        NETWORK_BY_HAND,
        (0.8, -0.3, 0.5, 0.1, 1.2),
    ),
    Case(
        "derivative(lowpass(v, 0.5))",
        (("a", "derivative(lowpass(v, 0.5))", None),),
        ("v",),
        FilterByHand(),
        (0.8,),
    ),
)
CONSTANTS = {"mass": Constant("mass", 29.7, "kg")}


def compiled(case: Case) -> Callable[[Sequence[float], float], Optional[Tuple[float, ...]]]:
    """Return the case as a substitute evaluates it."""
    known: Dict[str, Derivation] = {}
    for name in case.inputs:
        provides = (Provision(name, "data"),)
        (source,) = Service(name, "/" + name, "package/Type", "/n", 0.02, provides).sources
        known[name] = Derivation(name, source, None)
    inputs = [known[name] for name in case.inputs]
    result = inputs[0]
    for number, (output, law, condition) in enumerate(case.laws, 1):
        expression = parse_law(law)
        constraint = parse_constraint(condition) if condition else None
        names = [*expression.names, *(constraint.names if constraint else ())]
        used = tuple(dict.fromkeys(name for name in names if name not in CONSTANTS))
        function = TransferFunction(f"r{number}", output, used, expression, 1.0, constraint)
        result = Derivation(output, None, function, tuple(known[name] for name in used))
        known[output] = result
    program = generate([(result, "/output/data")], CONSTANTS)
    assert program.inputs == tuple(
        derivation.source.path for derivation in inputs if derivation.source
    )
    return compile_program(program.code, len(program.inputs), 1).step


def measure(case: Case, rounds: int, calls: int) -> List[Tuple[float, float]]:
    """Seconds of one call, by the substitute and by hand, in each round."""
    step, hand, x = compiled(case), case.hand, case.x
    for moment in (0.0, 0.02):
        result, expected = step(x, moment), hand(x, moment)
    assert result is not None and expected is not None and math.isclose(result[0], expected)
    moments = [0.04 + 0.02 * i for i in range(calls)]

    def run(function: Callable[[Sequence[float], float], object]) -> float:
        def loop() -> None:
            for now in moments:
                function(x, now)

        return timeit.timeit(loop, number=1, timer=time.process_time) / calls

    return [(run(step), run(hand)) for _ in range(rounds)]


def main() -> None:
    """Measures every case."""
    parser = argparse.ArgumentParser(description="Cost of evaluating a substitute once.")
    parser.add_argument("--rounds", type=int, default=200)
    parser.add_argument("--calls", type=int, default=2000, help="calls in each round")
    parser.add_argument("--results", type=Path, default=ROOT / "results" / "bench")
    args = parser.parse_args()
    args.results.mkdir(parents=True, exist_ok=True)
    columns = ("substitute", "ns", "by hand, ns", "times (median)", "p95")
    table: List[Tuple[str, ...]] = []
    goals = Goals()
    with open(args.results / "evaluate.csv", "w", newline="") as stream:
        writer = csv.writer(stream)
        writer.writerow(["case", "round", "substitute_s", "hand_s"])
        for case in CASES:
            times = measure(case, args.rounds, args.calls)
            writer.writerows([case.name, i, *pair] for i, pair in enumerate(times))
            median, p95, _ = summary([mine / hand for mine, hand in times])
            mine, hand = (summary([pair[i] for pair in times])[0] * 1e9 for i in (0, 1))
            figures = (f"{mine:.0f}", f"{hand:.0f}", f"{median:.2f}", f"{p95:.2f}")
            table.append((case.name, *figures))
            goals.at_most(f"{case.name}, times the same by hand", "", GOAL, median, "")
    print_table("One evaluation", columns, table)
    goals.show(args.results / "evaluate_goals.csv")


if __name__ == "__main__":
    main()
