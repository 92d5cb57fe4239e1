"""Fields of messages: found by their path, read and written as numbers."""
import re
from typing import Any, List, Tuple, Type, Union

import genpy

from shsa_core.errors import ShsaError

FLOATS = ("float32", "float64")
NUMBERS = FLOATS + ("int8", "int16", "int32", "int64", "uint8", "uint16", "uint32", "uint64")
STEP = re.compile(r"([A-Za-z]\w*)(?:\[(\d+)\])?$")


class Field:
    """One numeric field of a message type, as `twist.twist.linear.x` or `ranges[3]`.

    Raises ShsaError if the type has no such field, or if it is not a number.
    """

    def __init__(self, message_class: Type[genpy.Message], path: str) -> None:
        self._steps: List[Union[str, int]] = []
        self._type = _resolve(message_class, path, self._steps)
        if self._type not in NUMBERS + ("bool",):
            raise ShsaError(f"{message_class._type}: field {path} is a {self._type}, not a number")

    def get(self, message: genpy.Message) -> float:
        """The field's value; NaN where an array is shorter than the index."""
        value: Any = message
        for step in self._steps:
            if isinstance(step, str):
                value = getattr(value, step)
            elif step < len(value):
                value = value[step]
            else:
                return float("nan")
        return float(value)

    def set(self, message: genpy.Message, value: float) -> None:
        """Write the field; a whole number is rounded to."""
        last = self._steps[-1]
        owner: Any = message
        for step in self._steps[:-1]:
            owner = getattr(owner, step) if isinstance(step, str) else owner[step]
        plain = value if self._type in FLOATS else int(round(value))
        if isinstance(last, str):
            setattr(owner, last, plain)
        else:
            owner[last] = plain


def _resolve(message_class: Type[genpy.Message], path: str, steps: List[Union[str, int]]) -> str:
    """Append the steps of `path` to `steps`; the type at its end."""
    current = message_class._type
    holder = message_class
    for name, index in _parse(message_class._type, path):
        slots = dict(zip(holder.__slots__, holder._slot_types)) if holder else {}
        if name not in slots:
            known = ", ".join(slots) or "none"
            raise ShsaError(
                f"{message_class._type} has no field {path}: {name} is not one of {known}"
            )
        steps.append(name)
        current = slots[name]
        if index is not None:
            if "[" not in current:
                raise ShsaError(f"{message_class._type}: field {name} is not an array")
            current = current[: current.index("[")]
            steps.append(index)
        holder = genpy.message.get_message_class(current) if "/" in current else None
    return current


def _parse(message_type: str, path: str) -> List[Tuple[str, Any]]:
    parsed = []
    for part in re.split(r"[./]", path):
        match = STEP.match(part)
        if match is None:
            raise ShsaError(
                f"{message_type}: {path} is not a field, such as data or pose.position.x"
            )
        parsed.append((match.group(1), None if match.group(2) is None else int(match.group(2))))
    return parsed


def unknown_message(message_class: Type[genpy.Message]) -> genpy.Message:
    """A message whose floating-point fields are NaN: nothing is claimed that is not known.

    Headers, arrays and whole numbers keep their defaults.
    """
    message = message_class()
    for name, kind in zip(message.__slots__, message._slot_types):
        if kind in FLOATS:
            setattr(message, name, float("nan"))
        elif "/" in kind and "[" not in kind and kind != "std_msgs/Header":
            setattr(message, name, unknown_message(type(getattr(message, name))))
    return message
