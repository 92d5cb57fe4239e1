"""Orders derivations: by what is preferred, by expected error where it is known, by quality."""
from heapq import heappop, heappush
from itertools import zip_longest
from typing import Collection, Iterable, Iterator, List, NamedTuple, Optional, Sequence, Set, Tuple

from shsa_core.codegen.prediction import Predictor
from shsa_core.model.error import Error
from shsa_core.model.ontology import EMPTY, Ontology
from shsa_core.model.service import Source
from shsa_core.model.network import Network
from shsa_core.search.best import Usable
from shsa_core.search.derivation import Derivation, Rated, SourceTable, rate_joint, rate_source
from shsa_core.search.ranking import Ranking
from shsa_core.search.substitutes import SMALLEST_QUALITY, Substitute

MOST = 64
"""The most derivations of a property that are compared."""
MOST_PARTS = 256
"""The most parts that they may have together: healing waits for the answer."""
KNOWN, UNKNOWN, HARMFUL = range(3)
"""A known error comes before one that is not. One above that of the mean comes last."""


Listing = Iterator[Tuple[Rated, bool]]
"""Joint derivations of some properties, best first, and whether each is the best that is left."""


def listing(
    network: Network,
    table: SourceTable,
    properties: Sequence[str],
    usable: Optional[Usable],
    predictor: Optional[Predictor],
    prefer: Collection[str] = (),
) -> Listing:
    """Yield every joint derivation: by expected error, then by quality, or by quality alone.

    Those by the relations to `prefer` come first, save what errs more than the mean.
    """
    numbers = [network.number(name) for name in properties]
    number_of = (predictor or Predictor(EMPTY, ())).number
    given: Set[int] = set()
    if predictor is not None or prefer:
        parts = [compare(network, table, usable, number, predictor, prefer) for number in numbers]
        complete = all(each.complete for each in parts)
        for places in joined([len(each.rated) for each in parts]):
            rated = rate_joint([each.rated[i] for each, i in zip(parts, places)])
            given.add(number_of(rated.derivation))
            yield rated, complete
        if complete:
            return
    for rated in Ranking(network, table, usable).joint(numbers):
        if not given or number_of(rated.derivation) not in given:
            yield rated, not given


class Compared(NamedTuple):
    """Derivations of a property, best first; `complete`: there are no others."""

    rated: Sequence[Rated]
    complete: bool


def compare(
    network: Network,
    table: SourceTable,
    usable: Optional[Usable],
    number: int,
    predictor: Optional[Predictor],
    prefer: Collection[str] = (),
) -> Compared:
    """Compare derivations of a property by what is preferred, and by their errors.

    They are taken by turns from all relations that yield the property: which of them errs least
    must not depend on their qualities.
    """
    ranking = Ranking(network, table, usable)
    ways = [map(rate_source, table.of(number)), *ranking.by_function(number)]
    parts: List[Rated] = []
    used: Set[Derivation] = set()
    complete = True
    for rated in (each for turn in zip_longest(*ways) for each in turn if each is not None):
        if len(parts) == MOST or len(used) > MOST_PARTS:
            complete = False
            break
        parts.append(rated)
        used.update(rated.derivation.unique())
    parts.sort(key=lambda rated: rated.key)
    derivations = [part.derivation for part in parts]
    errors: List[Optional[Error]] = [None] * len(parts)
    order = list(range(len(parts)))
    if predictor is not None:
        errors = predictor.of(derivations)
        order = ordered(derivations, errors, predictor)
    wished = set(prefer)
    order.sort(key=lambda i: wished.isdisjoint(derivations[i].relations()) or _harms(errors[i]))
    return Compared([parts[i] for i in order], complete)


def substitutes(
    ontology: Ontology,
    sources: Iterable[Source],
    target: str,
    predictor: Optional[Predictor] = None,
    prefer: Collection[str] = (),
) -> Iterator[Tuple[Substitute, Optional[Error]]]:
    """Yield every substitute of the property `target`, best first, and its expected error.

    `sources`: what may be used. Relations that cannot be executed count as well. `prefer` as in
    `listing`.
    """
    network = ontology.network
    table = SourceTable(network, sources)
    found = listing(network, table, [target], None, predictor, prefer)
    for place, (rated, best) in enumerate(found):
        (derivation,) = rated.derivation.inputs
        error = None if predictor is None else predictor.of([derivation])[0]
        quality = max(rated.quality, SMALLEST_QUALITY)
        yield Substitute(derivation, quality, proven_best=best and place == 0), error


def ordered(
    derivations: Sequence[Derivation], errors: Sequence[Optional[Error]], predictor: Predictor
) -> List[int]:
    """Return the places of some derivations of a property, best first; they come by quality."""
    return sorted(
        range(len(derivations)), key=lambda i: (_rank(derivations[i], errors[i], predictor), i)
    )


def _rank(
    derivation: Derivation, error: Optional[Error], predictor: Predictor
) -> Tuple[int, float, float]:
    """Return what orders a derivation: the group, the share of the baseline, the error.

    Another service of the property is a measurement of unknown error: it is compared by its
    quality, not put behind every relation that has figures.
    """
    baseline = predictor.baseline(derivation.property)
    if error is None:
        source = derivation.source
        return (UNKNOWN, 0.0, 0.0) if source is None else (KNOWN, 1.0 - source.quality, 0.0)
    if _harms(error):
        return HARMFUL, 0.0, error.rms
    return KNOWN, 1.0 if baseline is None else min(1.0, error.rms / baseline), error.rms


def _harms(error: Optional[Error]) -> bool:
    return error is not None and error.baseline is not None and error.rms >= error.baseline


def joined(counts: Sequence[int]) -> Iterator[Tuple[int, ...]]:
    """Yield every choice of one place from each list, those nearest to their beginnings first."""
    first = (0,) * len(counts)
    heap = [(0, first)] if all(counts) else []
    seen = {first}
    while heap:
        distance, places = heappop(heap)
        yield places
        for i, count in enumerate(counts):
            place = (*places[:i], places[i] + 1, *places[i + 1 :])
            if place[i] < count and place not in seen:
                seen.add(place)
                heappush(heap, (distance + 1, place))
