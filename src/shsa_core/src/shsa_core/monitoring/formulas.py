"""Follows the formula of a service through the messages of one publisher."""
from typing import List, Mapping, Tuple

from shsa_core.codegen.program import Step, compile_program
from shsa_core.language.expression import Expression
from shsa_core.language.temporal import Formula, Truth
from shsa_core.model.samples import FormulaSample


class FormulaRun:
    """A formula and what it remembers of the messages so far."""

    def __init__(self, formula: Formula) -> None:
        self._names = formula.names
        self._decide = formula.root.judge()
        self._steps: List[Tuple[Tuple[str, ...], Step]] = [
            (each.names, _step(each)) for each in formula.conditions
        ]

    def sample(self, now: float, waited: float, values: Mapping[str, float]) -> FormulaSample:
        """Return the truth at a message, which may have `waited` for us for so many s.

        A condition whose values are not there is unknown.
        """
        truths = [_truth(names, step, now, values) for names, step in self._steps]
        seen = tuple((name, values[name]) for name in self._names if name in values)
        return FormulaSample(self._decide((now, now - waited), truths), seen)


def _truth(names: Tuple[str, ...], step: Step, now: float, values: Mapping[str, float]) -> Truth:
    result = None
    if all(name in values for name in names):
        result = step([values[name] for name in names], now)
    return None if result is None else result[0] == 1.0


def _step(condition: Expression) -> Step:
    count = len(condition.names)
    inputs, given = [f"t{n}" for n in range(count)], [f"i{n + 1}" for n in range(count)]
    lines = [
        *(f"t{n}=x[{n}]" for n in range(count)),
        f"def _tf1({','.join(given)}):",
        f"  return {condition.code(dict(zip(condition.names, given)))}",
        f"t{count}=_tf1({','.join(inputs)})",
        f"y=t{count}",
    ]
    return compile_program("\n".join(lines), count, 1).step
