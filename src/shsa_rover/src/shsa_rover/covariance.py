"""Covariance matrices of what the rover's sensors tell."""
from typing import List, Mapping

NOT_MEASURED = 1e6
"""The variance of an axis that nobody measures: 0 would claim that it is certain."""


def diagonal(size: int, variances: Mapping[int, float]) -> List[float]:
    """Return a matrix of `size` rows with these variances; other rows are not measured."""
    matrix = [0.0] * (size * size)
    for row in range(size):
        matrix[row * size + row] = variances.get(row, NOT_MEASURED)
    return matrix
