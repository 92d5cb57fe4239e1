"""Fitted models as coefficients alone, and what they compute.

Each formula is computed in the same order as its text in the ontology's language.
"""
from dataclasses import dataclass
from typing import Protocol, Tuple

import numpy as np

PLAIN, MAGNITUDE = 0, 1
Factor = Tuple[int, int]
"""An input by number, and whether it is taken as it is (PLAIN) or its MAGNITUDE."""
Monomial = Tuple[Factor, ...]


class Formula(Protocol):
    """A fitted model."""

    @property
    def used(self) -> Tuple[int, ...]:
        """The inputs that it reads, by number, in order."""

    def predict(self, inputs: np.ndarray) -> np.ndarray:
        """Predict the target of each row of `inputs` (rows, inputs)."""


@dataclass(frozen=True)
class Terms:
    """intercept + the sum of coefficients times products of inputs, divided by input `divisor`.

    An input stands in the products less its centre.
    """

    intercept: float
    coefficients: Tuple[float, ...] = ()
    monomials: Tuple[Monomial, ...] = ()
    centres: Tuple[float, ...] = ()
    divisor: int = -1

    @property
    def used(self) -> Tuple[int, ...]:
        """The inputs that it reads, by number, in order."""
        numbers = {number for monomial in self.monomials for number, _ in monomial}
        return tuple(sorted(numbers | ({self.divisor} if self.divisor >= 0 else set())))

    def predict(self, inputs: np.ndarray) -> np.ndarray:
        """Predict the target of each row of `inputs` (rows, inputs)."""
        total = np.full(len(inputs), self.intercept)
        columns = products(inputs, self.monomials, self.centres)
        for coefficient, column in zip(self.coefficients, columns.T):
            total = total + coefficient * column
        return total / inputs[:, self.divisor] if self.divisor >= 0 else total


@dataclass(frozen=True)
class Network:
    """One layer of tanh neurons: intercept + sum of `outer` * tanh(offset + weights . inputs).

    `weights` has one row a neuron.
    """

    intercept: float
    outer: Tuple[float, ...]
    offsets: Tuple[float, ...]
    weights: Tuple[Tuple[float, ...], ...]

    @property
    def used(self) -> Tuple[int, ...]:
        """The inputs that it reads, by number, in order."""
        return tuple(range(len(self.weights[0])))

    def predict(self, inputs: np.ndarray) -> np.ndarray:
        """Predict the target of each row of `inputs` (rows, inputs)."""
        hidden = np.tanh(inputs @ np.array(self.weights).T + np.array(self.offsets))
        return self.intercept + hidden @ np.array(self.outer)


@dataclass(frozen=True)
class Kernels:
    """Support vectors: intercept + sum of `weights` * exp(-|z - centre|^2).

    z: each input times its scale; `centres` has one row a vector, scaled likewise.
    """

    intercept: float
    weights: Tuple[float, ...]
    scales: Tuple[float, ...]
    centres: Tuple[Tuple[float, ...], ...]

    @property
    def used(self) -> Tuple[int, ...]:
        """The inputs that it reads, by number, in order."""
        return tuple(range(len(self.scales)))

    def predict(self, inputs: np.ndarray) -> np.ndarray:
        """Predict the target of each row of `inputs` (rows, inputs)."""
        scaled = inputs * np.array(self.scales)
        total = np.full(len(inputs), self.intercept)
        for weight, centre in zip(self.weights, self.centres):
            total += weight * np.exp(-np.sum((scaled - np.array(centre)) ** 2, axis=1))
        return total


def products(
    inputs: np.ndarray, monomials: Tuple[Monomial, ...], centres: Tuple[float, ...]
) -> np.ndarray:
    """One column a monomial."""
    columns = np.ones((len(inputs), len(monomials)))
    for column, monomial in enumerate(monomials):
        for number, kind in monomial:
            factor = inputs[:, number] - centres[number]
            columns[:, column] *= np.abs(factor) if kind == MAGNITUDE else factor
    return columns
