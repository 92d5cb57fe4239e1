"""A delay or a filter for each input: chosen among rows that are learned from, and nowhere else"""
from typing import Callable, Dict, List, NamedTuple, Sequence, Tuple

import numpy as np

from shsa_core.language.functions import DELAY, FILTER, STATEFUL
from shsa_core.language.memory import MAX_GAP_S
from shsa_learning.learn.models import quick
from shsa_learning.learn.table import Fold, Table, blocked

DELAYS_S = (0.05, 0.1, 0.2, 0.4)
FILTERS_S = (0.03, 0.06, 0.1, 0.2, 0.4, 0.8)  # time constants
BLOCKS = 3
GAIN = 0.03
"""By so much of itself the error must fall, or the input is taken as it is."""


class Lag(NamedTuple):
    """A delay and a filter of first order for an input (s); 0: none."""

    delay: float = 0.0
    filter: float = 0.0

    def text(self, name: str) -> str:
        """Return the input as it stands in an expression."""
        if self.delay > 0.0:
            name = f"{DELAY}({name}, {self.delay:g})"
        return f"{FILTER}({name}, {self.filter:g})" if self.filter > 0.0 else name


def candidates() -> List[Lag]:
    """Return every lag that is tried but none at all."""
    return [Lag(0.0, time) for time in FILTERS_S] + [Lag(time, 0.0) for time in DELAYS_S]


class Columns:
    """The inputs of a table behind any lag, at the rows that fits look at."""

    def __init__(self, table: Table, rows: np.ndarray) -> None:
        self._table = table
        self.rows = rows
        self.time = table.time[rows]
        self.target = table.target[rows]
        self._made: Dict[Tuple[str, Lag], np.ndarray] = {}

    @property
    def names(self) -> Tuple[str, ...]:
        """The inputs."""
        return self._table.names

    def matrix(self, lags: Sequence[Lag]) -> np.ndarray:
        """Return a column for each input behind its lag (rows, inputs)."""
        return np.array([self._column(*each) for each in zip(self.names, lags)]).T

    def _column(self, name: str, lag: Lag) -> np.ndarray:
        if (name, lag) not in self._made:
            whole = lagged(self._table.time, self._table.inputs[name], lag)
            self._made[name, lag] = whole[self.rows]
        return self._made[name, lag]


def lagged(time: np.ndarray, values: np.ndarray, lag: Lag) -> np.ndarray:
    """Return the values behind a lag, sample by sample, by the functions that a substitute has."""
    for function, seconds in ((DELAY, lag.delay), (FILTER, lag.filter)):
        if seconds > 0.0:
            memory: Callable[..., float] = STATEFUL[function].call(MAX_GAP_S)
            pairs = zip(values.tolist(), time.tolist())
            values = np.array([memory(value, seconds, now) for value, now in pairs])
    return values


def choose(columns: Columns, train: np.ndarray) -> Tuple[Lag, ...]:
    """Return the lag of each input: one for all of them first, then input by input."""
    folds = blocked(columns.time[train], BLOCKS)
    lags: Tuple[Lag, ...] = (Lag(),) * len(columns.names)
    best = _error(columns, lags, train, folds)
    every = [(lag,) * len(lags) for lag in candidates()]
    lags, best = _better(columns, every, lags, best, train, folds)
    for number in range(len(lags)):
        single = [
            lags[:number] + (lag,) + lags[number + 1 :]
            for lag in [Lag(), *candidates()]
            if lag != lags[number]
        ]
        lags, best = _better(columns, single, lags, best, train, folds)
    return lags


def _better(
    columns: Columns,
    tried: Sequence[Tuple[Lag, ...]],
    lags: Tuple[Lag, ...],
    best: float,
    train: np.ndarray,
    folds: Sequence[Fold],
) -> Tuple[Tuple[Lag, ...], float]:
    errors = [_error(columns, each, train, folds) for each in tried]
    least = int(np.argmin(errors))
    # Fewer lags need no gain.
    needed = best * (1.0 - GAIN) if _count(tried[least]) >= _count(lags) else best
    return (tried[least], errors[least]) if errors[least] < needed else (lags, best)


def _count(lags: Sequence[Lag]) -> int:
    return sum(lag != Lag() for lag in lags)


def _error(
    columns: Columns, lags: Sequence[Lag], train: np.ndarray, folds: Sequence[Fold]
) -> float:
    """Return the mean over the folds of the RMS error of a quick fit."""
    inputs, target = columns.matrix(lags)[train], columns.target[train]
    usable = np.isfinite(inputs).all(axis=1)
    errors = []
    for fold in folds:
        learn, test = fold.train[usable[fold.train]], fold.test[usable[fold.test]]
        if len(learn) == 0 or len(test) == 0:
            return float("inf")
        off = quick(inputs[learn], target[learn]).predict(inputs[test]) - target[test]
        errors.append(float(np.sqrt(np.mean(np.square(off)))))
    return float(np.mean(errors))
