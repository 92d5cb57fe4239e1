"""The value of a field in a message, whatever class the message is of: a number of many, an angle.

Angles are roll, pitch and yaw in rad about fixed axes, x, then y, then z (REP 103). Formulas:
J. Diebel, Representing Attitude: Euler Angles, Unit Quaternions, and Rotation Vectors (2006), the
sequence (1, 2, 3), with the quaternion of the rotation from the body to the world.
"""
from math import asin, atan2, copysign, cos, fsum, hypot, isfinite, nan, pi, sin
from typing import Any, Callable, Dict, Optional, Sequence, Tuple

from shsa_core.model.field import ANGLES, FieldText, Index, Named, Selector, Span

SHORTEST = 1e-6
"""A shorter quaternion stands for none."""


def field_value(message: Any, field: FieldText) -> Optional[float]:
    """Return the field's value; None if the message has none, as it does not name it.

    NaN where an array is shorter than the place, or where there is no number. The message's type
    has the field: `field_type` says so.
    """
    value = message
    for step in field.steps:
        owner, value, part = value, getattr(value, step.name), step.part
        if isinstance(part, Index):
            if part.place >= len(value):
                return nan
            value = value[part.place]
        elif isinstance(part, Named):
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
    """Return the place of an element in its array; None where its name is not there."""
    if isinstance(part, Named):
        names = getattr(owner, part.names)
        return names.index(part.name) if part.name in names else None
    return part.place if isinstance(part, Index) else None


def _minimum(values: Sequence[float]) -> float:
    # -inf if any is: a smallest distance must not leave out what is too close (REP 117).
    return float(min((value for value in values if value == value), default=nan))


def _maximum(values: Sequence[float]) -> float:
    finite = _finite(values)
    return float(max(finite)) if finite else _minimum(values)


def _mean(values: Sequence[float]) -> float:
    finite = _finite(values)
    return fsum(finite) / len(finite) if finite else _minimum(values)


def _count(values: Sequence[float]) -> float:
    return float(len(_finite(values)))


def _finite(values: Sequence[float]) -> Sequence[float]:
    return [value for value in values if isfinite(value)]


REDUCE: Dict[str, Callable[[Sequence[float]], float]] = {
    "min": _minimum,
    "max": _maximum,
    "mean": _mean,
    "count": _count,
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
