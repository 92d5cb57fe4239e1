"""Which derivation of a property is best where errors are known: the one of the smallest.

Quality alone says little of errors. So derivations of known error are compared by it; those of none
keep the order of their qualities, behind them.
"""
from dataclasses import replace
from heapq import heappop, heappush
from itertools import zip_longest
from typing import Iterable, Iterator, List, NamedTuple, Optional, Sequence, Set, Tuple

from shsa_core.codegen.prediction import Predictor
from shsa_core.model.error import Error
from shsa_core.model.ontology import Ontology
from shsa_core.model.service import Source
from shsa_core.model.network import Network
from shsa_core.search.best import Usable
from shsa_core.search.derivation import Derivation, Rated, SourceTable, rate_source
from shsa_core.search.ranking import Ranking
from shsa_core.search.substitutes import SMALLEST_QUALITY, Substitute, iter_substitutes

MOST = 64
"""So many derivations of a property are compared."""
MOST_PARTS = 256
"""Fewer if they are made of more parts than that: healing waits for the answer."""
KNOWN, UNKNOWN, HARMFUL = range(3)
"""A known error comes before one that is not. One above that of the mean comes last."""


class Choice(NamedTuple):
    """Derivations of a property, best first; `complete`: there are no others."""

    rated: Sequence[Rated]
    complete: bool


def choose(
    network: Network, table: SourceTable, usable: Usable, number: int, predictor: Predictor
) -> Choice:
    """The derivations of a property by its number in the network, best first.

    Those that are compared come by turns from all relations that yield the property: which of them
    errs least is not to hang on their qualities.
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
    order = ordered(derivations, predictor.of(derivations), predictor)
    return Choice([parts[i] for i in order], complete)


def substitutes(
    ontology: Ontology,
    sources: Iterable[Source],
    target: str,
    predictor: Optional[Predictor],
) -> Iterator[Tuple[Substitute, Optional[Error]]]:
    """Every substitute of the property `target`, best first, and its expected error.

    `sources`: what may be used. Relations that cannot be executed count as well.
    """
    rest = iter_substitutes(ontology, sources, target)
    if predictor is None:
        yield from ((each, None) for each in rest)
        return
    network = ontology.network
    table = SourceTable(network, sources)
    choice = choose(network, table, lambda function: True, network.number(target), predictor)
    first = choice.complete
    given = set()
    for rated, error in zip(choice.rated, predictor.of([r.derivation for r in choice.rated])):
        quality = max(rated.quality, SMALLEST_QUALITY)
        yield Substitute(rated.derivation, quality, proven_best=first), error
        first = False
        given.add(predictor.number(rated.derivation))
    for each in rest:
        if predictor.number(each.derivation) not in given:
            yield replace(each, proven_best=False), predictor.of([each.derivation])[0]


def ordered(
    derivations: Sequence[Derivation], errors: Sequence[Optional[Error]], predictor: Predictor
) -> List[int]:
    """The places of some derivations of a property, best first; they come by their quality."""
    return sorted(
        range(len(derivations)), key=lambda i: (_rank(derivations[i], errors[i], predictor), i)
    )


def _rank(
    derivation: Derivation, error: Optional[Error], predictor: Predictor
) -> Tuple[int, float, float]:
    """The smaller the better: the group, the share of the baseline, the error.

    Another service of the property is a measurement, though nobody has said how good: it is not
    put behind every relation that has figures, but compared by its quality.
    """
    baseline = predictor.baseline(derivation.property)
    if error is None:
        source = derivation.source
        return (UNKNOWN, 0.0, 0.0) if source is None else (KNOWN, 1.0 - source.quality, 0.0)
    if error.baseline is not None and error.rms >= error.baseline:
        return HARMFUL, 0.0, error.rms
    return KNOWN, 1.0 if baseline is None else min(1.0, error.rms / baseline), error.rms


def joined(counts: Sequence[int]) -> Iterator[Tuple[int, ...]]:
    """Every choice of one place from each of some lists, those nearest to their beginnings first.

    None if one of the lists is empty.
    """
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
