"""Learns a relation from rows: chosen, tested on what it has not seen, and refused or accepted"""
import math
from dataclasses import dataclass
from typing import Callable, Dict, Mapping, Optional, Sequence, Tuple

import numpy as np

from shsa_core.model.error import Error
from shsa_learning.figures import error_of, rms
from shsa_learning.learn import refusal
from shsa_learning.learn.delays import DELAYS_S, FILTERS_S, Lag
from shsa_learning.learn.evaluation import Knowledge, Known
from shsa_learning.learn.features import Features, function_of
from shsa_learning.learn.fitting import Model, model_of
from shsa_learning.learn.models import LAW, SHORT, TERMS, Recipe, fit, ladder
from shsa_learning.learn.rows import Data
from shsa_learning.learn.screening import screened
from shsa_learning.learn.selection import (
    FAILURES,
    Candidates,
    CrossValidation,
    cross_validate,
    errors_of,
)
from shsa_learning.learn.short import MOST_TERMS, ShortModels
from shsa_learning.learn.table import Table
from shsa_learning.learn.written import law_of, rounded


MOST_DELAY_S = 0.5
MOST_LADDER_INPUTS = 8
"""Of the ladder beside short models: the inputs of the terms that tell most."""
FEW_ROWS = 300
"""They do for the length of a model's text."""
ROWS_AN_INPUT = 30
"""Fewer rows bear no further input of the ladder."""


@dataclass(frozen=True)
class Learned:
    """The outcome: a model with its error on rows that it had not seen, or why there is none.

    `error` in the unit of the property; `span`: of the target, largest minus smallest value;
    `worst`: the RMS error in the worst block. `columns`, `validation`: the data and predictions,
    for pictures. `left_out`: inputs, and why; `skipped`: models that failed; `ladder`: the inputs
    of models that are not short. The rest is None where the data alone is refused.
    """

    target: str
    reasons: Tuple[str, ...]
    left_out: Mapping[str, str]
    model: Optional[Model] = None
    error: Optional[Error] = None
    span: float = math.nan
    worst: float = math.nan
    blocks: int = 0
    columns: Optional[Features] = None
    validation: Optional[CrossValidation] = None
    skipped: Tuple[str, ...] = ()
    ladder: Tuple[str, ...] = ()

    @property
    def accepted(self) -> bool:
        """Return whether there is no reason against it."""
        return not self.reasons


def learn(
    data: Data,
    choice: str = "auto",
    seed: int = 0,
    laws: Optional[Mapping[str, Known]] = None,
    source: str = "",
    step: Callable[[float], object] = lambda share: None,
    terms: int = MOST_TERMS,
    known: Knowledge = Knowledge(),
) -> Learned:
    """Learns the target of the rows from their inputs.

    `choice`: the rungs of the ladder, as in `models.CHOICES`; `laws`: what laws with known numbers
    say of each row; `source`: where the data is from, in words; `step` is told each share of the
    work that is done; `terms`: the most of a short model; `known`: units, and laws as terms.
    """
    table, left_out = data.table, dict(data.left_out)
    target = table.of(())
    reasons = [*data.suspicious, *refusal.of_target(target, data.outliers.get(table.name, 0))]
    if not reasons:
        left = screened(table, data.outliers, data.computed_from, data.asked)
        table = left.table
        left_out.update(left.left_out)
        reasons += left.against
    if not reasons and not table.names:
        why = "; ".join(f"{name}: {why}" for name, why in left_out.items()) or "no other series"
        reasons.append(f"there is nothing to learn {table.name} from ({why})")
    if reasons:
        return Learned(table.name, tuple(reasons), left_out)
    learner = _Learner(table, choice, seed, laws or {}, terms, known)
    return learner.run(left_out, data.computed_from, source, step)


class _Learner:
    """Learns from the rows of a table."""

    def __init__(
        self,
        table: Table,
        choice: str,
        seed: int,
        laws: Mapping[str, Known],
        terms: int,
        known: Knowledge,
    ) -> None:
        self._table, self._seed, self._laws = table, seed, laws
        features = Features(table)
        short = ShortModels(features, known, table.period) if choice in ("auto", TERMS) else None
        names = table.names
        if short is not None:
            names = self._telling(short, features)
        self._ladder = Features(table.of(names), features.rows)
        plain = self._ladder.matrix(names)
        recipes = ladder(choice, plain, terms)
        said = {name: law.said[features.rows] for name, law in laws.items()}
        self._candidates = Candidates(features, short, self._ladder, recipes, said, seed)
        for recipe in recipes:
            why = self._unwritable(recipe, plain) if recipe.rung not in SHORT else ""
            if why:
                self._candidates.skip(recipe, why)

    def run(
        self,
        left_out: Mapping[str, str],
        computed_from: Sequence[str],
        source: str,
        step: Callable[[float], object],
    ) -> Learned:
        """Return the outcome, told by what was predicted without having been seen."""
        candidates, table = self._candidates, self._table
        choice = candidates.choose(np.arange(len(candidates.features.rows)))
        step(0.2)
        candidates.keep_as_simple_as(choice.recipe)
        validation = cross_validate(candidates, lambda share: step(0.8 * share))
        target = candidates.features.target
        off = validation.predicted - target
        told = np.isfinite(off)
        off, block = off[told], validation.block[told]
        try:
            names = tuple(self._ladder.names)
            model = model_of(choice, table, names, self._laws, rms(off), self._seed)
        except FAILURES as error:
            candidates.skip(choice.recipe, str(error))
            return self.run(left_out, computed_from, source, step)
        errors = errors_of(candidates, choice, self._seed)
        mean_off = (validation.mean - target)[told]
        said = model.predict(table)
        delay = delay_of(said, table.target, table.period)
        reasons = list(model.flips)
        if choice.recipe.rung != LAW and not set(model.inputs) & set(computed_from):
            both = np.isfinite(said) & np.isfinite(table.target)
            left = said[both] - table.target[both]
            reasons += refusal.too_perfect(table.name, model.inputs, left, table.target[both])
        return Learned(
            table.name,
            (*refusal.of_model(off, mean_off, block, target[told], errors), *reasons),
            left_out,
            model,
            error_of(off, rms(mean_off), delay, source),
            float(np.ptp(target)),
            refusal.worst_block(off, block),
            len(validation.choices),
            candidates.features,
            validation,
            tuple(f"{recipe}: {why}" for recipe, why in candidates.failed.items()),
            tuple(self._ladder.names),
        )

    def _telling(self, short: ShortModels, features: Features) -> Tuple[str, ...]:
        """Return the inputs of the terms that tell most of the target, in the table's order."""
        most = max(1, min(MOST_LADDER_INPUTS, len(features.rows) // ROWS_AN_INPUT))
        found: Dict[str, None] = {}
        for term in short.shortlist(np.arange(len(features.rows))):
            inputs = function_of("", term).inputs
            if len({*found, *inputs}) <= most:
                found.update(dict.fromkeys(inputs))
        return tuple(name for name in self._table.names if name in found)

    def _unwritable(self, recipe: Recipe, inputs: np.ndarray) -> str:
        """Return why the language has no room for such a model; its error plays no part."""
        names = tuple(self._ladder.names)
        some = slice(None, None, 1 + len(inputs) // FEW_ROWS)
        inputs, target = inputs[some], self._ladder.target[some]
        longest = (Lag(DELAYS_S[-1], FILTERS_S[-1]),) * inputs.shape[1]
        try:
            formula = rounded(fit(recipe, inputs, target, self._seed), inputs, 0.0)
            law_of(formula, names, longest)
        except FAILURES as error:
            return str(error)
        return ""


def delay_of(said: np.ndarray, target: np.ndarray, period: float) -> float:
    """By how much (s) values lag behind the target: where they fit it best; never negative."""
    most = min(int(MOST_DELAY_S / period) if period > 0.0 else 0, len(said) // 4)
    errors = []
    for rows in range(most + 1):
        off = said[rows:] - target[: len(target) - rows]
        errors.append(rms(off[np.isfinite(off)]))
    return float(np.argmin(errors) * period)
