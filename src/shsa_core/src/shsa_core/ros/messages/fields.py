"""Fields of messages: found by their text, read and written as numbers."""
import functools
import math
from typing import Any, Mapping, Optional, Tuple, Type

import genpy

from shsa_core import message_types
from shsa_core.errors import ShsaError
from shsa_core.model.field import ANGLES, Key, Step, parse_field
from shsa_core.model.field_type import FLOATS, field_type
from shsa_core.model.field_value import NAN, field_value, place_of
from shsa_core.model.rotation import angles, quaternion


class Field:
    """One number in a message type, as `twist.twist.linear.x`; see shsa_core.model.field.

    `writable`: whether a value can be written to it. Raises ShsaError if the type has no such
    field, or if it is not a number.
    """

    def __init__(self, message_class: Type[genpy.Message], text: str) -> None:
        def layout(name: str) -> Mapping[str, str]:
            if name == message_class._type:
                return message_types.layout_of(message_class)
            return message_types.layout(name)

        self._parsed = parsed = parse_field(text)
        self._text = str(parsed)
        self._type = field_type(message_class._type, text, layout)
        self._steps, self._function = parsed.steps, parsed.function
        self.writable = self._type.writable

    def get(self, message: genpy.Message) -> Optional[float]:
        """The field's value; None if the message has none, as it does not name it.

        NaN where an array is shorter than the place, or where there is no number.
        """
        return field_value(message, self._parsed)

    def set(self, message: genpy.Message, value: float) -> None:
        """Write the field; a whole number is rounded to.

        What is named by its name and not there yet is added to the message. Raises ShsaError if the
        value does not fit, or if an array has no such element.
        """
        if not self.writable:
            raise ShsaError(f"{self._text} can be read alone")
        owner: Any = message
        for step in self._steps[:-1]:
            owner = self._inner(owner, step)
        last = self._steps[-1]
        if self._function:
            self._turn(self._inner(owner, last), value)
            return
        plain = self._type.fit(value)
        if last.part is None:
            setattr(owner, last.name, plain)
        else:
            self._put(owner, last, plain)

    def _inner(self, owner: Any, step: Step) -> Any:
        """The message that a step leads to; it must be there."""
        found = getattr(owner, step.name)
        if step.part is None:
            return found
        place = place_of(owner, step.part)
        if place is None or place >= len(found):
            raise ShsaError(f"{self._text}: the message has no {step}, and no other one is known")
        return found[place]

    def _turn(self, rotation: Any, angle: float) -> None:
        """Set one angle of a rotation; the other two stay."""
        turned = [0.0 if math.isnan(each) else each for each in angles(*_components(rotation))]
        turned[ANGLES.index(self._function)] = angle
        for name, each in zip("xyzw", quaternion(*turned)):
            setattr(rotation, name, each)

    def _put(self, owner: Any, step: Step, value: float) -> None:
        """Set an element of an array; one that is named and not there is added, and its name."""
        place = place_of(owner, step.part)
        if place is None and isinstance(step.part, Key):
            place = _add_name(owner, step.part)
        array = list(getattr(owner, step.name))
        if isinstance(step.part, Key) and self._type.kind in FLOATS:
            # What is beside it in the array is not known; only such numbers can say so.
            array += [NAN] * ((place or 0) - len(array))
        if place is None or place > len(array):
            raise ShsaError(
                f"{self._text}: the array has {len(array)} elements, and no message that has more "
                "is known"
            )
        array[place : place + 1] = [value]
        setattr(owner, step.name, array)


@functools.lru_cache(maxsize=None)
def problem(message_type: str, text: str, written: bool) -> str:
    """Why a field cannot be read, or written, on this computer; empty if it can.

    Whoever has asked once knows the answer at a takeover.
    """
    try:
        field = Field(message_types.message_class(message_type), text)
    except ShsaError as error:
        return str(error)
    return f"{text} can be read alone" if written and not field.writable else ""


def _components(rotation: Any) -> Tuple[float, float, float, float]:
    return rotation.x, rotation.y, rotation.z, rotation.w


def _add_name(owner: Any, key: Key) -> int:
    """Add a name to its array; its place. What the arrays beside it have there is not known."""
    names = list(getattr(owner, key.names))
    for name, kind in message_types.layout_of(owner).items():
        array = getattr(owner, name)
        if not kind.endswith("[]") or name == key.names or not names or len(array) != len(names):
            continue
        if kind[:-2] not in FLOATS:
            raise ShsaError(f"{key.name} cannot be added: {name} has no mark for what is not known")
        setattr(owner, name, [*array, NAN])
    setattr(owner, key.names, [*names, key.name])
    return len(names)
