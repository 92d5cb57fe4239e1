"""The result of a search."""
from dataclasses import dataclass

from shsa_core.search.derivation import Derivation

SMALLEST_QUALITY = 5e-324
"""A product of many qualities may be too small for a float, but it is not 0."""


@dataclass(frozen=True)
class Substitute:
    """The result of a search: derivation, quality in (0, 1], and whether it is proven best."""

    derivation: Derivation
    quality: float
    proven_best: bool
