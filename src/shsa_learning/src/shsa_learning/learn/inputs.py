"""The series that may be inputs for a target, and why the others may not.

What knows the target by another way than the world would be right on every recording, and gone or
wrong with the target. What the target itself is computed from is no such leak: it is measured
without the target, so a relation from it is a true one.
"""
import re
from typing import List, NamedTuple, Optional, Sequence, Tuple

import numpy as np

from shsa_core.errors import ShsaError, listed
from shsa_core.model.som import Som
from shsa_learning.recordings.recording import Recording, Series


class LeftOut(NamedTuple):
    """A series that may not be an input, and why."""

    series: Series
    why: str


class Offer(NamedTuple):
    """Series that a target may be learned from: `inputs`, one a property.

    `left_out`: all others of the recording; `notes`: what else should be known of the inputs.
    """

    target: Series
    inputs: Tuple[Series, ...]
    left_out: Tuple[LeftOut, ...]
    notes: Tuple[str, ...]

    def of(self, property: str) -> Series:
        """Return the first input of a property. Raises ShsaError, with why, if there is none."""
        found = next((each for each in self.inputs if each.property == property), None)
        if found is not None:
            return found
        why = next((each.why for each in self.left_out if each.series.property == property), None)
        if why is None:
            known = listed([each.property for each in self.inputs]) or "nothing"
            raise ShsaError(f"{property} was not recorded beside {self.target}; there is {known}")
        raise ShsaError(f"{property} may not be an input for {self.target.property}: {why}")


def offer(
    recording: Recording, target: Series, som: Optional[Som] = None, asked: Sequence[str] = ()
) -> Offer:
    """Return the series that `target`, a series of the recording, may be learned from.

    `asked`: properties that somebody named, who knows that they are measured apart from the target
    though they are in its file.
    """
    inputs: List[Series] = []
    left_out: List[LeftOut] = []
    for series in recording.series:
        if series is target:
            continue
        why = _why_not(series, target, som or Som(), asked)
        if why:
            left_out.append(LeftOut(series, why))
        else:
            inputs.append(series)
    notes = []
    service = (som or Som()).services.get(target.service)
    for series in inputs:
        if service is not None and series.service in service.upstream:
            notes.append(f"{target.property} is computed from {series}: that is what is learned")
    beside = [series.property for series in inputs if _one_source(series, target)]
    if beside:
        notes.append(
            f"{', '.join(beside)} and {target.property} are of one file, {target.source}: they "
            "must be of nodes that do not fail together"
        )
    return Offer(target, tuple(inputs), tuple(left_out), tuple(notes))


def _one_source(series: Series, target: Series) -> bool:
    """Return whether nothing but their columns tells two series of a file apart."""
    return series.source == target.source and not (series.service and target.service)


def _why_not(series: Series, target: Series, som: Som, asked: Sequence[str]) -> str:
    """Return why a series may not be an input; empty if it may."""
    if series.service and series.service == target.service:
        return f"it is of the same source as the target, {target.source}"
    if _one_source(series, target) and series.property not in asked:
        return (
            f"it is of the same source as the target, {target.source}; a file is one source, "
            "unless --from names the inputs, or --som says which nodes its columns are of"
        )
    if series.property == target.property:
        return "it is the target, measured once more: it is passed on as it is"
    if series.node and series.node == target.node:
        return f"it is of {series.node}, which is lost with the target"
    own, other = som.services.get(target.service), som.services.get(series.service)
    if own is not None and other is not None:
        shared = [cause for cause in other.wrong_with if cause in own.wrong_with]
        if shared:
            return f"it fails with the target: {shared[0]}"
        if own.name in other.upstream:
            return f"it is derived from the target: {other.name} is computed from {own.name}"
    same = duplicate(target, series)
    if same is not None:
        return f"it is a duplicate: {same}"
    return "" if series.property in asked else _of_this_drive_alone(series)


_WORDS = re.compile("[a-z]+|[0-9]+")
_PLACES = frozenset("yaw heading latitude longitude altitude lat lon alt northing easting".split())
_TIMES = frozenset("time stamp timestamp seq sequence counter".split())
_CHANGES = frozenset("rate velocity speed vel error".split())
_FIELD_OF_PLACE = re.compile(
    r"/yaw\(|/(position|translation|point)/[xyz]\Z|/(latitude|longitude|altitude|theta)\Z"
)


def _of_this_drive_alone(series: Series) -> str:
    """Return why a relation from a series would hold in its own recording and nowhere else."""
    words = set(_WORDS.findall(series.property.lower()))
    axis = words & set("xyz")
    named = words & _PLACES or axis and words <= {*"xyz", "pos", "position", "pose", "odom"}
    if (named and not words & _CHANGES) or _FIELD_OF_PLACE.search(series.source):
        return "it is an absolute place or heading; --from takes it all the same"
    values = series.values[np.isfinite(series.values)]
    steps = np.diff(values)
    grows = len(np.unique(values)) >= LEAST_DISTINCT and (np.all(steps >= 0) or np.all(steps <= 0))
    if words & _TIMES or grows:
        return "it is a time or a counter, which only goes one way; --from takes it all the same"
    return ""


LEAST_SAMPLES = 20
LEAST_DISTINCT = 10
MOST_SAMPLES = 2000
SHIFTS = (0, -1, 1, -2, 2)
"""Samples by which one may be later than the other."""
TOLERANCE = 1e-6  # of the spread and the mean: more than what a float32 loses
ODD_SHARE = 0.02
"""Of the samples may differ: where one was lost, the one before it is held."""


class Duplicate(NamedTuple):
    """`second` is `gain` times `first` plus `offset`."""

    first: Series
    second: Series
    gain: float
    offset: float

    def __str__(self) -> str:
        if abs(self.gain - 1.0) < 1e-4 and abs(self.offset) < 1e-4 * np.ptp(self.first.values):
            return f"{self.second} has the values of {self.first}"
        return f"{self.second} is {self.gain:.6g} * ({self.first}) + {self.offset:.6g}"


def duplicates(series: Sequence[Series]) -> List[Duplicate]:
    """Return all pairs of series that differ by gain and offset alone; constants are none."""
    found = []
    for place, first in enumerate(series):
        for second in series[place + 1 :]:
            same = duplicate(first, second)
            if same is not None:
                found.append(same)
    return found


def duplicate(first: Series, second: Series) -> Optional[Duplicate]:
    """Return gain and offset that make `second` of `first`; None if there are none."""
    if len(second) > len(first):  # the slower one can have all its values from the faster one
        swapped = duplicate(second, first)
        if swapped is None or not swapped.gain:
            return None
        return Duplicate(first, second, 1.0 / swapped.gain, -swapped.offset / swapped.gain)
    rows = np.arange(0, len(second), max(1, len(second) // MOST_SAMPLES))
    place = np.searchsorted(first.time, second.time[rows] + 1e-6, side="right") - 1
    for shift in SHIFTS:
        there = (place + shift >= 0) & (place + shift < len(first)) & (place >= 0)
        x = first.values[(place + shift)[there]]
        y = second.values[rows][there]
        known = np.isfinite(x) & np.isfinite(y)
        line = _line(x[known], y[known])
        if line is not None:
            return Duplicate(first, second, *line)
    return None


def _line(x: np.ndarray, y: np.ndarray) -> Optional[Sequence[float]]:
    """Gain and offset, if the points lie on a line."""
    if len(x) < LEAST_SAMPLES or min(len(np.unique(x)), len(np.unique(y))) < LEAST_DISTINCT:
        return None
    gain, offset = np.polyfit(x - x.mean(), y, 1)
    for _ in range(2):  # once more without the odd ones
        error = np.abs(gain * (x - x.mean()) + offset - y)
        good = error <= np.quantile(error, 1.0 - ODD_SHARE)
        if np.ptp(x[good]) == 0.0:
            return None
        gain, offset = np.polyfit(x[good] - x.mean(), y[good], 1)
    error = np.abs(gain * (x - x.mean()) + offset - y)
    bound = TOLERANCE * (float(np.std(y)) + abs(float(np.mean(y))))
    if np.quantile(error, 1.0 - ODD_SHARE) > bound:
        return None
    return float(gain), float(offset - gain * x.mean())
