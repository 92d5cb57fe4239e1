"""All substitutes of a property, best first, or the best one alone."""
from dataclasses import dataclass
from typing import Collection, Iterable, Iterator, Optional, Tuple

from shsa_core.codegen.choice import listing
from shsa_core.codegen.plans import SMALLEST_QUALITY
from shsa_core.codegen.prediction import Predictor
from shsa_core.errors import NoSubstitute
from shsa_core.model.error import Error
from shsa_core.model.ontology import Ontology
from shsa_core.model.service import Source
from shsa_core.search.best import BestDerivations
from shsa_core.search.derivation import Derivation, SourceTable
from shsa_core.search.depth_first import nearest


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
    for usable, whole in nearest(table, [number], None, steps):
        best = BestDerivations(table, usable)
        if best.settle(number):
            quality = max(best.ratings[number][4], SMALLEST_QUALITY)
            return Substitute(best.ratings.derivation(number), quality, whole)
    raise NoSubstitute([target], best.missing(number))


def substitutes(
    ontology: Ontology,
    sources: Iterable[Source],
    target: str,
    predictor: Optional[Predictor] = None,
    prefer: Collection[str] = (),
    limit: Optional[float] = None,
) -> Iterator[Tuple[Substitute, Optional[Error]]]:
    """Yield every substitute of the property `target`, best first, and its expected error.

    `sources`: what may be used. Relations that cannot be executed count as well, and last of all
    what is not used by its error. `prefer` and the `limit` of the error as in `listing`.
    """
    table = SourceTable(ontology.network, sources)
    found = listing(table, [target], None, predictor, prefer, [limit], refused=True)
    for place, (rated, best) in enumerate(found):
        (derivation,) = rated.derivation.inputs
        error = None if predictor is None else predictor.of([derivation])[0]
        quality = max(rated.quality, SMALLEST_QUALITY)
        yield Substitute(derivation, quality, proven_best=best and place == 0), error
