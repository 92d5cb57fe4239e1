"""Outliers: single values that are far from those around them"""
from typing import Tuple

import numpy as np
from scipy.ndimage import median_filter

WINDOW = 5  # values
NOISE = 10.0  # typical distances from the median around
SPAN = 0.5  # of what the middle 98 % of the values span
MANY = 0.05
"""Of all values: who has more of them has another trouble."""


def outliers(values: np.ndarray) -> np.ndarray:
    """Which values are outliers: far from the median of those around, by all that is usual."""
    finite = np.isfinite(values)
    found = np.zeros(len(values), dtype=bool)
    known = values[finite]
    if len(known) < WINDOW:
        return found
    low, high = np.percentile(known, (1.0, 99.0))
    distance = np.abs(known - median_filter(known, WINDOW, mode="nearest"))
    limit = max(NOISE * float(np.median(distance)), SPAN * float(high - low))
    if limit > 0.0:
        found[finite] = distance > limit
    return found


def without(values: np.ndarray) -> Tuple[np.ndarray, int]:
    """The values with NaN for each outlier, and how many these were."""
    found = outliers(values)
    return np.where(found, np.nan, values), int(np.count_nonzero(found))
