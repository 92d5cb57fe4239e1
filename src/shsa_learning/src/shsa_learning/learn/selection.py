"""The choice of a model: the simplest that is not surely worse than the best, on blocks.

That is by the standard error of the difference, as some blocks are hard for all models. Few blocks
tell that error badly, so it may not be much worse either.

Nested: each outer block is predicted by a model whose form, terms, lags and coefficients were
chosen without it, so its error is that of the whole procedure.
"""
from typing import Callable, Dict, List, Mapping, NamedTuple, Optional, Sequence, Tuple

import numpy as np

from shsa_core.errors import ShsaError
from shsa_learning.figures import rms
from shsa_learning.learn.delays import Lag, choose, texts
from shsa_learning.learn.features import Features
from shsa_learning.learn.models import LAW, LEVELS, MEAN, SHORT, TERMS, Recipe, fit
from shsa_learning.learn.short import ShortModels, Sum
from shsa_learning.learn.table import Fold, blocked, shuffled

OUTER, INNER = 6, 4
"""Blocks: of all rows for the error, and of what is left for the choice."""
FAILURES = (ShsaError, ValueError, ArithmeticError, np.linalg.LinAlgError)
"""Of a model: it is skipped, and that is told."""
MOST_WORSE = 0.1
"""Of the least error: that a model is simpler is worth no more."""
MOST_UNTOLD = 0.1
"""Of the rows: a model that says nothing of more is no help."""


class Rung(NamedTuple):
    """The mean of a recipe's RMS errors on the blocks of a choice.

    `standard_error`: of its difference from the best, block by block.
    """

    recipe: Recipe
    rms: float
    standard_error: float


class Choice(NamedTuple):
    """A choice among some rows: the model, and the errors of all.

    `lags`: of each input of the ladder; `shortlist`: the terms that a short model may have;
    `terms`: those of the short model that was chosen.
    """

    recipe: Recipe
    lags: Tuple[Lag, ...]
    shortlist: Tuple[str, ...]
    terms: Tuple[str, ...]
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

    `ladder`: the inputs of the recipes that are no short models; `laws`: what each law says of
    each row that fits look at; `failed`: the recipes that failed, and why.
    """

    def __init__(
        self,
        features: Features,
        short: Optional[ShortModels],
        ladder: Features,
        recipes: Sequence[Recipe],
        laws: Mapping[str, np.ndarray],
        seed: int,
    ) -> None:
        self.features, self.ladder, self._short = features, ladder, short
        self.laws = dict(laws)
        self.recipes = [Recipe(MEAN), *(Recipe(LAW, law=name) for name in laws), *recipes]
        self.failed: Dict[Recipe, str] = {}
        self._seed = seed
        self._found: Dict[Tuple[Tuple[str, ...], bytes], List[Sum]] = {}

    def skip(self, recipe: Recipe, why: str) -> None:
        """Leave a recipe out from now on."""
        self.failed[recipe] = why
        self.recipes = [each for each in self.recipes if each != recipe]

    def keep_as_simple_as(self, recipe: Recipe) -> None:
        """Leave out what is less simple: it was not worth its complexity on all rows."""
        self.recipes = [each for each in self.recipes if LEVELS[each.rung] <= LEVELS[recipe.rung]]

    def predict(self, recipe: Recipe, choice: Choice, fold: Fold) -> np.ndarray:
        """Fit a recipe to the rows of a fold and predict those of its test; NaN: no prediction."""
        if recipe.rung == LAW:
            return self.laws[recipe.law][fold.test]
        if recipe.rung in SHORT:
            return self._sums(self._summed(recipe, choice), fold)[int(recipe.setting) - 1]
        inputs = self.ladder.matrix(texts(self.ladder.names, choice.lags))
        known = np.isfinite(inputs).all(axis=1)
        learn, told = fold.train[known[fold.train]], known[fold.test]
        result = np.full(len(fold.test), np.nan)
        if len(learn) > 0 and told.any():
            formula = fit(recipe, inputs[learn], self.features.target[learn], self._seed)
            result[told] = formula.predict(inputs[fold.test[told]])
        return result

    def _summed(self, recipe: Recipe, choice: Choice) -> Tuple[str, ...]:
        """Return what a short model may be a sum of."""
        return choice.shortlist if recipe.rung == TERMS else tuple(self.features.names)

    def _sums(self, shortlist: Tuple[str, ...], fold: Fold) -> List[np.ndarray]:
        """Return what the best sum of one term, of two, and so on predicts."""
        key = shortlist, fold.train.tobytes()
        if key not in self._found:
            self._found[key] = self.sums(shortlist, fold.train)
        said = [
            each.predict(self.features.matrix(each.terms)[fold.test]) for each in self._found[key]
        ]
        most = self._most_terms
        nothing = np.full(len(fold.test), np.nan)
        return said + [said[-1] if said else nothing] * (most - len(said))

    def sums(self, shortlist: Sequence[str], rows: np.ndarray) -> List[Sum]:
        """Return the best sum of one term, of two, and so on, fitted to some rows."""
        assert self._short is not None
        return self._short.sums(shortlist, rows, self._most_terms)

    @property
    def _most_terms(self) -> int:
        return int(max(each.setting for each in self.recipes if each.rung in SHORT))

    def choose(self, rows: np.ndarray) -> Choice:
        """Choose the simplest recipe that is not surely worse than the best, by some rows alone."""
        kinds = {recipe.rung for recipe in self.recipes}
        lags: Tuple[Lag, ...] = (Lag(),) * len(self.ladder.names)
        if kinds - {MEAN, LAW, *SHORT}:
            lags = choose(self.ladder, rows)
        shortlist: Tuple[str, ...] = ()
        if TERMS in kinds and self._short is not None:
            shortlist = self._short.shortlist(rows)
        self._found.clear()
        prepared = Choice(Recipe(MEAN), lags, shortlist, (), ())
        inner = blocked(self.features.time[rows], INNER)
        folds = [Fold(rows[each.train], rows[each.test]) for each in inner]
        all_ = {recipe: self._errors(recipe, prepared, folds) for recipe in list(self.recipes)}
        errors = {recipe: each for recipe, each in all_.items() if recipe not in self.failed}
        best = min(errors.values(), key=lambda each: float(np.mean(each)))
        least = float(np.mean(best))
        rungs = [Rung(recipe, *_beside(best, each)) for recipe, each in errors.items()]
        chosen = min(
            (
                each
                for each in rungs
                if each.rms <= least + min(each.standard_error, MOST_WORSE * least)
            ),
            key=lambda rung: (*rung.recipe.complexity, rung.rms),
        ).recipe
        terms: Tuple[str, ...] = ()
        if chosen.rung in SHORT:
            summed = self._summed(chosen, prepared)
            terms = self.sums(summed, rows)[: int(chosen.setting)][-1].terms
        return Choice(chosen, lags, shortlist, terms, tuple(rungs))

    def _errors(self, recipe: Recipe, prepared: Choice, folds: Sequence[Fold]) -> List[float]:
        """Return the RMS error on each fold; a recipe that fails is left out from then on."""
        errors = []
        try:
            for fold in folds:
                off = self.predict(recipe, prepared, fold) - self.features.target[fold.test]
                told = np.isfinite(off)
                errors.append(rms(off[told]) if told.mean() > 1.0 - MOST_UNTOLD else np.inf)
        except FAILURES as error:
            self.skip(recipe, str(error))
        return errors


def cross_validate(candidates: Candidates, step: Callable[[float], object]) -> CrossValidation:
    """Predict each block by what is chosen and fitted without it.

    `step` is told the share of the work that is done after each.
    """
    features = candidates.features
    rows = len(features.target)
    predicted, mean = np.full(rows, np.nan), np.full(rows, np.nan)
    block = np.zeros(rows, dtype=int)
    choices: List[Choice] = []
    folds = blocked(features.time, OUTER)
    for number, fold in enumerate(folds):
        choice = candidates.choose(fold.train)
        predicted[fold.test] = candidates.predict(choice.recipe, choice, fold)
        mean[fold.test] = np.mean(features.target[fold.train])
        block[fold.test] = number
        choices.append(choice)
        step(1.0 / (len(folds) + 1))
    return CrossValidation(predicted, mean, block, tuple(choices))


def errors_of(candidates: Candidates, choice: Choice, seed: int) -> Dict[str, float]:
    """Return the RMS error of a choice on rows that were left out in blocks, and at random."""
    features = candidates.features
    ways = {
        "blocked": blocked(features.time, OUTER),
        "shuffled": shuffled(len(features.target), OUTER, seed),
    }
    result = {}
    for name, folds in ways.items():
        parts = [
            candidates.predict(choice.recipe, choice, fold) - features.target[fold.test]
            for fold in folds
        ]
        off = np.concatenate(parts)
        result[name] = rms(off[np.isfinite(off)])
    return result


def _beside(best: Sequence[float], errors: Sequence[float]) -> Tuple[float, float]:
    """Return the mean of some errors, and the standard error of how much more they are."""
    if not np.isfinite(errors).all():
        return np.inf, 0.0
    more = np.subtract(errors, best)
    return float(np.mean(errors)), float(np.std(more, ddof=1) / np.sqrt(len(more)))
