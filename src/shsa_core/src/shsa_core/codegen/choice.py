"""Orders derivations: by what is preferred, by expected error where it is known, by quality."""
from heapq import heappop, heappush
from itertools import zip_longest
from typing import Collection, Iterator, List, Mapping, Optional, Sequence, Set, Tuple

from shsa_core.codegen.generator import fused
from shsa_core.codegen.prediction import Predictor
from shsa_core.model.error import Error, refusal
from shsa_core.model.kinds import Method
from shsa_core.model.ontology import EMPTY
from shsa_core.search.best import BestDerivations, Usable
from shsa_core.search.depth_first import first_found
from shsa_core.search.derivation import Derivation, Rated, SourceTable, rate_joint, rate_source
from shsa_core.search.ranking import Ranking

MOST = 64
"""The most derivations of a property that are compared."""
MOST_PARTS = 256
"""The most parts that they may have together: healing waits for the answer."""
MARGIN = 0.1
"""By this share an error that was measured must be smaller than another one to come before it."""


def listing(
    table: SourceTable,
    properties: Sequence[str],
    usable: Optional[Usable],
    predictor: Optional[Predictor],
    prefer: Collection[str] = (),
    limits: Sequence[Optional[float]] = (),
    refused: bool = False,
    method: Optional[str] = None,
) -> Iterator[Tuple[Rated, bool]]:
    """Yield every joint derivation, best first, and whether it is the best that is left.

    Best by its errors, then by quality, or by quality alone; those by the relations to `prefer`
    come first. `limits` of the errors follow the properties. What is not used by its error comes
    last if it is `refused`, or where there is nothing else. By quality alone the first one is that
    of a `method`, and may come again.
    """
    numbers = [table.network.number(name) for name in properties]
    known = predictor if method in (None, Method.BEST) else None
    number_of = (known or Predictor(EMPTY, ())).number
    given: Set[int] = set()
    if known is not None or prefer:
        pairs = zip_longest(numbers, limits)
        compared = [
            compare(table, usable, number, known, prefer, limit=limit, refused=refused)
            for number, limit in pairs
        ]
        complete = all(whole for _, whole in compared)
        parts = [rated for rated, _ in compared]
        for places in joined([len(each) for each in parts]):
            rated = rate_joint([each[i] for each, i in zip(parts, places)])
            given.add(number_of(rated.derivation))
            yield rated, complete
        if complete:
            return
    elif method is not None:
        firsts: List[Optional[Rated]] = []
        if method == Method.BEST:  # much faster than to rank all
            best = BestDerivations(table, usable)
            firsts += [best.ratings.rated(each) for each in numbers if best.settle(each)]
        else:
            firsts += [first_found(table, each, usable) for each in numbers]
        found = [rated for rated in firsts if rated is not None]
        if len(found) < len(numbers):
            return
        yield rate_joint(found), method == Method.BEST
    for rated in Ranking(table, usable).joint(numbers):
        if not given or number_of(rated.derivation) not in given:
            yield rated, not given


def compare(
    table: SourceTable,
    usable: Optional[Usable],
    number: int,
    predictor: Optional[Predictor],
    prefer: Collection[str] = (),
    *,
    limit: Optional[float] = None,
    refused: bool = True,
) -> Tuple[List[Rated], bool]:
    """Return derivations of a property, best first, and whether there are no others.

    They are taken by turns from all relations that yield it: their qualities must not matter. A
    fusion comes before all that it is of. What is not used by its error comes last if it is
    `refused`, or where there is nothing else.
    """
    ranking = Ranking(table, usable)
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
        order = ordered(derivations, predictor)
        for each in fused(predictor.fusions, parts):
            before = min(order.index(derivations.index(part)) for part in each.derivation.inputs)
            order.insert(before, len(parts))
            parts.append(each)
            errors += predictor.of([each.derivation])
    wished, wrong = set(prefer), [bool(refusal(error, limit)) for error in errors]
    order.sort(key=lambda i: (wrong[i], wished.isdisjoint(parts[i].derivation.relations())))
    most = len(order) if refused else max(wrong.count(False), 1)
    return [parts[i] for i in order[:most]], complete


def ordered(derivations: Sequence[Derivation], predictor: Predictor) -> List[int]:
    """Return the places of some derivations of a property, best first; they come by quality.

    Expected errors order them. Those whose error was measured then change places among themselves.
    """
    expected = zip(derivations, predictor.expected(derivations))
    ranks = [_rank(each, error, predictor) for each, error in expected]
    order = sorted(range(len(ranks)), key=lambda i: (ranks[i], i))
    found = ((i, predictor.measured(derivations[i])) for i in order)
    measured = {i: error.rms for i, error in found if error is not None}
    by_measure = iter(_clearly_sorted(measured))
    return [next(by_measure) if i in measured else i for i in order]


def _clearly_sorted(errors: Mapping[int, float]) -> List[int]:
    """Return the keys of some errors, the smallest first; they stay where that is not clear."""
    found: List[int] = []
    for i, error in errors.items():
        place = len(found)
        while place and error < (1.0 - MARGIN) * errors[found[place - 1]]:
            place -= 1
        found.insert(place, i)
    return found


def _rank(
    derivation: Derivation, error: Optional[Error], predictor: Predictor
) -> Tuple[bool, float, float]:
    """Return what orders it: known errors first; another service of none goes by its quality."""
    baseline = predictor.baselines.get(derivation.property)
    if error is None:
        source = derivation.source
        return source is None, 0.0 if source is None else 1.0 - source.quality, 0.0
    return False, 1.0 if baseline is None else min(1.0, error.rms / baseline), error.rms


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
