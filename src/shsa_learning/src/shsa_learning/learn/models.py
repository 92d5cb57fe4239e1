"""The ladder of models, from the mean to support vectors: scikit-learn fits them.

Only coefficients leave it.
"""
import warnings
from dataclasses import replace
from typing import Callable, Dict, List, Mapping, NamedTuple, Sequence, Tuple

import numpy as np
from sklearn.exceptions import ConvergenceWarning
from sklearn.linear_model import Ridge
from sklearn.neural_network import MLPRegressor
from sklearn.preprocessing import PolynomialFeatures
from sklearn.svm import SVR

from shsa_learning.learn.formula import (
    MAGNITUDE,
    PLAIN,
    Factor,
    Formula,
    Kernels,
    Monomial,
    Network,
    Terms,
    products,
)

MEAN, LAW, INPUTS, TERMS = "mean", "law", "inputs", "terms"
LINEAR, PRODUCTS, DIVIDED = "linear", "products", "divided"
POLYNOMIAL, MLP, SVM = "polynomial", "mlp", "svr"
SHORT = (INPUTS, TERMS)
"""Sums of a few inputs as they are, and of a few terms that are made of them."""

OUTLIER = 6.0  # standard deviations of a residual
MOST_OUTLIERS = 0.1  # of all rows: where there are more, the model is wrong and not the rows
SMALLEST_SHARE = 0.003  # of the target's deviation: a term that gives less is left out
CENTRED = 2.0  # standard deviations that an input's mean must be from 0
NETWORK_ROWS, NETWORK_STEPS, NETWORK_DECAY = 3000, 2000, 1e-3
VECTOR_ROWS, MOST_VECTORS = 300, 40
NEVER_NEAR_ZERO = 0.2  # of its largest magnitude: what an input must stay above to divide by it


class Recipe(NamedTuple):
    """A rung of the ladder, and its settings."""

    rung: str
    setting: float = 0.0
    divisor: int = -1
    law: str = ""

    @property
    def complexity(self) -> Tuple[int, float, bool]:
        """Of two that are as good the one with the lower complexity is taken."""
        summed = self.setting if self.rung in SHORT else 0.0
        return LEVELS[self.rung], summed, self.rung == TERMS

    def named(self, inputs: Sequence[str]) -> str:
        """Return it in words, for inputs of such names."""
        return f"divided by {inputs[self.divisor]}" if self.divisor >= 0 else str(self)

    def __str__(self) -> str:
        if self.law:
            return f"{self.rung} {self.law}"
        if self.rung in SHORT:
            return f"{self.setting:g} {self.rung if self.setting > 1.0 else self.rung[:-1]}"
        if self.rung in (PRODUCTS, POLYNOMIAL, MLP):
            return f"{self.rung} {self.setting:g}"
        return self.rung


CHOICES: Mapping[str, Tuple[str, ...]] = {
    "auto": (*SHORT, LINEAR, PRODUCTS, DIVIDED, POLYNOMIAL, MLP, SVM),
    "terms": SHORT,
    "linear": (LINEAR,),
    "polynomial": (PRODUCTS, DIVIDED, POLYNOMIAL),
    "svr": (SVM,),
    "mlp": (MLP,),
}
"""The rungs of each `--model`, the simplest first."""

LEVELS: Mapping[str, int] = {
    MEAN: 0,
    LAW: 1,
    INPUTS: 2,
    TERMS: 2,
    LINEAR: 3,
    PRODUCTS: 4,
    DIVIDED: 4,
    POLYNOMIAL: 5,
    MLP: 6,
    SVM: 7,
}
"""Complexity of a rung: of two that are as good the lower one is taken."""

SETTINGS: Mapping[str, Tuple[float, ...]] = {
    LINEAR: (0.0,),
    PRODUCTS: (1e-2, 1e-4),  # how much large coefficients cost
    DIVIDED: (1e-4,),
    POLYNOMIAL: (2.0, 3.0),  # degree
    MLP: (16.0,),  # neurons
    SVM: (0.0,),
}


def ladder(choice: str, inputs: np.ndarray, terms: int) -> List[Recipe]:
    """Return the recipes to try on these columns for a `--model`, the simplest first.

    `terms`: the most of a short model.
    """
    recipes = []
    for rung in CHOICES[choice]:
        if rung in SHORT:
            most = min(terms, inputs.shape[1]) if rung == INPUTS else terms
            recipes += [Recipe(rung, float(count)) for count in range(1, most + 1)]
            continue
        for setting in SETTINGS[rung]:
            if rung != DIVIDED:
                recipes.append(Recipe(rung, setting))
                continue
            least, most = np.min(np.abs(inputs), axis=0), np.max(np.abs(inputs), axis=0)
            recipes += [
                Recipe(rung, setting, int(number))
                for number in np.flatnonzero((least > NEVER_NEAR_ZERO * most) & (most > 0.0))
                if inputs.shape[1] > 1
            ]
    return recipes


def fit(recipe: Recipe, inputs: np.ndarray, target: np.ndarray, seed: int = 0) -> Formula:
    """Fit a model to rows of `inputs` (rows, inputs) and the `target` (rows).

    Rows that are far off the first fit are left out of a second one.
    """
    method = _METHODS[recipe.rung]
    formula = method(recipe, inputs, target, seed)
    residual = target - formula.predict(inputs)
    off = np.abs(residual - np.median(residual))
    kept = off <= OUTLIER * 1.4826 * np.median(off)
    if kept.all() or kept.mean() < 1.0 - MOST_OUTLIERS:
        return formula
    return method(recipe, inputs[kept], target[kept], seed)


def quick(inputs: np.ndarray, target: np.ndarray) -> Formula:
    """Return a fit that takes no time, to compare delays by: all signed products."""
    centres = _centres(inputs)
    monomials = _pairs(range(inputs.shape[1]), _changing_sign(inputs, centres))
    return _terms(monomials, centres, inputs, target, 1e-4)


def _mean(recipe: Recipe, inputs: np.ndarray, target: np.ndarray, seed: int) -> Formula:
    return Terms(float(np.mean(target)))


def _linear(recipe: Recipe, inputs: np.ndarray, target: np.ndarray, seed: int) -> Formula:
    count = inputs.shape[1]
    monomials = tuple(((number, PLAIN),) for number in range(count))
    return _terms(monomials, (0.0,) * count, inputs, target, 1e-9)


def _products(recipe: Recipe, inputs: np.ndarray, target: np.ndarray, seed: int) -> Formula:
    centres = _centres(inputs)
    monomials = _pairs(range(inputs.shape[1]), _changing_sign(inputs, centres))
    return _pruned(monomials, centres, inputs, target, recipe.setting)


def _divided(recipe: Recipe, inputs: np.ndarray, target: np.ndarray, seed: int) -> Formula:
    """As a power is divided by the voltage: the products of the other inputs, divided by one."""
    centres = _centres(inputs)
    others = [number for number in range(inputs.shape[1]) if number != recipe.divisor]
    monomials = _pairs(others, _changing_sign(inputs, centres))
    multiplied = target * inputs[:, recipe.divisor]
    terms = _pruned(monomials, centres, inputs, multiplied, recipe.setting)
    return replace(terms, divisor=recipe.divisor)


def _polynomial(recipe: Recipe, inputs: np.ndarray, target: np.ndarray, seed: int) -> Formula:
    features = PolynomialFeatures(int(recipe.setting), include_bias=False).fit(inputs[:1])
    monomials = tuple(
        tuple((number, PLAIN) for number, power in enumerate(row) for _ in range(power))
        for row in features.powers_
    )
    return _pruned(monomials, _centres(inputs), inputs, target, 1e-4)


def _network(recipe: Recipe, inputs: np.ndarray, target: np.ndarray, seed: int) -> Formula:
    rows = _spread(len(target), NETWORK_ROWS)
    means, deviations = standard(inputs)
    middle, width = float(np.mean(target)), float(np.std(target)) or 1.0
    network = MLPRegressor(
        (int(recipe.setting),),
        activation="tanh",
        solver="lbfgs",
        alpha=NETWORK_DECAY,
        max_iter=NETWORK_STEPS,
        random_state=seed,
    )
    with warnings.catch_warnings():
        # It stops after a given number of steps: to stop early is a remedy against overfitting.
        warnings.simplefilter("ignore", ConvergenceWarning)
        network.fit(((inputs - means) / deviations)[rows], ((target - middle) / width)[rows])
    (first, last), (offsets, end) = network.coefs_, network.intercepts_
    weights = first.T / deviations
    return Network(
        middle + width * float(end[0]),
        tuple((width * last[:, 0]).tolist()),
        tuple((offsets - weights @ means).tolist()),
        tuple(tuple(row) for row in weights.tolist()),
    )


def _vectors(recipe: Recipe, inputs: np.ndarray, target: np.ndarray, seed: int) -> Formula:
    """Support vectors, so few that they can be written: the tube is widened until they are."""
    rows = _spread(len(target), VECTOR_ROWS)
    means, deviations = standard(inputs)
    middle, width = float(np.mean(target)), float(np.std(target)) or 1.0
    gamma = 0.5 / inputs.shape[1]
    scaled, wanted = ((inputs - means) / deviations)[rows], ((target - middle) / width)[rows]
    tube = 0.05
    while True:
        machine = SVR(kernel="rbf", C=30.0, gamma=gamma, epsilon=tube).fit(scaled, wanted)
        if len(machine.support_) <= MOST_VECTORS:
            break
        tube *= 1.5
    scales = np.sqrt(gamma) / deviations
    return Kernels(
        middle + width * float(machine.intercept_[0]),
        tuple((width * machine.dual_coef_[0]).tolist()),
        tuple(scales.tolist()),
        tuple(
            tuple(row)
            for row in ((machine.support_vectors_ * deviations + means) * scales).tolist()
        ),
    )


_METHODS: Dict[str, Callable[[Recipe, np.ndarray, np.ndarray, int], Formula]] = {
    MEAN: _mean,
    LINEAR: _linear,
    PRODUCTS: _products,
    DIVIDED: _divided,
    POLYNOMIAL: _polynomial,
    MLP: _network,
    SVM: _vectors,
}


def _pairs(numbers: Sequence[int], signed: Sequence[bool]) -> Tuple[Monomial, ...]:
    """Return each input, its magnitude, and the products of two of these."""
    plain: List[Factor] = [(number, PLAIN) for number in numbers]
    monomials: List[Monomial] = [(factor,) for factor in plain]
    for place, factor in enumerate(plain):
        monomials += [(factor, other) for other in plain[place:]]
    sizes: List[Factor] = [(number, MAGNITUDE) for number in numbers if signed[number]]
    for place, size in enumerate(sizes):
        monomials += [(size,), ((size[0], PLAIN), size)]
        monomials += [(size, other) for other in sizes[place + 1 :]]
    return tuple(monomials)


def _changing_sign(inputs: np.ndarray, centres: Sequence[float]) -> List[bool]:
    shifted = inputs - np.array(centres)
    return [
        centre == 0.0 and bool(low < 0.0 < high)
        for centre, low, high in zip(centres, shifted.min(axis=0), shifted.max(axis=0))
    ]


def _centres(inputs: np.ndarray) -> Tuple[float, ...]:
    """Return what to subtract from each input before products: 0 if it is around 0 anyway."""
    means, deviations = standard(inputs)
    return tuple(
        float(f"{mean:.4g}") if abs(mean) > CENTRED * deviation else 0.0
        for mean, deviation in zip(means, deviations)
    )


def _pruned(
    monomials: Tuple[Monomial, ...],
    centres: Tuple[float, ...],
    inputs: np.ndarray,
    target: np.ndarray,
    cost: float,
) -> Terms:
    """Return the fit without the terms that give next to nothing."""
    terms = _terms(monomials, centres, inputs, target, cost)
    share = np.abs(terms.coefficients) * np.std(products(inputs, monomials, centres), axis=0)
    kept = share >= SMALLEST_SHARE * np.std(target)
    if kept.all() or not kept.any():
        return terms
    left = tuple(monomial for monomial, keep in zip(monomials, kept) if keep)
    return _terms(left, centres, inputs, target, cost)


def _terms(
    monomials: Tuple[Monomial, ...],
    centres: Tuple[float, ...],
    inputs: np.ndarray,
    target: np.ndarray,
    cost: float,
) -> Terms:
    """Ridge regression on standardised products; the standardisation is folded in again."""
    columns = products(inputs, monomials, centres)
    means, deviations = standard(columns)
    ridge = Ridge(alpha=cost * len(target)).fit((columns - means) / deviations, target)
    coefficients = ridge.coef_ / deviations
    intercept = float(ridge.intercept_ - coefficients @ means)
    return Terms(intercept, tuple(coefficients.tolist()), monomials, centres)


def standard(columns: np.ndarray) -> Tuple[np.ndarray, np.ndarray]:
    """Return mean and standard deviation of each column; 1 for a constant one."""
    deviations = np.std(columns, axis=0)
    return np.mean(columns, axis=0), np.where(deviations > 0.0, deviations, 1.0)


def _spread(rows: int, most: int) -> np.ndarray:
    """At most so many rows, evenly spread."""
    return np.unique(np.linspace(0, rows - 1, min(rows, most)).astype(int))
