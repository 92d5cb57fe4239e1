"""Fitted models as expressions of the ontology's language"""
import math
from dataclasses import fields, replace
from typing import Any, Dict, Mapping, Sequence

import numpy as np

from shsa_core.language.expression import Expression, Law, compose, parse_expression
from shsa_learning.learn.delays import Lag
from shsa_learning.learn.formula import MAGNITUDE, Formula, Kernels, Network, Terms
from shsa_learning.learn.short import Sum

DIGITS = (6, 9, 12, 17)
"""Of the coefficients: the fewest that make no difference are written."""
NO_DIFFERENCE = 1e-3  # of the RMS error
SMALL_DIFFERENCE = 0.1  # of the RMS error
MOST_DIGITS = 12
WIDER = 0.05
"""Of what was seen of an input: the constraint leaves so much room at both ends.

Beyond it the model has no value, and another relation is taken: a usual noise must not get there.
"""
LEAST_ERROR = 1e-6
"""Of a coefficient: a standard error below it tells nothing of the digits."""


def rounded(formula: Any, inputs: np.ndarray, rms: float) -> Any:
    """Round the coefficients as they will be written: what is tested is what is written."""
    exact = formula.predict(inputs)
    for digits in DIGITS:
        short = replace(
            formula,
            **{
                field.name: _rounded(getattr(formula, field.name), digits)
                for field in fields(formula)
            },
        )
        if np.max(np.abs(short.predict(inputs) - exact)) <= NO_DIFFERENCE * rms:
            break
    return short


def _rounded(value: Any, digits: int) -> Any:
    if isinstance(value, tuple):
        return tuple(_rounded(each, digits) for each in value)
    if not isinstance(value, float):
        return value
    return _without_unit(float(f"{value:.{digits}g}"))


def _without_unit(short: float) -> float:
    return short * (1.0 + 1e-9) if _plain(short) else short


def _plain(number: float) -> bool:
    """Return whether a number would have no unit, as a whole one and a half have none."""
    return number != 0.0 and (number == round(number) or abs(number) == 0.5)


def rounded_sum(sum_: Sum, errors: Sequence[float], columns: np.ndarray, rms: float) -> Sum:
    """Round a sum of terms: each coefficient has two digits of its standard error.

    It gets more where that makes a difference, as it does where terms tell much the same.
    """
    exact = sum_.predict(columns)
    for more in range(MOST_DIGITS):
        coefficients = tuple(
            _to_error(value, error, more) for value, error in zip(sum_.coefficients, errors)
        )
        short = Sum(0.0, coefficients, sum_.terms)
        middle = float(np.nanmean(exact - short.predict(columns)))
        short = short._replace(intercept=_to_error(middle, 0.01 * rms, 0))
        if np.nanmax(np.abs(short.predict(columns) - exact)) <= SMALL_DIFFERENCE * rms:
            break
    return short


def _to_error(value: float, error: float, more: int) -> float:
    """Round a value so that two digits of its error are left, and some more."""
    error = max(error, LEAST_ERROR * abs(value), 1e-300)
    digits = min(1 + more - math.floor(math.log10(error)), 300)
    short = float(round(value, digits))
    # One digit more spells a whole number such that it may have a unit.
    return short if not _plain(short) else _without_unit(float(round(value, digits + 1)))


def text_of_sum(sum_: Sum) -> str:
    """Return a sum of terms as an expression."""
    parts = zip(sum_.coefficients, sum_.terms)
    return repr(sum_.intercept) + "".join(_signed(value, f"*{term}") for value, term in parts)


def text_of(formula: Formula, inputs: Sequence[str]) -> str:
    """Return the formula as an expression; each of `inputs` is what stands for it there."""
    if isinstance(formula, Terms):
        return _terms(formula, inputs)
    if isinstance(formula, Network):
        return _network(formula, inputs)
    assert isinstance(formula, Kernels)
    return _kernels(formula, inputs)


def law_of(formula: Formula, names: Sequence[str], lags: Sequence[Lag]) -> Law:
    """Return the formula as a law over properties, each behind its lag.

    What is behind a lag is computed once, and has a name on the way. Raises ExpressionError where
    the language has no room for it.
    """
    places = list(names)
    steps: Dict[str, Expression] = {}
    for number in formula.used:
        if lags[number] != Lag():
            places[number] = _free(f"past_{names[number]}", names)
            steps[places[number]] = parse_expression(lags[number].text(names[number]))
    return compose(steps, parse_expression(text_of(formula, places)))


def _free(name: str, taken: Sequence[str]) -> str:
    while name in taken:
        name += "_"
    return name


def constraint(seen: Mapping[str, np.ndarray]) -> str:
    """Return the constraint of a model: the range seen of each input, and a quarter more."""
    parts = []
    for name, values in seen.items():
        low, high = float(np.min(values)), float(np.max(values))
        room = WIDER * (high - low)
        parts.append(f"{low - room:.4g} < {name} < {high + room:.4g}")
    return " and ".join(parts)


def _terms(terms: Terms, inputs: Sequence[str]) -> str:
    places = []
    for name, centre in zip(inputs, terms.centres):
        places.append(f"({name}{_signed(-centre, '')})" if centre else name)
    parts = []
    for coefficient, monomial in zip(terms.coefficients, terms.monomials):
        factors = [
            f"abs({_bare(places[number])})" if kind == MAGNITUDE else places[number]
            for number, kind in monomial
        ]
        parts.append(_signed(coefficient, "*" + "*".join(factors)))
    total = repr(terms.intercept) + "".join(parts)
    return f"({total}) / {inputs[terms.divisor]}" if terms.divisor >= 0 else total


def _bare(place: str) -> str:
    return place[1:-1] if place.startswith("(") else place


def _network(network: Network, inputs: Sequence[str]) -> str:
    neurons = []
    for outer, offset, weights in zip(network.outer, network.offsets, network.weights):
        terms = "".join(_signed(weight, f"*{name}") for weight, name in zip(weights, inputs))
        neurons.append(_signed(outer, f"*tanh({offset!r}{terms})"))
    return repr(network.intercept) + "".join(neurons)


def _kernels(kernels: Kernels, inputs: Sequence[str]) -> str:
    parts = []
    for weight, centre in zip(kernels.weights, kernels.centres):
        squares = " + ".join(
            f"({scale!r}*{name}{_signed(-each, '')})**2"
            for scale, name, each in zip(kernels.scales, inputs, centre)
        )
        parts.append(_signed(weight, f"*exp(-({squares}))"))
    return repr(kernels.intercept) + "".join(parts)


def _signed(value: float, rest: str) -> str:
    return f" {'-' if value < 0.0 else '+'} {abs(value)!r}{rest}"
