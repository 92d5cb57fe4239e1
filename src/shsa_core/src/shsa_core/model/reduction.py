"""One number of many: what is computed of an array, or of a slice of one.

REP 117 has what a distance means that is not finite: +inf, nothing is in reach; -inf, something is
too close to be measured; NaN, the reading is of no use.
"""
from math import fsum, isfinite, nan
from typing import Callable, Dict, Sequence


def _minimum(values: Sequence[float]) -> float:
    """-inf if any is: a smallest distance must not leave out what is too close."""
    return float(min((value for value in values if value == value), default=nan))


def _maximum(values: Sequence[float]) -> float:
    """The largest finite value."""
    finite = _finite(values)
    return float(max(finite)) if finite else _minimum(values)


def _mean(values: Sequence[float]) -> float:
    finite = _finite(values)
    return fsum(finite) / len(finite) if finite else _minimum(values)


def _count(values: Sequence[float]) -> float:
    return float(len(_finite(values)))


def _finite(values: Sequence[float]) -> Sequence[float]:
    return [value for value in values if isfinite(value)]


REDUCE: Dict[str, Callable[[Sequence[float]], float]] = {
    "min": _minimum,
    "max": _maximum,
    "mean": _mean,
    "count": _count,
}
"""Each reduction by its name in the grammar of fields."""
