"""The value of a field in a message, read and written: also one number of many, or an angle.

Angles are roll, pitch and yaw in rad about fixed axes, x, then y, then z (REP 103). Formulas:
J. Diebel, Representing Attitude: Euler Angles, Unit Quaternions, and Rotation Vectors (2006), the
sequence (1, 2, 3), with the quaternion of the rotation from the body to the world.
"""
from functools import lru_cache
from math import asin, atan2, copysign, cos, fsum, hypot, isfinite, nan, pi, sin
from typing import Any, Callable, Dict, Mapping, Optional, Sequence, Tuple

from shsa_core import message_types
from shsa_core.errors import ShsaError
from shsa_core.model.field import ANGLES, FieldText, Named, Selector, Span, Step
from shsa_core.model.field import parse_field, reduces
from shsa_core.model.field_type import FLOATS, field_type

SHORTEST = 1e-6
"""A shorter quaternion stands for none."""


def field_value(message: Any, field: FieldText) -> Optional[float]:
    """Return the field's value; None if the message does not name it.

    NaN where an array is too short. The message's type has the field: `field_type` says so.
    """
    value = message
    for step in field.steps:
        value = _entered(value, step)
        if value is None:
            return None if isinstance(step.part, Named) else nan
    if not field.function:
        return float(value)
    if field.function in ANGLES:
        return angles(value.x, value.y, value.z, value.w)[ANGLES.index(field.function)]
    return REDUCE[field.function](value)


def _entered(owner: Any, step: Step) -> Any:
    """Return what a step leads to; None: there is no such element."""
    found, part = getattr(owner, step.name), step.part
    if part is None:
        return found
    if isinstance(part, Span):
        return found[part.start : part.stop]
    place = _place_of(owner, part)
    return None if place is None or place >= len(found) else found[place]


def _place_of(owner: Any, part: Selector) -> Optional[int]:
    """Return the place of an element in its array; None where its name is not there."""
    if isinstance(part, Named):
        names = getattr(owner, part.names)
        return names.index(part.name) if part.name in names else None
    return part if isinstance(part, int) else None


def _minimum(values: Sequence[float]) -> float:
    # -inf if any is: a smallest distance must not leave out what is too close (REP 117).
    return float(min((value for value in values if value == value), default=nan))


def _of_finite(reduce: Callable[[Sequence[float]], float]) -> Callable[[Sequence[float]], float]:
    def of(values: Sequence[float]) -> float:
        finite = [value for value in values if isfinite(value)]
        return float(reduce(finite)) if finite else _minimum(values)

    return of


REDUCE: Dict[str, Callable[[Sequence[float]], float]] = {
    "min": _minimum,
    "max": _of_finite(max),
    "mean": _of_finite(lambda finite: fsum(finite) / len(finite)),
    "count": lambda values: float(sum(map(isfinite, values))),
}
"""The reductions of an array by their names in the grammar of fields."""


def angles(x: float, y: float, z: float, w: float) -> Tuple[float, float, float]:
    """Return roll, pitch and yaw of a quaternion of any length; NaN if it cannot be normalised.

    Looking straight up or down, where they are not unique, roll is 0.
    """
    length = hypot(hypot(x, y), hypot(z, w))
    if not SHORTEST < length < 1.0 / SHORTEST:
        return nan, nan, nan
    x, y, z, w = x / length, y / length, z / length, w / length
    sine = 2.0 * (w * y - z * x)
    if abs(sine) > 1.0 - 1e-12:
        yaw = atan2(2.0 * (w * z - x * y), 1.0 - 2.0 * (x * x + z * z))
        return 0.0, copysign(pi / 2, sine), yaw
    roll = atan2(2.0 * (w * x + y * z), 1.0 - 2.0 * (x * x + y * y))
    return roll, asin(sine), atan2(2.0 * (w * z + x * y), 1.0 - 2.0 * (y * y + z * z))


def quaternion(roll: float, pitch: float, yaw: float) -> Tuple[float, float, float, float]:
    """Return the quaternion x, y, z, w of three angles; its length is 1."""
    sr, cr = sin(roll / 2), cos(roll / 2)
    sp, cp = sin(pitch / 2), cos(pitch / 2)
    sy, cy = sin(yaw / 2), cos(yaw / 2)
    return (
        sr * cp * cy - cr * sp * sy,
        cr * sp * cy + sr * cp * sy,
        cr * cp * sy - sr * sp * cy,
        cr * cp * cy + sr * sp * sy,
    )


class Field:
    """One number in a message type, as `twist.twist.linear.x`; see shsa_core.model.field.

    `writable`: whether a value can be written to it. Raises ShsaError if the type has no such
    field, or if it is not a number.
    """

    def __init__(self, message_class: Any, text: str) -> None:
        def layout(name: str) -> Mapping[str, str]:
            if name == message_class._type:
                return message_types.layout_of(message_class)
            return message_types.layout(name)

        self._parsed = parse_field(text)
        self._type = field_type(message_class._type, text, layout)
        self.writable = not reduces(text)

    def get(self, message: Any) -> Optional[float]:
        """Return the field's value; see `field_value`."""
        return field_value(message, self._parsed)

    def set(self, message: Any, value: float) -> None:
        """Write the field; add a name that is not there. Raises ShsaError if that cannot be."""
        if not self.writable:
            raise ShsaError(f"{self._parsed} is read-only")
        owner = message
        *before, last = self._parsed.steps
        for step in before:
            owner = self._inner(owner, step)
        if self._parsed.function:
            self._turn(self._inner(owner, last), value)
            return
        plain = self._type.fit(value)
        if last.part is None:
            setattr(owner, last.name, plain)
        else:
            self._put(owner, last, plain)

    def _inner(self, owner: Any, step: Step) -> Any:
        found = _entered(owner, step)
        if found is None:
            raise ShsaError(f"{self._parsed}: the message has no {step}, and no other one is known")
        return found

    def _turn(self, rotation: Any, angle: float) -> None:
        """Set one angle of a rotation; the other two stay."""
        q = rotation
        turned = [each if each == each else 0.0 for each in angles(q.x, q.y, q.z, q.w)]
        turned[ANGLES.index(self._parsed.function)] = angle
        for name, each in zip("xyzw", quaternion(*turned)):
            setattr(rotation, name, each)

    def _put(self, owner: Any, step: Step, value: float) -> None:
        """Set an element of an array; one that is named and not there is added, and its name."""
        place = _place_of(owner, step.part)
        if place is None and isinstance(step.part, Named):
            place = _add_name(owner, step.part)
        array = list(getattr(owner, step.name))
        if isinstance(step.part, Named) and self._type.kind in FLOATS:
            # What is beside it in the array is not known; only such numbers can say so.
            array += [nan] * ((place or 0) - len(array))
        if place is None or place > len(array):
            raise ShsaError(
                f"{self._parsed}: the array has {len(array)} elements, and no message that has "
                "more is known"
            )
        array[place : place + 1] = [value]
        setattr(owner, step.name, array)


@lru_cache(maxsize=None)
def problem(message_type: str, text: str, written: bool) -> str:
    """Return why a field cannot be read, or written, on this computer; empty if it can."""
    try:
        field = Field(message_types.message_class(message_type), text)
    except ShsaError as error:
        return str(error)
    return f"{text} is read-only" if written and not field.writable else ""


def _add_name(owner: Any, key: Named) -> int:
    """Add a name to its array; its place. What the arrays beside it have there is not known."""
    names = list(getattr(owner, key.names))
    for name, kind in message_types.layout_of(owner).items():
        array = getattr(owner, name)
        if not kind.endswith("[]") or name == key.names or not names or len(array) != len(names):
            continue
        if kind[:-2] not in FLOATS:
            raise ShsaError(f"{key.name} cannot be added: {name} has no mark for what is not known")
        setattr(owner, name, [*array, nan])
    setattr(owner, key.names, [*names, key.name])
    return len(names)
