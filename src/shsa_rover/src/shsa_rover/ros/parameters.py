"""Reads private parameters with clear errors."""
import math
from typing import Optional

import rospy

from shsa_core.errors import ModelError


def text_parameter(name: str, default: Optional[str] = None) -> str:
    """Return the text of the parameter `name`; without a default it must be set."""
    value = rospy.get_param(name, default)
    if not isinstance(value, str) or (default is None and not value):
        raise ModelError(rospy.resolve_name(name), f"must be set to a text, not {value!r}")
    return value


def flag_parameter(name: str, default: bool) -> bool:
    """Return the truth value of the parameter `name`."""
    value = rospy.get_param(name, default)
    if not isinstance(value, bool):
        raise ModelError(rospy.resolve_name(name), f"must be true or false, not {value!r}")
    return value


def number_parameter(name: str, default: float, low: float, high: float) -> float:
    """Return the number of the parameter `name`, from `low` to `high`."""
    value = rospy.get_param(name, default)
    good = isinstance(value, (int, float)) and not isinstance(value, bool)
    if not good or not math.isfinite(value) or not low <= value <= high:
        raise ModelError(
            rospy.resolve_name(name), f"must be a number from {low:g} to {high:g}, not {value!r}"
        )
    return float(value)
