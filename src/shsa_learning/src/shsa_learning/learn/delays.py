"""A delay or a filter for each input: chosen among rows that are learned from, and nowhere else"""
from typing import List, NamedTuple, Sequence, Tuple

import numpy as np

from shsa_core.language.functions import DELAY, FILTER
from shsa_learning.learn.features import Features
from shsa_learning.learn.models import quick
from shsa_learning.learn.table import Fold, blocked

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


def texts(names: Sequence[str], lags: Sequence[Lag]) -> List[str]:
    """Return each input behind its lag, as it stands in an expression."""
    return [lag.text(name) for name, lag in zip(names, lags)]


def choose(features: Features, train: np.ndarray) -> Tuple[Lag, ...]:
    """Return the lag of each input: one for all of them first, then input by input."""
    folds = blocked(features.time[train], BLOCKS)
    lags: Tuple[Lag, ...] = (Lag(),) * len(features.names)
    best = _error(features, lags, train, folds)
    every = [(lag,) * len(lags) for lag in candidates()]
    lags, best = _better(features, every, lags, best, train, folds)
    for number in range(len(lags)):
        single = [
            lags[:number] + (lag,) + lags[number + 1 :]
            for lag in [Lag(), *candidates()]
            if lag != lags[number]
        ]
        lags, best = _better(features, single, lags, best, train, folds)
    return lags


def _better(
    features: Features,
    tried: Sequence[Tuple[Lag, ...]],
    lags: Tuple[Lag, ...],
    best: float,
    train: np.ndarray,
    folds: Sequence[Fold],
) -> Tuple[Tuple[Lag, ...], float]:
    errors = [_error(features, each, train, folds) for each in tried]
    least = int(np.argmin(errors))
    # Fewer lags need no gain.
    needed = best * (1.0 - GAIN) if _count(tried[least]) >= _count(lags) else best
    return (tried[least], errors[least]) if errors[least] < needed else (lags, best)


def _count(lags: Sequence[Lag]) -> int:
    return sum(lag != Lag() for lag in lags)


def _error(
    features: Features, lags: Sequence[Lag], train: np.ndarray, folds: Sequence[Fold]
) -> float:
    """Return the mean over the folds of the RMS error of a quick fit."""
    inputs, target = features.matrix(texts(features.names, lags))[train], features.target[train]
    usable = np.isfinite(inputs).all(axis=1)
    errors = []
    for fold in folds:
        learn, test = fold.train[usable[fold.train]], fold.test[usable[fold.test]]
        if len(learn) == 0 or len(test) == 0:
            return float("inf")
        off = quick(inputs[learn], target[learn]).predict(inputs[test]) - target[test]
        errors.append(float(np.sqrt(np.mean(np.square(off)))))
    return float(np.mean(errors))
