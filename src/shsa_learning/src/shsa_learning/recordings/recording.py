"""A recording: what each source said of a property, and when."""
import builtins
import math
from dataclasses import dataclass, replace
from typing import Iterator, List, NamedTuple, Optional, Sequence, Tuple

import numpy as np

from shsa_core.errors import ShsaError, listed
from shsa_core.language.memory import sample_times
from shsa_core.model.service import Deadlines
from shsa_core.model.som import Som


@dataclass(frozen=True, eq=False)
class Series:
    """The samples of one property by one source.

    `source`: topic and field as in a substitute's strings, or the CSV file; `node`: who published
    it; `time` in s, strictly increasing, and `values` in the property's unit: (n,) each. A value
    that is not finite is none: the source gave no number then. `service`: the service of the SOM
    that it is of; both are empty where that is not known. Raises ShsaError.
    """

    property: str
    source: str
    node: str
    time: np.ndarray
    values: np.ndarray
    service: str = ""

    def __post_init__(self) -> None:
        for name in ("time", "values"):
            object.__setattr__(self, name, np.asarray(getattr(self, name), dtype=float))
        time = self.time
        if time.ndim != 1 or time.shape != self.values.shape or not len(time):
            raise ShsaError(f"{self}: a series has as many times as values, and one at least")
        if not (np.isfinite(time).all() and (np.diff(time) > 0.0).all()):
            raise ShsaError(f"{self}: the times of a series are finite and increase")

    def __len__(self) -> int:
        return len(self.time)

    def __str__(self) -> str:
        return f"{self.property} of {self.source}" + (f" ({self.node})" if self.node else "")

    @builtins.property  # a series has a `property` of its own
    def begin(self) -> float:
        """The time of the first sample in s."""
        return float(self.time[0])

    @builtins.property
    def end(self) -> float:
        """The time of the last sample in s."""
        return float(self.time[-1])

    @builtins.property
    def interval(self) -> float:
        """The usual time between two samples in s; 0 if there is one sample."""
        return float(np.median(np.diff(self.time))) if len(self) > 1 else 0.0


@dataclass(frozen=True, eq=False)
class Recording:
    """All series of one drive, on one clock; `notes`: what was left out or changed, and why."""

    name: str
    series: Tuple[Series, ...]
    notes: Tuple[str, ...] = ()

    @property
    def begin(self) -> float:
        """The time of the first sample in s; 0 if there is none."""
        return min((series.begin for series in self.series), default=0.0)

    @property
    def end(self) -> float:
        """The time of the last sample in s; 0 if there is none."""
        return max((series.end for series in self.series), default=0.0)

    @property
    def duration(self) -> float:
        """From the first to the last sample in s."""
        return self.end - self.begin

    @property
    def properties(self) -> Tuple[str, ...]:
        """The recorded properties, each once."""
        return tuple(dict.fromkeys(series.property for series in self.series))

    def of(self, property: str) -> Tuple[Series, ...]:
        """Return the series of a property, maybe none."""
        return tuple(series for series in self.series if series.property == property)

    def only(self, property: str) -> Series:
        """Return the first series of a property. Raises ShsaError if there is none."""
        found = self.of(property)
        if not found:
            known = listed(self.properties) or "nothing"
            raise ShsaError(f"{self.name}: has no {property}; recorded were {known}")
        return found[0]


MOST_OFF_S = 2.0
"""Farther from the time of recording no stamp of the same clock is."""
MOST_SPREAD_S = 0.5
"""Of the age of stamps: a stamp that is off by more, once in a while, is no time of measurement."""
ODD_SHARE = 0.05
"""Of the stamps may be odd, as those of latched messages are that are older than the recording."""


class Ordered(NamedTuple):
    """The samples that stay, in order, and their times; `notes`: what was changed."""

    time: np.ndarray
    kept: np.ndarray
    notes: Tuple[str, ...]


def times_of(stamps: Sequence[float], recorded: Sequence[float]) -> Tuple[np.ndarray, List[str]]:
    """Return when messages were measured (s): their stamps if these are sane, else as recorded.

    Stamps of a clock that is off by a constant are moved by it. No time is before the first
    message was recorded by more than an ordinary delay: what is older held already then.
    """
    stamp, record = np.asarray(stamps, dtype=float), np.asarray(recorded, dtype=float)
    if not (np.isfinite(stamp).all() and (stamp > 0.0).all()):
        return record, ["has no stamps: the time of recording counts"] if stamp.any() else []
    age = record - stamp
    usual = float(np.median(age))
    if np.mean(np.abs(age - usual) > MOST_SPREAD_S) > ODD_SHARE and len(stamp) > 1:
        return record, ["has stamps that do not follow its messages: the time of recording counts"]
    notes = []
    if abs(usual) > MOST_OFF_S:
        stamp = stamp + usual
        notes.append(f"has stamps that are off by {-usual:.6g} s; they are moved by that")
    return np.maximum(stamp, record[0] - MOST_OFF_S), notes


def ordered(time: np.ndarray) -> Ordered:
    """Sort samples by their times (s); of those with one time the last counts."""
    order = np.argsort(time, kind="stable")
    time_ = time[order]
    last = np.append(np.diff(time_) > 0.0, True) if len(time_) else np.zeros(0, dtype=bool)
    notes = []
    back = int(np.sum(np.diff(time) < 0.0))
    if back:
        notes.append(f"has {_samples(back)} out of order; they are sorted by time")
    double = int(np.sum(~last))
    if double:
        notes.append(f"has {_samples(double)} with the time of another; the last one counts")
    return Ordered(time_[last], order[last], tuple(notes))


def _samples(number: int) -> str:
    return "1 sample" if number == 1 else f"{number} samples"


_ROUNDING_S = 1e-6  # stamps are no more exact; a sample at the time of a row counts


def held(series: Series, time: np.ndarray, age: float = math.inf) -> np.ndarray:
    """Return the newest value at each moment of `time` (s), never a later one.

    NaN before the first, where it is older than `age` (s), and where it is not finite.
    """
    time = np.asarray(time, dtype=float)
    place = np.searchsorted(series.time, time + _ROUNDING_S, side="right") - 1
    known = place >= 0
    known &= time - series.time[np.maximum(place, 0)] <= age + _ROUNDING_S
    values = np.where(known, series.values[np.maximum(place, 0)], np.nan)
    return np.where(np.isfinite(values), values, np.nan)


def measured_at(series: Series, time: np.ndarray) -> np.ndarray:
    """Return when the newest value at each moment of `time` (s) was measured; NaN before any."""
    return held(replace(series, values=series.time), time)


def sample_times_of(moments: Sequence[np.ndarray], time: np.ndarray) -> Iterator[Tuple[float, ...]]:
    """Yield the `sample_times` of inputs at each `time` (s); NaN: a value that holds."""
    came = ([None if each != each else each for each in column.tolist()] for column in moments)
    return map(sample_times, zip(*came), time.tolist())


def largest_age(series: Series, som: Optional[Som] = None) -> float:
    """Return how old a value may be (s), as for a substitute: five intervals, 0.25 s at least.

    By the SOM if it has the service; an event-driven one never is too old.
    """
    service = som.services.get(series.service) if som is not None else None
    if service is not None:
        deadline = Deadlines().of(service)
        return math.inf if deadline is None else deadline
    return max(Deadlines.PERIODS * series.interval, Deadlines.minimum)
