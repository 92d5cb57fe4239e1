"""Short models: a few terms of the library, found by orthogonal matching pursuit (scikit-learn)"""
import warnings
from typing import Dict, List, NamedTuple, Optional, Sequence, Tuple

import numpy as np
from sklearn.linear_model import orthogonal_mp_gram

from shsa_learning.learn.evaluation import Knowledge
from shsa_learning.learn.features import Features
from shsa_learning.learn.models import MOST_OUTLIERS, OUTLIER, standard
from shsa_learning.learn.terms import behind_lags, library

MOST_TERMS = 5
"""Of a model, unless more are asked for."""
ROWS_A_TERM = 12
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
        best = [place for path in gram.pursued(SHORTLIST)[-1:] for place in path]
        numbers = gram.numbers([*best, *gram.best(SHORTLIST)])
        terms = list(dict.fromkeys(self._library[number] for number in numbers))
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
    (means, scales), middle = standard(columns), float(np.mean(target))
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
    gram = _Gram(columns, target, kinds)
    found: List[List[int]] = []
    for path in gram.pursued(most):
        starts = [path]
        if len(found) == 1:
            starts.append(gram.best_pair())
        elif found:
            starts.append(gram.extended(found[-1]))
        found.append(max((gram.exchanged(start) for start in starts), key=gram.told_by))
    return [gram.numbers(places) for places in found]


class _Gram:
    """The products of some standardised columns with one another, and with the target."""

    def __init__(
        self, columns: np.ndarray, target: np.ndarray, kinds: Optional[np.ndarray] = None
    ) -> None:
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
        self._kinds = (np.arange(len(known.T)) if kinds is None else kinds)[self._used]

    def numbers(self, places: Sequence[int]) -> List[int]:
        """Return the numbers of columns here in what this was made of."""
        return [int(self._used[place]) for place in places]

    def best(self, count: int) -> List[int]:
        """Return the columns that tell most of the target alone."""
        return [int(each) for each in np.argsort(-np.abs(self._told))[:count]]

    def best_pair(self) -> List[int]:
        """Return the two columns that tell most of the target together."""
        left = 1.0 - np.square(self._gram)
        both = np.square(self._told)[:, None] + np.square(self._told)
        both -= 2.0 * np.outer(self._told, self._told) * self._gram
        allowed = (left > LEAST_LEFT) & (self._kinds[:, None] != self._kinds)
        told = np.where(allowed, both / np.maximum(left, LEAST_LEFT), -1.0)
        return [int(each) for each in np.unravel_index(np.argmax(told), told.shape)]

    def told_by(self, places: Sequence[int]) -> float:
        """Return how much of the target's variance some columns tell together."""
        told, gram = self._told[places], self._gram[np.ix_(places, places)]
        return float(told @ np.linalg.lstsq(gram, told, rcond=1e-12)[0])

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
        return [np.flatnonzero(step).tolist() for step in steps if step.any()]

    def extended(self, places: Sequence[int]) -> List[int]:
        """Return the columns and the one that tells most of what they leave."""
        return [*places, int(np.argmax(self._gains(places)))]

    def exchanged(self, places: Sequence[int]) -> List[int]:
        """Return the columns where each is exchanged for a better one, beside the others."""
        chosen = list(places)
        for _ in range(SWEEPS):
            before = list(chosen)
            for place, now in enumerate(before):
                gains = self._gains(chosen[:place] + chosen[place + 1 :])
                best = int(np.argmax(gains))
                chosen[place] = best if gains[best] > gains[now] else now
            if chosen == before:
                break
        return chosen

    def _gains(self, others: Sequence[int]) -> np.ndarray:
        """Return how much each column tells of what others leave of the target."""
        left, told = np.diag(self._gram).copy(), self._told
        if others:
            among = self._gram[np.ix_(others, others)]
            solved = np.linalg.lstsq(among, self._gram[others, :], rcond=1e-12)[0]
            left -= np.sum(self._gram[others, :] * solved, axis=0)
            told = told - self._told[others] @ solved
        gains = np.where(left > LEAST_LEFT, told**2 / np.maximum(left, LEAST_LEFT), -1.0)
        gains[np.isin(self._kinds, self._kinds[list(others)])] = -1.0
        return gains
