"""The choice of a model: the simplest within one standard error of the best, on blocks.

Nested: each outer block is predicted by a model whose form, delays and coefficients were chosen
without it, so its error is that of the whole procedure.
"""
from typing import Callable, Dict, List, Mapping, NamedTuple, Sequence, Tuple

import numpy as np

from shsa_learning.figures import rms
from shsa_learning.learn.delays import Columns, Lag, choose
from shsa_learning.learn.models import LAW, LEVELS, MEAN, Recipe, fit
from shsa_learning.learn.table import Fold, blocked, shuffled

OUTER, INNER = 6, 4
"""Blocks: of all rows for the error, and of what is left for the choice."""


class Rung(NamedTuple):
    """The mean of a recipe's RMS errors on the blocks of a choice, and its standard error."""

    recipe: Recipe
    rms: float
    standard_error: float


class Choice(NamedTuple):
    """A choice among some rows: the model, the lag of each input, and the errors of all."""

    recipe: Recipe
    lags: Tuple[Lag, ...]
    rungs: Tuple[Rung, ...]


class CrossValidation(NamedTuple):
    """Predictions for rows that the models have not seen.

    `predicted` and `mean` (of what was learned from) by row, NaN where nothing was said; `block`
    of each row; `choices`: of each block.
    """

    predicted: np.ndarray
    mean: np.ndarray
    block: np.ndarray
    choices: Tuple[Choice, ...]


class Candidates:
    """The candidates: recipes that are fitted, and laws whose numbers are known.

    `laws`: what each law says of each row that fits look at.
    """

    def __init__(
        self,
        columns: Columns,
        recipes: Sequence[Recipe],
        laws: Mapping[str, np.ndarray],
        seed: int,
    ) -> None:
        self.columns = columns
        self.laws = dict(laws)
        self.recipes = [Recipe(MEAN), *(Recipe(LAW, law=name) for name in laws), *recipes]
        self._seed = seed

    def predict(
        self, recipe: Recipe, lags: Tuple[Lag, ...], train: np.ndarray, test: np.ndarray
    ) -> np.ndarray:
        """Fit a recipe to the rows `train` and predict the rows `test`; NaN: no prediction."""
        if recipe.rung == LAW:
            return self.laws[recipe.law][test]
        inputs, target = self.columns.matrix(lags), self.columns.target
        known = np.isfinite(inputs).all(axis=1)
        learn, told = train[known[train]], known[test]
        result = np.full(len(test), np.nan)
        if len(learn) > 0 and told.any():
            formula = fit(recipe, inputs[learn], target[learn], self._seed)
            result[told] = formula.predict(inputs[test[told]])
        return result

    def choose(self, rows: np.ndarray) -> Choice:
        """Choose the simplest recipe within one standard error of the best, by some rows alone."""
        lags = choose(self.columns, rows)
        folds = [_of(rows, fold) for fold in blocked(self.columns.time[rows], INNER)]
        rungs = []
        for recipe in self.recipes:
            errors = [self._rms(recipe, lags, fold) for fold in folds]
            spread = float(np.std(errors, ddof=1)) if np.isfinite(errors).all() else 0.0
            rungs.append(Rung(recipe, float(np.mean(errors)), spread / np.sqrt(len(errors))))
        best = min(rungs, key=lambda rung: rung.rms)
        limit = best.rms + best.standard_error
        chosen = min(
            (rung for rung in rungs if rung.rms <= limit),
            key=lambda rung: (LEVELS[rung.recipe.rung], rung.rms),
        )
        return Choice(chosen.recipe, lags, tuple(rungs))

    def _rms(self, recipe: Recipe, lags: Tuple[Lag, ...], fold: Fold) -> float:
        off = self.predict(recipe, lags, *fold) - self.columns.target[fold.test]
        told = np.isfinite(off)
        # Who says nothing of many rows is no help.
        return rms(off[told]) if told.mean() > 0.9 else float("inf")


def cross_validate(candidates: Candidates, step: Callable[[float], object]) -> CrossValidation:
    """Predict each block by what is chosen and fitted without it.

    `step` is told the share of the work that is done after each.
    """
    columns = candidates.columns
    rows = len(columns.target)
    predicted, mean = np.full(rows, np.nan), np.full(rows, np.nan)
    block = np.zeros(rows, dtype=int)
    choices: List[Choice] = []
    folds = blocked(columns.time, OUTER)
    for number, fold in enumerate(folds):
        choice = candidates.choose(fold.train)
        predicted[fold.test] = candidates.predict(choice.recipe, choice.lags, *fold)
        mean[fold.test] = np.mean(columns.target[fold.train])
        block[fold.test] = number
        choices.append(choice)
        step(1.0 / (len(folds) + 1))
    return CrossValidation(predicted, mean, block, tuple(choices))


def errors_of(candidates: Candidates, choice: Choice, seed: int) -> Dict[str, float]:
    """Return the RMS error of a choice on rows that were left out in blocks, and at random."""
    columns = candidates.columns
    ways = {
        "blocked": blocked(columns.time, OUTER),
        "shuffled": shuffled(len(columns.target), OUTER, seed),
    }
    result = {}
    for name, folds in ways.items():
        parts = [
            candidates.predict(choice.recipe, choice.lags, *fold) - columns.target[fold.test]
            for fold in folds
        ]
        off = np.concatenate(parts)
        result[name] = rms(off[np.isfinite(off)])
    return result


def _of(rows: np.ndarray, fold: Fold) -> Fold:
    return Fold(rows[fold.train], rows[fold.test])
