"""The search of the paper: depth first, the first substitute found (`depth_first`, or `orr`).

It bounds the best search as well, which answers by its deadline with the best of what could be
looked at (Section II-E of the paper). The deadline is a number of functions: it needs no clock, and
can be played again.
"""
from typing import Dict, Iterator, List, Optional, Sequence, Set, Tuple

from shsa_core.search.best import Ratings, Usable
from shsa_core.search.derivation import LOST, UNRATED, Rated, SourceTable


def first_found(
    sources: SourceTable, target: int, usable: Optional[Usable] = None
) -> Optional[Rated]:
    """Return a derivation of `target`: its source, else its first function that can be derived.

    A property that failed because of what was on the path then is tried again in another round,
    until one finds nothing new.
    """
    found = Ratings(sources)
    while found[target] == UNRATED:
        if not _round(sources, usable, target, found):
            return None
    return found.rated(target)


def _round(sources: SourceTable, usable: Optional[Usable], target: int, found: Ratings) -> bool:
    """Search once; return True if anything new was found."""
    network, new = sources.network, False
    left: Dict[int, List[int]] = {}  # the functions of each property to be tried, the next one last
    path = [target]
    while path:
        number = path[-1]
        if number not in left:
            functions = network.functions_of[number]
            left[number] = [f for f in reversed(functions) if usable is None or usable(f)]
            if sources.rating(number) != LOST:
                found[path.pop()] = sources.rating(number)
                new = True
        elif not left[number]:
            path.pop()
        else:
            function = left[number][-1]
            lacking = next((i for i in network.inputs[function] if found[i] == UNRATED), None)
            if lacking is None:
                found[path.pop()] = found.by_function(function)
                new = True
            elif lacking in left:
                left[number].pop()
            else:
                path.append(lacking)
    return new


def nearest(
    table: SourceTable, targets: Sequence[int], usable: Optional[Usable], steps: Optional[int]
) -> Iterator[Tuple[Optional[Usable], bool]]:
    """Yield the first derivation of some properties with the `steps` functions next to them.

    Then all functions; at once if `steps` is None, or there is no derivation. And whether no other
    function could be of use.
    """
    network = table.network
    if steps is not None:
        functions: Set[int] = set()
        properties, queue = set(targets), list(targets)
        for number in queue:  # it grows
            if len(functions) >= steps:
                break
            for function in network.functions_of[number]:
                if usable is not None and not usable(function):
                    continue
                functions.add(function)
                new = [each for each in network.inputs[function] if each not in properties]
                properties.update(new)
                queue.extend(new)
        else:
            yield usable, True
            return
        found = [first_found(table, target, usable) for target in targets]
        for part in (part for rated in found if rated for part in rated.derivation.unique()):
            for function in network.functions_of[network.number(part.property)]:
                if network.functions[function] is part.function:
                    functions.add(function)
        if None not in found:
            yield functions.__contains__, False
    yield usable, True
