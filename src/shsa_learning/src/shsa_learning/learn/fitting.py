"""The chosen model, fitted to all rows and written as a relation that is run to be believed."""
from dataclasses import dataclass
from typing import List, Mapping, NamedTuple, Optional, Sequence, Tuple

import numpy as np

from shsa_core.errors import ModelError
from shsa_core.language.expression import parse_law
from shsa_core.model.ontology import TransferFunction
from shsa_learning.figures import rms
from shsa_learning.learn import refusal
from shsa_learning.learn.delays import texts
from shsa_learning.learn.evaluation import LEARNED, Known, evaluate
from shsa_learning.learn.features import Features, function_of
from shsa_learning.learn.formula import Terms, products
from shsa_learning.learn.models import DIVIDED, LAW, LINEAR, PRODUCTS, SHORT, fit
from shsa_learning.learn.selection import OUTER, Choice
from shsa_learning.learn.short import fitted, usual
from shsa_learning.learn.table import Fold, Table, block_numbers, blocked
from shsa_learning.learn.written import constraint, law_of, rounded, rounded_sum, text_of_sum

COEFFICIENTS_MEAN_SOMETHING = (LINEAR, PRODUCTS, DIVIDED)
AGREEMENT = 1e-6
"""Of the target's deviation: farther from what was fitted the generated code never is."""
LEAST_SHARE_OF_ROWS = 0.9
"""Of the rows of the fit: the generated code has a value in as many."""


class Part(NamedTuple):
    """A term of a short model: its coefficient, the standard error of that, and what it gains.

    `gain`: by how much the RMS error on unseen blocks is larger without it.
    """

    term: str
    coefficient: float
    standard_error: float
    gain: float


@dataclass(frozen=True)
class Model:
    """A model: the choice, and the relation that it is, which says all that is known of it.

    `law`: what it says of each row, where it is a law of the ontology; `parts`: the terms of a
    short model, the one that gains most first; `flips`: coefficients that should not be believed.
    """

    choice: Choice
    name: str
    relation: TransferFunction
    constraint: str
    law: Optional[Known] = None
    parts: Tuple[Part, ...] = ()
    flips: Tuple[str, ...] = ()

    @property
    def inputs(self) -> Tuple[str, ...]:
        """The properties that it reads."""
        return self.relation.inputs

    @property
    def function(self) -> str:
        """Its text in the ontology's language."""
        return self.relation.text

    def predict(self, table: Table) -> np.ndarray:
        """Run it on each row of the table, beyond its constraint too; NaN where it has no value.

        A law says it of the rows that it was learned from alone.
        """
        if self.law is not None:
            return self.law.said
        return evaluate(self.relation, {}, table)


def model_of(
    choice: Choice,
    table: Table,
    ladder: Sequence[str],
    laws: Mapping[str, Known],
    off: float,
    seed: int,
) -> Model:
    """Fit what was chosen to all rows of a table.

    `ladder`: the inputs that the choice has lags for; `off`: the RMS error on unseen rows. Raises
    ModelError if what would be generated says anything else than what was fitted.
    """
    if choice.recipe.rung == LAW:
        known = laws[choice.recipe.law]
        return Model(choice, str(choice.recipe), known.function, "", known)
    if choice.recipe.rung in SHORT:
        return _short_model(choice, table, off)
    return _ladder_model(choice, table, tuple(ladder), off, seed)


def _short_model(choice: Choice, table: Table, off: float) -> Model:
    used = {name for term in choice.terms for name in function_of("", term).inputs}
    features = Features(table.of(tuple(name for name in table.names if name in used)))
    columns, target = features.matrix(choice.terms), features.target
    known = np.isfinite(columns).all(axis=1)
    known[known] = usual(columns[known], target[known])
    block = block_numbers(features.time, OUTER)
    exact = fitted(choice.terms, columns[known], target[known])
    errors = _standard_errors(choice.terms, columns[known], target[known], block[known])
    sum_ = rounded_sum(exact, errors, columns[known], off)
    relation = _relation(features, text_of_sum(sum_), sum_.predict(columns), table)
    gains = _gains(columns[known], target[known], blocked(features.time[known], OUTER))
    parts = zip(choice.terms, sum_.coefficients, errors, gains)
    ordered = sorted((Part(*each) for each in parts), key=lambda part: -part.gain)
    flips = refusal.flipping(choice.terms, columns[known], target[known], block[known])
    name = f"{choice.recipe}"
    return Model(choice, name, *relation, None, tuple(ordered), tuple(flips))


def _standard_errors(
    terms: Sequence[str], columns: np.ndarray, target: np.ndarray, block: np.ndarray
) -> List[float]:
    """Return the standard error of each coefficient: by leaving out each block in turn."""
    numbers = np.unique(block)
    without = [fitted(terms, columns[block != each], target[block != each]) for each in numbers]
    found = np.array([each.coefficients for each in without])
    count = len(numbers)
    spread = np.sum(np.square(found - found.mean(axis=0)), axis=0)
    return [float(each) for each in np.sqrt((count - 1) / count * spread)]


def _gains(columns: np.ndarray, target: np.ndarray, folds: Sequence[Fold]) -> List[float]:
    """Return by how much the RMS error on unseen blocks is larger without each term."""

    def error(kept: Sequence[int]) -> float:
        parts = [
            fitted((), columns[fold.train][:, kept], target[fold.train]).predict(
                columns[fold.test][:, kept]
            )
            - target[fold.test]
            for fold in folds
        ]
        return rms(np.concatenate(parts))

    every = list(range(columns.shape[1]))
    whole = error(every)
    return [error([each for each in every if each != term]) - whole for term in every]


def _ladder_model(
    choice: Choice, table: Table, names: Tuple[str, ...], off: float, seed: int
) -> Model:
    recipe, lags = choice.recipe, dict(zip(names, choice.lags))
    divisor = names[recipe.divisor]
    while True:
        # A fit may need fewer inputs, and has more rows then.
        features = Features(table.of(names))
        inputs = features.matrix(texts(names, [lags[name] for name in names]))
        known = np.isfinite(inputs).all(axis=1)
        if recipe.divisor >= 0:
            recipe = recipe._replace(divisor=names.index(divisor))
        formula = fit(recipe, inputs[known], features.target[known], seed)
        used = tuple(names[number] for number in formula.used)
        if len(used) in (0, len(names)):
            break
        names = used
    formula = rounded(formula, inputs[known], off)
    said = np.full(len(features.target), np.nan)
    said[known] = formula.predict(inputs[known])
    law = law_of(formula, names, [lags[name] for name in names])
    flips: List[str] = []
    if isinstance(formula, Terms) and recipe.rung in COEFFICIENTS_MEAN_SOMETHING:
        # A filter could hide the flip of what is behind it.
        plain = features.matrix(names)
        target = features.target * (plain[:, recipe.divisor] if recipe.divisor >= 0 else 1.0)
        called = ["*".join(names[each] for each, _ in monomial) for monomial in formula.monomials]
        columns = products(plain, formula.monomials, formula.centres)
        flips = refusal.flipping(called, columns, target, block_numbers(features.time, OUTER))
    named = recipe.named(names)
    return Model(choice, named, *_relation(features, law.text, said, table), None, (), tuple(flips))


def _relation(
    features: Features, text: str, said: np.ndarray, table: Table
) -> Tuple[TransferFunction, str]:
    """Return a text as a relation that gives what was fitted, and the constraint it needs.

    Raises ModelError if its generated code gives anything else.
    """
    names, law = tuple(features.names), parse_law(text)
    seen = {name: table.inputs[name][features.rows] for name in names if name in law.names}
    inputs = tuple(seen)
    relation = TransferFunction(LEARNED + table.name, table.name, inputs, law, 1.0, None, text)
    generated = evaluate(relation, {}, table)[features.rows]
    known = np.isfinite(said)
    both = known & np.isfinite(generated)
    if np.count_nonzero(both) < LEAST_SHARE_OF_ROWS * max(np.count_nonzero(known), 1):
        raise ModelError(text, "its generated code gives no value on the data it was fitted to")
    worst = float(np.max(np.abs(generated[both] - said[both])))
    if not worst <= AGREEMENT * max(
        float(np.std(features.target)), float(np.max(np.abs(said[both])))
    ):
        raise ModelError(text, f"its generated code is off the fitted model by {worst:.2g}")
    return relation, constraint(seen)
