"""Roll, pitch and yaw of a quaternion, and the quaternion of these.

Angles in rad about fixed axes, x, then y, then z, as REP 103 has them. Formulas: J. Diebel,
Representing Attitude: Euler Angles, Unit Quaternions, and Rotation Vectors (2006), the sequence
(1, 2, 3), with the quaternion of the rotation from the body to the world.
"""
from math import asin, atan2, copysign, cos, hypot, nan, pi, sin
from typing import Tuple

Angles = Tuple[float, float, float]
Quaternion = Tuple[float, float, float, float]
SHORTEST = 1e-6
"""A quaternion that is shorter stands for none."""


def angles(x: float, y: float, z: float, w: float) -> Angles:
    """Roll, pitch and yaw of a quaternion of any length; NaN if it cannot be normalised.

    Looking straight up or down, where they are not unique, roll is 0.
    """
    length = hypot(hypot(x, y), hypot(z, w))
    if not SHORTEST < length < 1.0 / SHORTEST:
        return nan, nan, nan
    x, y, z, w = x / length, y / length, z / length, w / length
    sine = 2.0 * (w * y - z * x)
    if abs(sine) > 1.0 - 1e-12:
        return (
            0.0,
            copysign(pi / 2, sine),
            atan2(2.0 * (w * z - x * y), 1.0 - 2.0 * (x * x + z * z)),
        )
    return (
        atan2(2.0 * (w * x + y * z), 1.0 - 2.0 * (x * x + y * y)),
        asin(sine),
        atan2(2.0 * (w * z + x * y), 1.0 - 2.0 * (y * y + z * z)),
    )


def quaternion(roll: float, pitch: float, yaw: float) -> Quaternion:
    """The quaternion x, y, z, w of three angles; its length is 1."""
    sr, cr = sin(roll / 2), cos(roll / 2)
    sp, cp = sin(pitch / 2), cos(pitch / 2)
    sy, cy = sin(yaw / 2), cos(yaw / 2)
    return (
        sr * cp * cy - cr * sp * sy,
        cr * sp * cy + sr * cp * sy,
        cr * cp * sy - sr * sp * cy,
        cr * cp * cy + sr * sp * sy,
    )
