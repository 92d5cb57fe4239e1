"""A law with names for values on the way: what a file has under `where` and `function`."""
from dataclasses import dataclass
from typing import Any, Dict, List, Mapping, Optional, Tuple

from shsa_core.errors import ExpressionError
from shsa_core.language.expression import Expression, parse_expression
from shsa_core.language.interval import Interval
from shsa_core.language.law import Law
from shsa_core.language.range_check import Trouble, find_troubles
from shsa_core.language.syntax import MAX_LENGTH, MAX_STEPS, is_free
from shsa_core.language.unit_check import Mismatch, find_mismatches
from shsa_core.language.units import Unit


@dataclass(frozen=True)
class Composition:
    """Expressions one after the other, each with a name for those behind it: a Law.

    `compose` makes one that is valid.
    """

    steps: Tuple[Tuple[str, Expression], ...]
    result: Expression

    @property
    def text(self) -> str:
        """All of it in one line."""
        return "; ".join(
            [*(f"{name} = {step.text}" for name, step in self.steps), self.result.text]
        )

    @property
    def entry(self) -> Mapping[str, Any]:
        """As it stands in an ontology file."""
        where = {name: step.text for name, step in self.steps}
        return {"where": where, "function": self.result.text}

    @property
    def names(self) -> Tuple[str, ...]:
        """Its inputs, in order of first use."""
        own = {name for name, _ in self.steps}
        used = [name for part in self._parts() for name in part.names if name not in own]
        return tuple(dict.fromkeys(used))

    def mismatches(
        self, units: Mapping[str, Optional[Unit]], result: Optional[Unit]
    ) -> List[Mismatch]:
        """What cannot match if it should give the unit `result`."""
        steps = [(name, step.tree()) for name, step in self.steps]
        return find_mismatches(self.result.tree(), units, result, steps)

    def troubles(
        self,
        ranges: Mapping[str, Interval],
        always: Optional[Mapping[str, Interval]] = None,
    ) -> List[Trouble]:
        """Where it may have no value."""
        steps = [(name, step.text, step.tree()) for name, step in self.steps]
        return find_troubles(self.result.text, self.result.tree(), ranges, always, steps)

    def body(self, inputs: Mapping[str, str]) -> List[str]:
        """The lines of the generated function."""
        known = {**inputs, **{name: name for name, _ in self.steps}}
        lines = [f"{name}={step.code(known)}" for name, step in self.steps]
        return [*lines, *self.result.body(known)]

    def _parts(self) -> Tuple[Expression, ...]:
        return (*(step for _, step in self.steps), self.result)


def compose(steps: Mapping[str, Expression], result: Expression) -> Composition:
    """A law of some steps, in order, and its result. Raises ExpressionError where one is wrong."""
    law = Composition(tuple(steps.items()), result)
    if not 1 <= len(steps) <= MAX_STEPS:
        raise ExpressionError(f"'where' has {len(steps)} entries; 1 to {MAX_STEPS} are allowed")
    if len(law.text) > MAX_LENGTH:
        raise ExpressionError(
            f"all expressions have {len(law.text)} characters; at most {MAX_LENGTH} are allowed"
        )
    later = set(steps)
    used = set(result.names)
    for name, step in steps.items():
        if not is_free(name):
            raise ExpressionError(
                f"a value under 'where' cannot be named {name!a}: take letters, digits and _, no "
                "word of Python or the language, and none of generated code (_a, x, y, t0, i1)"
            )
        early = [each for each in step.names if each in later]
        if early:
            raise ExpressionError(f"{name} uses {early[0]}, which has no value before it")
        later.remove(name)
        used.update(step.names)
    idle = [name for name in steps if name not in used]
    if idle:
        raise ExpressionError(f"{idle[0]} stands under 'where' and is not used")
    return law


def parse_law(text: str) -> Law:
    """The law whose text this is. Raises ExpressionError if it is none's."""
    *parts, last = text.split(";")
    steps: Dict[str, Expression] = {}
    for part in parts:
        name, _, expression = part.partition("=")
        if name.strip() in steps:
            raise ExpressionError(f"{name.strip()!a} has a value already")
        steps[name.strip()] = parse_expression(expression)
    result = parse_expression(last)
    if steps:
        return compose(steps, result)
    return result
