"""The rows that are learned from: the target, and what was known of each input at that moment"""
from dataclasses import dataclass, field, replace
from typing import FrozenSet, List, Mapping, NamedTuple, Tuple

import numpy as np

MAX_ROWS = 3000
"""For fits: rows that lie nearer together tell much the same."""
PURGE_S = 2.0
"""Between what is learned from and what is tested: rows this near tell much the same."""
APART_S = 1000.0
"""Between two recordings: whatever remembers starts anew."""
LEAST_RECORDINGS, MOST_BLOCKS = 3, 12
PURGE_SHARE = 0.25  # of a block, at most


@dataclass(frozen=True)
class Table:
    """Rows in the order of time.

    `name`: the target's; `time` in s, increasing, also from one recording to the next; `target` and
    each of `inputs` (by property) have a value a row, NaN where there is none; `period`: s between
    two rows that follow one another. `moments`: when inputs were measured (s), NaN or none: they
    hold. `angles`: the inputs of which a turn means nothing.
    """

    name: str
    time: np.ndarray
    target: np.ndarray
    inputs: Mapping[str, np.ndarray]
    period: float
    moments: Mapping[str, np.ndarray] = field(default_factory=dict)
    angles: FrozenSet[str] = frozenset()

    @property
    def names(self) -> Tuple[str, ...]:
        """The inputs' names, in order."""
        return tuple(self.inputs)

    @property
    def complete(self) -> np.ndarray:
        """Return whether all of a row has a value, row by row."""
        known = np.isfinite(self.target)
        for column in self.inputs.values():
            known &= np.isfinite(column)
        return known

    @property
    def duration(self) -> float:
        """Seconds of complete rows."""
        return float(np.count_nonzero(self.complete) * self.period)

    def of(self, names: Tuple[str, ...]) -> "Table":
        """Return the table with these inputs alone."""
        return replace(self, inputs={name: self.inputs[name] for name in names})

    def at(self, rows: np.ndarray) -> "Table":
        """Return the table with the rows of these numbers alone."""
        inputs = {name: column[rows] for name, column in self.inputs.items()}
        moments = {name: self.moments[name][rows] for name in inputs if name in self.moments}
        time, target = self.time[rows], self.target[rows]
        return replace(self, time=time, target=target, inputs=inputs, moments=moments)

    def rows(self) -> np.ndarray:
        """Return the numbers of complete rows for fits: MAX_ROWS at most, evenly spread."""
        complete = np.flatnonzero(self.complete)
        step = max(1, -(-len(complete) // MAX_ROWS))
        return complete[::step]


def inputs_alone(time: np.ndarray, inputs: Mapping[str, np.ndarray]) -> Table:
    """Return rows without a target, at each `time` (s)."""
    return Table("", time, np.full(len(time), np.nan), inputs, 0.0)


class Fold(NamedTuple):
    """Rows by number: what is learned from, and the block that it is tested on."""

    train: np.ndarray
    test: np.ndarray


def block_numbers(time: np.ndarray, count: int) -> np.ndarray:
    """Return the block of each row (`time` in s, increasing): `count` blocks of equal size.

    Of three recordings or more each is a block, as another drive is the better test; unless one of
    them is most of all rows.
    """
    rows = len(time)
    recording = np.concatenate([[0], np.cumsum(np.diff(time) > APART_S / 2)])
    sizes = np.bincount(recording)
    if len(sizes) >= LEAST_RECORDINGS and 2 * np.max(sizes) <= rows:
        return recording * min(len(sizes), MOST_BLOCKS) // len(sizes)
    return np.arange(rows) * count // max(rows, 1)


def blocked(time: np.ndarray, count: int) -> List[Fold]:
    """Return a fold for each of about `count` blocks of rows (`time` in s, increasing).

    Rows within the purge of the block's ends are in neither part.
    """
    numbers = block_numbers(time, count)
    folds = []
    for number in np.unique(numbers):
        test = np.flatnonzero(numbers == number)
        if len(test) == 0:
            continue
        first, last = time[test[0]], time[test[-1]]
        purge = min(PURGE_S, PURGE_SHARE * (last - first))
        train = np.flatnonzero((time < first - purge) | (time > last + purge))
        if len(train) > 0:
            folds.append(Fold(train, test))
    return folds


def shuffled(rows: int, count: int, seed: int) -> List[Fold]:
    """Folds of rows drawn at random: how good a fit looks to who does not care about time."""
    order = np.random.RandomState(seed).permutation(rows)
    parts = np.array_split(order, count)
    return [
        Fold(np.sort(np.concatenate(parts[:i] + parts[i + 1 :])), np.sort(part))
        for i, part in enumerate(parts)
    ]
