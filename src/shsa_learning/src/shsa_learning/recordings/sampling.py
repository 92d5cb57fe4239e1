"""Samples as they were recorded, in the order of their time: sorted, and each time once."""
from typing import List, NamedTuple, Sequence, Tuple

import numpy as np

MOST_OFF_S = 2.0
"""Farther from the time of recording no stamp of the same clock is."""
MOST_SPREAD_S = 0.5
"""Of the age of stamps: a stamp that is off by more, once in a while, is no time of measurement."""
ODD_SHARE = 0.05
"""Of the stamps may be odd, as those of latched messages are that are older than the recording."""


class Ordered(NamedTuple):
    """Which samples stay, in order, and at what times; `notes`: what was changed."""

    time: np.ndarray
    kept: np.ndarray
    notes: Tuple[str, ...]


def times_of(stamps: Sequence[float], recorded: Sequence[float]) -> Tuple[np.ndarray, List[str]]:
    """When messages were measured (s), by their stamps where these are sane, else as recorded.

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
    """The samples in the order of their times (s); of those with one time the last counts."""
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
