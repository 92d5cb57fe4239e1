"""The type of a field: which kind of number it is, and what it can hold."""
import math
from dataclasses import dataclass
from typing import Callable, Dict, Mapping, Tuple

from shsa_core.errors import ShsaError, listed
from shsa_core.model.field import ANGLES, REDUCTIONS, Named, Span, Step, parse_field
from shsa_core.text import nearest

Layout = Callable[[str], Mapping[str, str]]
"""The fields of a message type and their types, as in its .msg file; raises ShsaError."""

FLOATS = {"float32": 3.4028234663852886e38, "float64": math.inf}
WHOLE: Dict[str, Tuple[int, int]] = {
    **{f"int{bits}": (-(2 ** (bits - 1)), 2 ** (bits - 1) - 1) for bits in (8, 16, 32, 64)},
    **{f"uint{bits}": (0, 2**bits - 1) for bits in (8, 16, 32, 64)},
    "bool": (0, 1),
    "byte": (-128, 127),
    "char": (0, 255),
}


@dataclass(frozen=True)
class FieldType:
    """A field that is a number: of the type `kind`, or computed. It holds `low` to `high`."""

    kind: str
    low: float
    high: float

    def fit(self, value: float) -> float:
        """Return the value as the field holds it; a whole number is rounded to.

        Raises ShsaError if it does not fit.
        """
        if self.kind in WHOLE and math.isfinite(value):
            value = round(value)
        if self.low <= value <= self.high:
            return value
        raise ShsaError(f"{value:g} does not fit into {self.kind}, {self.low:g} to {self.high:g}")


def field_type(message_type: str, field: str, layout: Layout) -> FieldType:
    """Return the type of a field. Raises ShsaError if there is none, or if it is no number."""
    parsed = parse_field(field)
    kind = message_type
    for step in parsed.steps:
        reduces = parsed.function in REDUCTIONS and step is parsed.steps[-1]
        try:
            kind = _enter(kind, step, reduces, layout)
        except ShsaError as error:
            raise ShsaError(f"{message_type} has no field {field}: {error}") from error
    if parsed.function in ANGLES:
        if "/" not in kind or not {"x", "y", "z", "w"} <= set(layout(kind)):
            raise ShsaError(f"{message_type}: {field} is of a quaternion, and this is a {kind}")
        high = math.pi / 2 if parsed.function == "pitch" else math.pi
        return FieldType("an angle in rad", -high, high)
    if kind not in FLOATS and kind not in WHOLE:
        raise ShsaError(f"{message_type}: field {field} is a {kind}, not a number")
    if parsed.function in REDUCTIONS:
        low = 0.0 if parsed.function == "count" else -math.inf
        return FieldType(f"the {parsed.function} of an array", low, math.inf)
    low, high = WHOLE[kind] if kind in WHOLE else (-FLOATS[kind], FLOATS[kind])
    return FieldType(kind, low, high)


def _enter(kind: str, step: Step, reduces: bool, layout: Layout) -> str:
    if "/" not in kind:
        raise ShsaError(f"a {kind} has no fields")
    fields = layout(kind)
    if step.name not in fields:
        known = listed(list(fields)) or "none"
        raise ShsaError(f"{step.name} is not one of {known}{nearest(step.name, fields)}")
    element, bracket, size = fields[step.name].partition("[")
    if not bracket:
        if step.part is not None or reduces:
            raise ShsaError(f"field {step.name} is not an array")
    elif step.part is None and not reduces:
        raise ShsaError(f"field {step.name} is an array: its first element is {step.name}[0]")
    part = step.part
    end = part.stop if isinstance(part, Span) else part + 1 if isinstance(part, int) else None
    if size[:-1] and end is not None and end > int(size[:-1]):
        raise ShsaError(f"{step} is beyond the array, whose last place is {int(size[:-1]) - 1}")
    if isinstance(part, Named) and fields.get(part.names) != "string[]":
        raise ShsaError(f"{step} needs an array of texts {part.names} beside {step.name}")
    return element
