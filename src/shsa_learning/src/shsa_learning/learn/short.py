"""Short models: a few terms of the library, found by orthogonal matching pursuit (scikit-learn)"""
import warnings
from typing import Dict, List, NamedTuple, Sequence, Tuple

import numpy as np
from sklearn.linear_model import orthogonal_mp_gram

from shsa_learning.learn.features import Features
from shsa_learning.learn.models import MOST_OUTLIERS, OUTLIER
from shsa_learning.learn.terms import Knowledge, behind_lags, library

MOST_TERMS = 5
"""Of a model, unless more are asked for."""
ROWS_A_TERM = 20
"""Fewer rows bear no further term."""
SHORTLIST = 12
"""Terms that are tried behind lags too, in two lists: of the pursuit, and of those best alone."""
GAIN = 0.03
"""By so much of itself the error must fall, or a term is taken without its lag."""
SWEEPS = 3
"""Times that each term of a model may be exchanged for a better one."""
MOST_MISSING = 0.05
"""Of the rows: a term that has no value in more is none."""
LEAST_LEFT = 1e-6
"""Of a term's variance: what others leave of it, or it says the same as they do."""


class Sum(NamedTuple):
    """intercept + the sum of coefficients times terms."""

    intercept: float
    coefficients: Tuple[float, ...]
    terms: Tuple[str, ...]

    def predict(self, columns: np.ndarray) -> np.ndarray:
        """Return its value in each row of its terms' values (rows, terms)."""
        total = np.full(len(columns), self.intercept)
        for coefficient, column in zip(self.coefficients, columns.T):
            total = total + coefficient * column
        return total


class ShortModels:
    """Finds the best sums of a few terms on some rows."""

    def __init__(self, features: Features, known: Knowledge, period: float) -> None:
        self._features, self._period = features, period
        plain = features.matrix(features.names)
        self._library = library(dict(zip(features.names, plain.T)), known)
        self._plain: Dict[str, str] = {}  # terms by what they are behind a lag

    def shortlist(self, rows: np.ndarray) -> Tuple[str, ...]:
        """Return the terms that tell most of the target in some rows, also behind lags."""
        gram = _Gram(self._features.matrix(self._library)[rows], self._features.target[rows])
        best = dict.fromkeys([*gram.pursued(SHORTLIST)[-1], *gram.best(SHORTLIST)])
        terms = [self._library[place] for place in best]
        for term in terms:
            self._plain.update(dict.fromkeys(behind_lags(term, self._period), term))
        return (*terms, *(each for each, term in self._plain.items() if term in terms))

    def sums(self, shortlist: Sequence[str], rows: np.ndarray, most: int) -> List[Sum]:
        """Return the best sum of one term, of two, and so on, fitted to some rows.

        Rows that are far off the first fit are left out of a second one.
        """
        columns, target = self._features.matrix(shortlist)[rows], self._features.target[rows]
        most = min(most, len(rows) // ROWS_A_TERM)
        kinds = np.array([shortlist.index(self._plain.get(term, term)) for term in shortlist])
        chosen = _chosen(columns, target, kinds, most)
        if chosen:
            kept = usual(columns[:, chosen[-1]], target)
            if not kept.all():
                columns, target = columns[kept], target[kept]
                chosen = _chosen(columns, target, kinds, most)
        found = []
        for places in chosen:
            for place in range(len(places)):
                places = self._without_lag(places, place, shortlist, columns, target)
            terms = [shortlist[number] for number in places]
            found.append(fitted(terms, columns[:, places], target))
        return found

    def _without_lag(
        self,
        places: List[int],
        place: int,
        shortlist: Sequence[str],
        columns: np.ndarray,
        target: np.ndarray,
    ) -> List[int]:
        """Return the terms, one without its lag if that costs next to nothing."""
        term = shortlist[places[place]]
        plain = shortlist.index(self._plain.get(term, term))
        if plain in places:
            return places
        other = [*places[:place], plain, *places[place + 1 :]]
        least = (1.0 - GAIN) * _error(columns[:, other], target)
        return other if _error(columns[:, places], target) > least else places


def fitted(terms: Sequence[str], columns: np.ndarray, target: np.ndarray) -> Sum:
    """Return the sum of terms that fits best, by least squares."""
    known = np.isfinite(columns).all(axis=1)
    columns, target = columns[known], target[known]
    means, middle = columns.mean(axis=0), float(np.mean(target))
    deviations = columns.std(axis=0)
    scales = np.where(deviations > 0.0, deviations, 1.0)
    found = np.linalg.lstsq((columns - means) / scales, target - middle, rcond=1e-12)[0] / scales
    return Sum(middle - float(found @ means), tuple(found.tolist()), tuple(terms))


def _error(columns: np.ndarray, target: np.ndarray) -> float:
    left = fitted((), columns, target).predict(columns) - target
    return float(np.sqrt(np.nanmean(np.square(left))))


def usual(columns: np.ndarray, target: np.ndarray) -> np.ndarray:
    """Return which rows are not far off their fit; all, where many would be."""
    left = fitted((), columns, target).predict(columns) - target
    off = np.abs(left - np.nanmedian(left))
    kept = ~(off > OUTLIER * 1.4826 * np.nanmedian(off))
    return kept if kept.mean() >= 1.0 - MOST_OUTLIERS else np.ones(len(kept), dtype=bool)


def _chosen(
    columns: np.ndarray, target: np.ndarray, kinds: np.ndarray, most: int
) -> List[List[int]]:
    """Return the best columns: one, two, and so on; no two of one of the `kinds`."""
    gram = _Gram(columns, target)
    return [gram.exchanged(places, kinds) for places in gram.pursued(most)]


class _Gram:
    """The products of some standardised columns with one another, and with the target."""

    def __init__(self, columns: np.ndarray, target: np.ndarray) -> None:
        known = np.isfinite(columns)
        self._used = np.flatnonzero(known.mean(axis=0) > 1.0 - MOST_MISSING)
        rows = known[:, self._used].all(axis=1)
        columns, target = columns[np.ix_(rows, self._used)], target[rows]
        columns = columns - columns.mean(axis=0)
        deviations = columns.std(axis=0)
        self._varied = deviations > 0.0
        columns /= np.where(self._varied, deviations, 1.0)
        self._gram = columns.T @ columns / max(len(target), 1)
        self._told = columns.T @ (target - np.mean(target)) / max(len(target), 1)

    def best(self, count: int) -> List[int]:
        """Return the columns that tell most of the target alone."""
        return [int(self._used[each]) for each in np.argsort(-np.abs(self._told))[:count]]

    def pursued(self, most: int) -> List[List[int]]:
        """Return the columns of orthogonal matching pursuit: one, two, and so on."""
        count = min(most, int(np.count_nonzero(self._varied)))
        if count < 1:
            return []
        with warnings.catch_warnings():
            # It ends early where all further columns say what those before said.
            warnings.simplefilter("ignore", RuntimeWarning)
            path = orthogonal_mp_gram(
                self._gram, self._told, n_nonzero_coefs=count, return_path=True
            )
        steps = np.reshape(path, (len(self._told), -1)).T
        return [self._used[np.flatnonzero(step)].tolist() for step in steps if step.any()]

    def exchanged(self, places: Sequence[int], kinds: np.ndarray) -> List[int]:
        """Return the columns where each is exchanged for a better one, beside the others."""
        chosen = np.searchsorted(self._used, places).tolist()
        kinds = kinds[self._used]
        for _ in range(SWEEPS):
            before = list(chosen)
            for place in range(len(chosen)):
                others = chosen[:place] + chosen[place + 1 :]
                chosen[place] = self._next(others, chosen[place], kinds)
            if chosen == before:
                break
        return [int(self._used[each]) for each in chosen]

    def _next(self, others: Sequence[int], now: int, kinds: np.ndarray) -> int:
        """Return the column that tells most of what others leave of the target."""
        left, told = np.diag(self._gram).copy(), self._told
        if others:
            solved = np.linalg.solve(
                self._gram[np.ix_(others, others)], self._gram[others, :]
            )
            left -= np.sum(self._gram[others, :] * solved, axis=0)
            told = told - self._told[others] @ solved
        gains = np.where(left > LEAST_LEFT, told**2 / np.maximum(left, LEAST_LEFT), -1.0)
        gains[np.isin(kinds, kinds[others])] = -1.0
        best = int(np.argmax(gains))
        return best if gains[best] > gains[now] else now
