"""Messages that consumers reject or misread: rules of tf2, robot_localization and REP 105."""
import math
from typing import Any, Iterator, List, Sequence, Tuple

import genpy

NORM_TOLERANCE = 1e-3
"""tf2 rejects a rotation whose squared length is further than this from 1."""
NO_NAN = (
    "geometry_msgs/Pose",
    "geometry_msgs/Twist",
    "geometry_msgs/Accel",
    "geometry_msgs/Transform",
    "sensor_msgs/Imu",
)


def problems(message: genpy.Message) -> List[str]:
    """Return why a consumer would reject a message, or take for certain what is not known."""
    found: List[str] = []
    for path, each in _parts(message, message._type):
        kind = each._type
        if kind == "std_msgs/Header" and not each.frame_id:
            found.append(f"{path}: the frame is empty")
        if kind == "nav_msgs/Odometry" and not each.child_frame_id:
            found.append(f"{path}: the child frame is empty")
        if kind == "geometry_msgs/Quaternion":
            squared = each.x**2 + each.y**2 + each.z**2 + each.w**2
            if not abs(squared - 1.0) < NORM_TOLERANCE:
                found.append(f"{path}: its length is {squared:g}, not 1")
        if kind in NO_NAN and not all(map(math.isfinite, numbers(each))):
            found.append(f"{path}: not every number is finite")
        if kind.endswith("WithCovariance"):
            found += _certain(path, each.covariance, False)
        if kind == "sensor_msgs/Imu":
            for name in ("orientation", "angular_velocity", "linear_acceleration"):
                found += _certain(f"{path}.{name}", getattr(each, f"{name}_covariance"), True)
        if kind == "sensor_msgs/NavSatFix":
            found += _certain(path, each.position_covariance, False)
            if each.status.status >= 0 and not all(map(math.isfinite, numbers(each))):
                found.append(f"{path}: a fix, and not every number is finite")
    return found


def frames(message: genpy.Message) -> List[str]:
    """Return every frame that a message names."""
    found = []
    for _, each in _parts(message, ""):
        found += [getattr(each, name) for name in each.__slots__ if name.endswith("frame_id")]
    return found


def numbers(message: genpy.Message) -> List[float]:
    """Return every floating-point number in a message."""
    found: List[float] = []
    for _, each in _parts(message, ""):
        for name, kind in zip(each.__slots__, each._slot_types):
            if kind.startswith("float"):
                value = getattr(each, name)
                found += list(value) if "[" in kind else [value]
    return found


def _certain(path: str, matrix: Sequence[float], may_be_absent: bool) -> List[str]:
    """Variances that claim certainty, or that are none."""
    if may_be_absent and matrix[0] == -1.0:
        return []
    size = round(math.sqrt(len(matrix)))
    variances = [matrix[row * size + row] for row in range(size)]
    if all(0.0 < variance < math.inf for variance in variances):
        return []
    return [f"{path}: {variances} are no variances of what is not certain"]


def _parts(message: Any, path: str) -> Iterator[Tuple[str, genpy.Message]]:
    """Yield a message and all messages in it."""
    yield path, message
    for name, kind in zip(message.__slots__, message._slot_types):
        if "/" in kind:
            value = getattr(message, name)
            for each in value if isinstance(value, (list, tuple)) else [value]:
                yield from _parts(each, f"{path}.{name}")
