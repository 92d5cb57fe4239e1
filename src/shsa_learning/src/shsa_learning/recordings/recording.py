"""A recording: what each source said of a property, and when."""
import builtins
from dataclasses import dataclass
from typing import Tuple

import numpy as np

from shsa_core.errors import ShsaError, listed


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
        """What was recorded, each once."""
        return tuple(dict.fromkeys(series.property for series in self.series))

    def of(self, property: str) -> Tuple[Series, ...]:
        """The series of a property, maybe none."""
        return tuple(series for series in self.series if series.property == property)

    def only(self, property: str) -> Series:
        """The first series of a property. Raises ShsaError, with what there is, if it has none."""
        found = self.of(property)
        if not found:
            known = listed(self.properties) or "nothing"
            raise ShsaError(f"{self.name}: has no {property}; recorded were {known}")
        return found[0]
