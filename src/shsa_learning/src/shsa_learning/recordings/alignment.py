"""Past samples held at given moments: no row knows what came later."""
import math
from typing import Optional

import numpy as np

from shsa_core.model.service import Deadlines
from shsa_core.model.som import Som
from shsa_learning.recordings.recording import Series

_ROUNDING_S = 1e-6  # stamps are no more exact; a sample at the time of a row counts


def held(series: Series, time: np.ndarray, age: float = math.inf) -> np.ndarray:
    """The newest value at each moment of `time` (s), never a later one.

    NaN before the first, where it is older than `age` (s), and where it is not finite.
    """
    time = np.asarray(time, dtype=float)
    place = np.searchsorted(series.time, time + _ROUNDING_S, side="right") - 1
    known = place >= 0
    known &= time - series.time[np.maximum(place, 0)] <= age + _ROUNDING_S
    values = np.where(known, series.values[np.maximum(place, 0)], np.nan)
    return np.where(np.isfinite(values), values, np.nan)


def largest_age(series: Series, som: Optional[Som] = None) -> float:
    """How old a value of a series may be (s), as for a substitute: five intervals, 0.25 s at least.

    By the SOM if it has the service; an event-driven one never is too old.
    """
    service = som.services.get(series.service) if som is not None else None
    if service is not None:
        deadline = Deadlines().of(service)
        return math.inf if deadline is None else deadline
    return max(Deadlines.periods * series.interval, Deadlines.minimum)
