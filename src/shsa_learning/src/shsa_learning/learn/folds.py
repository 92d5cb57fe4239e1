"""Folds of recorded rows: contiguous blocks with a purge, never shuffled rows"""
from typing import List, NamedTuple

import numpy as np

PURGE_S = 2.0
"""Between what is learned from and what is tested: rows this near tell much the same."""
APART_S = 1000.0
"""Between two recordings: whatever remembers starts anew."""
LEAST_RECORDINGS, MOST_BLOCKS = 3, 12
PURGE_SHARE = 0.25  # of a block, at most


class Fold(NamedTuple):
    """Rows by number: what is learned from, and the block that it is tested on."""

    train: np.ndarray
    test: np.ndarray


def block_numbers(time: np.ndarray, count: int) -> np.ndarray:
    """The block of each row (`time` in s, increasing): `count` blocks of equal size.

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
    """A fold for each of about `count` blocks of rows (`time` in s, increasing).

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
