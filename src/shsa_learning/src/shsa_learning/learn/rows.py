"""Recordings as the rows that are learned from: at the times of the target, past samples held"""
import dataclasses
import math
from typing import Dict, List, NamedTuple, Optional, Sequence, Tuple

import numpy as np
from scipy.ndimage import median_filter

from shsa_core.errors import ModelError, listed
from shsa_core.model.field import is_angle
from shsa_core.model.som import Som
from shsa_learning.learn.inputs import Offer, offer
from shsa_learning.learn.table import APART_S, Table
from shsa_learning.recordings.recording import Recording, Series, held, largest_age, measured_at

SHORTEST_PERIOD_S = 0.02
WINDOW = 5  # values
NOISE = 10.0  # typical distances from the median around
SPAN = 0.5  # of what the middle 98 % of the values span


class Data(NamedTuple):
    """The rows that are learned from, and what was left out.

    `left_out`: inputs by name, and why; `suspicious`: why some of them, or of those that were
    asked for, must not be ignored; `outliers`: how many were left out, by property; `notes`: what
    else was done to the data; `computed_from`: inputs of which the SOM says that the target is;
    `asked`: the inputs that somebody named.
    """

    table: Table
    left_out: Dict[str, str]
    suspicious: Tuple[str, ...]
    outliers: Dict[str, int]
    notes: Tuple[str, ...]
    computed_from: Tuple[str, ...] = ()
    asked: Tuple[str, ...] = ()


def gather(
    recordings: Sequence[Recording],
    property: str,
    wanted: Sequence[str] = (),
    som: Optional[Som] = None,
) -> Data:
    """Return the rows of all recordings in which `property` was recorded.

    `wanted`: the inputs; none: whatever may be one in each of these recordings. Raises ModelError
    if the property, or an input that is wanted, was not recorded.
    """
    known = list(dict.fromkeys(name for each in recordings for name in each.properties))
    if property not in known:
        raise ModelError(property, f"was not recorded; recorded were {listed(known) or 'nothing'}")
    others = [name for name in known if name != property]
    for name in wanted:
        if name not in others:
            there = listed(others) or "nothing"
            raise ModelError(
                f"--from {name}", f"was not recorded; beside {property} there is {there}"
            )
    offers = [
        offer(each, each.only(property), som, wanted) for each in recordings if each.of(property)
    ]
    offered = [[series.property for series in each.inputs] for each in offers]
    names = [n for n in wanted or others if all(n in each for each in offered)]
    left_out: Dict[str, str] = {}
    suspicious: List[str] = []
    for name in others:
        if name in names:
            continue
        reasons = [
            left.why for each in offers for left in each.left_out if left.series.property == name
        ]
        why = reasons[0] if reasons else "it is not in every recording"
        if wanted and name not in wanted:
            why = "it was not asked for"
        elif wanted:
            suspicious.append(f"{name} may not be an input: {why}")
        left_out[name] = why
    outliers: Dict[str, int] = {}
    parts = [_part(each, names, som, outliers) for each in offers]
    notes = [note for each in recordings for note in each.notes]
    notes += [note for each in offers for note in each.notes]
    found = {name: count for name, count in outliers.items() if count}
    angles = {name for name in names for each in offers if _turns(each.of(name), som)}
    table = dataclasses.replace(_joined(property, names, parts), angles=frozenset(angles))
    computed_from = [name for name in names if any(_upstream(name, each, som) for each in offers)]
    return Data(
        table, left_out, tuple(suspicious), found, tuple(notes), tuple(computed_from), tuple(wanted)
    )


def _upstream(name: str, given: Offer, som: Optional[Som]) -> bool:
    """Return whether the SOM says that the target is computed from an input."""
    service = som.services.get(given.target.service) if som is not None else None
    return service is not None and given.of(name).service in service.upstream


def _turns(series: Series, som: Optional[Som]) -> bool:
    """Return whether the SOM says that a series is an angle, which may jump by a turn."""
    service = som.services.get(series.service) if som is not None else None
    source = service.source(series.property) if service is not None else None
    return source is not None and is_angle(source.provision.field)


def _part(
    given: Offer, names: Sequence[str], som: Optional[Som], outliers: Dict[str, int]
) -> List[np.ndarray]:
    """Return the times, the target, the inputs and their moments: columns of one recording."""
    target = _clean(given.target, outliers)
    # Somewhat less than the period: stamps jitter.
    time = _thinned(target.time, 0.75 * SHORTEST_PERIOD_S)
    columns = [time, held(target, time)]
    for name in names:
        series = _clean(given.of(name), outliers)
        columns.append(held(series, time, largest_age(series, som)))
    for series in map(given.of, names):
        holds = largest_age(series, som) == math.inf
        columns.append(np.full(len(time), np.nan) if holds else measured_at(series, time))
    return columns


def _clean(series: Series, outliers: Dict[str, int]) -> Series:
    found = outlying(series.values)
    outliers[series.property] = outliers.get(series.property, 0) + int(np.count_nonzero(found))
    return dataclasses.replace(series, values=np.where(found, np.nan, series.values))


def _thinned(time: np.ndarray, period: float) -> np.ndarray:
    """Of some times those that are at least `period` s apart."""
    if len(time) < 2 or float(np.min(np.diff(time))) >= period:
        return time
    slots = np.floor((time - time[0]) / SHORTEST_PERIOD_S)
    return time[np.append(True, np.diff(slots) > 0)]


def _joined(property: str, names: Sequence[str], parts: Sequence[List[np.ndarray]]) -> Table:
    steps = np.concatenate([np.diff(part[0]) for part in parts])
    begin, times, moments = 0.0, [], []
    for part in parts:
        times.append(begin + part[0] - part[0][0])
        moments.append([begin + each - part[0][0] for each in part[len(names) + 2 :]])
        begin = times[-1][-1] + APART_S
    columns = [np.concatenate([part[k] for part in parts]) for k in range(1, len(names) + 2)]
    return Table(
        property,
        np.concatenate(times),
        columns[0],
        dict(zip(names, columns[1:])),
        float(np.median(steps)) if len(steps) else 0.0,
        dict(zip(names, map(np.concatenate, zip(*moments)))),
    )


def outlying(values: np.ndarray) -> np.ndarray:
    """Mark the outliers: values far from the median of those around, by all that is usual."""
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
