"""The search for the best substitute of a property."""
from dataclasses import dataclass
from typing import Iterable, Optional

from shsa_core.errors import NoSubstitute
from shsa_core.model.ontology import Ontology
from shsa_core.model.service import Source
from shsa_core.search.best import BestDerivations
from shsa_core.search.derivation import Derivation, SourceTable
from shsa_core.search.nearest import nearest

SMALLEST_QUALITY = 5e-324
"""A product of many qualities may be too small for a float, but it is not 0."""


@dataclass(frozen=True)
class Substitute:
    """The result of a search: derivation, quality in (0, 1], and whether it is proven best."""

    derivation: Derivation
    quality: float
    proven_best: bool


def find_substitute(
    ontology: Ontology,
    sources: Iterable[Source],
    target: str,
    excluded: Iterable[str] = (),
    steps: Optional[int] = None,
) -> Substitute:
    """Return the best substitute of a property, without the nodes, topics and services `excluded`.

    Best is the highest quality, then the fewest relations, then the cheapest inputs, then names in
    order. The time is linear in the relations that the target can be reached from, save n log n
    within a cycle of n properties. With `steps`, it looks at what it finds first and at so many
    relations nearest to the target. Raises NoSubstitute with what is missing.
    """
    network = ontology.network
    number = network.number(target)
    without = frozenset(excluded)
    left = [source for source in sources if without.isdisjoint(source.names)]
    table = SourceTable(network, left)
    for usable, whole in nearest(network, table, [number], None, steps):
        best = BestDerivations(network, table, usable)
        if best.settle(number):
            quality = max(best.ratings[number][4], SMALLEST_QUALITY)
            return Substitute(best.ratings.derivation(number), quality, whole)
    raise NoSubstitute([target], best.missing(number))
