"""Learns a relation from rows: chosen, tested on what it has not seen, and refused or accepted"""
import math
from dataclasses import dataclass
from typing import Callable, List, Mapping, Optional, Sequence, Tuple

import numpy as np

from shsa_core.errors import ExpressionError
from shsa_core.model.error import Error
from shsa_learning.figures import error_of, rms
from shsa_learning.learn import refusal
from shsa_learning.learn.delays import DELAYS_S, FILTERS_S, Columns, Lag, lagged
from shsa_learning.learn.evaluation import Known
from shsa_learning.learn.formula import Formula, Terms
from shsa_learning.learn.models import DIVIDED, LAW, LINEAR, PRODUCTS, Recipe, fit, ladder
from shsa_learning.learn.rows import Data
from shsa_learning.learn.selection import (
    Candidates,
    Choice,
    CrossValidation,
    errors_of,
    cross_validate,
)
from shsa_learning.learn.table import Table
from shsa_learning.learn.written import constraint, law_of, rounded


MOST_DELAY_S = 0.5
COEFFICIENTS_MEAN_SOMETHING = (LINEAR, PRODUCTS, DIVIDED)


@dataclass(frozen=True)
class Model:
    """A model: the choice, what it may read (`names`), its text, and where it holds.

    `formula`: fitted to all rows; its inputs are `names`. None: it is the `law`, as it stands.
    """

    choice: Choice
    names: Tuple[str, ...]
    function: str
    constraint: str
    formula: Optional[Formula]
    law: Optional[Known] = None

    @property
    def inputs(self) -> Tuple[str, ...]:
        """The properties that it reads."""
        if self.formula is None:
            return self.names
        return tuple(self.names[number] for number in self.formula.used)

    def predict(self, table: Table) -> np.ndarray:
        """Predict the target of each row of the table; NaN where that is not possible.

        A law says it of the rows that it was learned from alone.
        """
        if self.formula is None:
            assert self.law is not None
            return self.law.said
        lags = zip(self.names, self.choice.lags)
        columns = [lagged(table.time, table.inputs[name], lag) for name, lag in lags]
        matrix = np.array(columns).T
        known = np.isfinite(matrix).all(axis=1)
        result = np.full(len(table.time), np.nan)
        if known.any():
            result[known] = self.formula.predict(matrix[known])
        return result


@dataclass(frozen=True)
class Learned:
    """The outcome: a model with its error on rows that it had not seen, or why there is none.

    `error` in the unit of the property; `span`: of the target, largest minus smallest value;
    `worst`: the RMS error in the worst block. `columns`, `validation`: the data and predictions,
    for pictures. `left_out`: inputs, and why. The rest is None where the data alone is refused.
    """

    target: str
    reasons: Tuple[str, ...]
    left_out: Mapping[str, str]
    model: Optional[Model] = None
    error: Optional[Error] = None
    span: float = math.nan
    worst: float = math.nan
    blocks: int = 0
    columns: Optional[Columns] = None
    validation: Optional[CrossValidation] = None

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
) -> Learned:
    """Learns the target of the rows from their inputs.

    `choice`: the rungs of the ladder, as in `models.CHOICES`; `laws`: what laws with known numbers
    say of each row; `source`: where the data is from, in words; `step` is told each share of the
    work that is done.
    """
    table, left_out = data.table, dict(data.left_out)
    reasons = list(data.suspicious)
    if table.names:
        reasons += refusal.of_data(table, data.outliers, data.computed_from)
    else:
        why = "; ".join(f"{name}: {why}" for name, why in left_out.items()) or "no other series"
        reasons.append(f"there is nothing to learn {table.name} from ({why})")
    if reasons:
        return Learned(table.name, tuple(reasons), left_out)
    same = refusal.duplicates(table)
    left_out.update({name: f"it says the same as {other}" for name, other in same.items()})
    table = table.of(tuple(name for name in table.names if name not in same))
    learner = _Learner(table, choice, seed, laws or {})
    return learner.run(left_out, data.computed_from, source, step)


class _Learner:
    """Learns from the rows of a table."""

    def __init__(self, table: Table, choice: str, seed: int, laws: Mapping[str, Known]) -> None:
        self._table, self._seed, self._laws = table, seed, laws
        self._columns = Columns(table, table.rows())
        self._plain = self._columns.matrix((Lag(),) * len(table.names))
        recipes = [each for each in ladder(choice, self._plain) if self._writable(each)]
        said = {name: law.said[self._columns.rows] for name, law in laws.items()}
        self._candidates = Candidates(self._columns, recipes, said, seed)

    def run(
        self,
        left_out: Mapping[str, str],
        computed_from: Sequence[str],
        source: str,
        step: Callable[[float], object],
    ) -> Learned:
        """Return the outcome, told by what was predicted without having been seen."""
        columns, table = self._columns, self._table
        validation = cross_validate(self._candidates, step)
        choice = self._candidates.choose(np.arange(len(columns.rows)))
        step(1.0 / (len(validation.choices) + 1))
        off = validation.predicted - columns.target
        told = np.isfinite(off)
        off, block = off[told], validation.block[told]
        mean_off = (validation.mean - columns.target)[told]
        model, reasons = self._model(choice, rms(off), validation.block)
        errors = errors_of(self._candidates, choice, self._seed)
        said = model.predict(table)
        delay = delay_of(said, table.target, table.period)
        error = error_of(off, rms(mean_off), delay, source)
        if choice.recipe.rung != LAW and not set(model.inputs) & set(computed_from):
            both = np.isfinite(said) & np.isfinite(table.target)
            left = said[both] - table.target[both]
            reasons += refusal.too_perfect(table.name, model.inputs, left, table.target[both])
        return Learned(
            table.name,
            (*refusal.of_model(off, mean_off, block, columns.target[told], errors), *reasons),
            left_out,
            model,
            error,
            float(np.ptp(columns.target)),
            refusal.worst_block(off, block),
            len(validation.choices),
            columns,
            validation,
        )

    def _model(self, choice: Choice, off: float, block: np.ndarray) -> Tuple[Model, List[str]]:
        """Fit the choice to all rows; return also why its coefficients should not be used."""
        if choice.recipe.rung == LAW:
            known = self._laws[choice.recipe.law]
            return Model(choice, known.function.inputs, known.function.text, "", None, known), []
        matrix, target = self._columns.matrix(choice.lags), self._columns.target
        usable = np.isfinite(matrix).all(axis=1)
        fitted = fit(choice.recipe, matrix[usable], target[usable], self._seed)
        formula = rounded(fitted, matrix[usable], off)
        names = self._table.names
        rows = self._columns.rows
        seen = {names[k]: self._table.inputs[names[k]][rows] for k in formula.used}
        text = law_of(formula, names, choice.lags).text
        reasons = []
        if isinstance(formula, Terms) and choice.recipe.rung in COEFFICIENTS_MEAN_SOMETHING:
            # A filter could hide the flip of what is behind it.
            reasons = refusal.flipping(formula, names, self._plain, target, block)
        return Model(choice, names, text, constraint(seen), formula), reasons

    def _writable(self, recipe: Recipe) -> bool:
        """Return whether the language has room for such a model; its error plays no part."""
        inputs = self._plain
        formula = rounded(fit(recipe, inputs, self._columns.target, self._seed), inputs, 0.0)
        longest = (Lag(DELAYS_S[-1], FILTERS_S[-1]),) * inputs.shape[1]
        try:
            law_of(formula, self._columns.names, longest)
        except ExpressionError:
            return False
        return True


def delay_of(said: np.ndarray, target: np.ndarray, period: float) -> float:
    """By how much (s) values lag behind the target: where they fit it best; never negative."""
    most = min(int(MOST_DELAY_S / period) if period > 0.0 else 0, len(said) // 4)
    errors = []
    for rows in range(most + 1):
        off = said[rows:] - target[: len(target) - rows]
        errors.append(rms(off[np.isfinite(off)]))
    return float(np.argmin(errors) * period)
