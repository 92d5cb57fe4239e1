"""The values of a message that a fault changes: also to what no sound node would write."""
import math
from typing import Any, Optional, Type

import genpy

from shsa_core.errors import ShsaError
from shsa_core.model.field import ANGLES, Named, Span, Step, parse_field
from shsa_core.model.field_value import Field


class FaultyValue:
    """One value of a message; of what is computed from an array, all of its elements."""

    def __init__(self, message_class: Type[genpy.Message], text: str) -> None:
        self._field = Field(message_class, text)
        parsed = parse_field(text)
        self._steps, self._function = parsed.steps, parsed.function

    def get(self, message: genpy.Message) -> Optional[float]:
        """Return the value; None if the message has none."""
        return self._field.get(message)

    def set(self, message: genpy.Message, value: float) -> None:
        """Write it. A whole number takes what it can hold: else 0, 1 or -1."""
        if math.isfinite(value) and self._field.writable:
            for fitting in (value, math.copysign(1.0, value), 0.0):
                try:
                    self._field.set(message, fitting)
                    return
                except ShsaError:
                    continue
            return
        owner: Any = message
        for step in self._steps[:-1]:
            owner = _inner(owner, step)
        last = self._steps[-1]
        if self._function in ANGLES:
            rotation = _inner(owner, last)
            for name in "xyzw":
                setattr(rotation, name, value)
        elif isinstance(last.part, (int, Named)):
            _write(owner, last.name, value, _place(owner, last))
        elif self._function or isinstance(last.part, Span):
            _write(owner, last.name, value, last.part)
        elif isinstance(getattr(owner, last.name), float):
            setattr(owner, last.name, value)
        else:
            setattr(owner, last.name, 0)


def _inner(owner: Any, step: Step) -> Any:
    found = getattr(owner, step.name)
    return found if step.part is None else found[_place(owner, step)]


def _place(owner: Any, step: Step) -> int:
    if isinstance(step.part, Named):
        return int(getattr(owner, step.part.names).index(step.part.name))
    assert isinstance(step.part, int)
    return step.part


def _write(owner: Any, name: str, value: float, where: Any) -> None:
    """Write one element of an array, or those of a slice of it; None: all."""
    array = list(getattr(owner, name))
    place = slice(where, where + 1) if isinstance(where, int) else slice(None)
    if isinstance(where, Span):
        place = slice(where.start, where.stop)
    fits = math.isfinite(value) or all(isinstance(each, float) for each in array[place])
    array[place] = [value if fits else 0] * len(array[place])
    setattr(owner, name, array)
