"""The value of a field in a message, whatever class the message is of."""
from typing import Any, Optional

from shsa_core.model.field import ANGLES, FieldText, Index, Key, Selector, Span
from shsa_core.model.reduction import REDUCE
from shsa_core.model.rotation import angles

NAN = float("nan")


def field_value(message: Any, field: FieldText) -> Optional[float]:
    """The field's value; None if the message has none, as it does not name it.

    NaN where an array is shorter than the place, or where there is no number. The message's type
    has the field: `field_type` says so.
    """
    value = message
    for step in field.steps:
        owner, value, part = value, getattr(value, step.name), step.part
        if isinstance(part, Index):
            if part.place >= len(value):
                return NAN
            value = value[part.place]
        elif isinstance(part, Key):
            place = place_of(owner, part)
            if place is None or place >= len(value):
                return None
            value = value[place]
        elif isinstance(part, Span):
            value = value[part.start : part.stop]
    if not field.function:
        return float(value)
    if field.function in ANGLES:
        return angles(value.x, value.y, value.z, value.w)[ANGLES.index(field.function)]
    return REDUCE[field.function](value)


def place_of(owner: Any, part: Selector) -> Optional[int]:
    """The place of an element in its array; None where its name is not there."""
    if isinstance(part, Key):
        names = getattr(owner, part.names)
        return names.index(part.name) if part.name in names else None
    return part.place if isinstance(part, Index) else None
