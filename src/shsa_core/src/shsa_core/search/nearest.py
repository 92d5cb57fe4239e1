"""Bounds a search: what is found first, and the functions nearest to the target, make do.

So the search answers by its deadline, with the best of what could be looked at (Section II-E of the
paper). The deadline is a number of functions: it needs no clock, and can be played again.
"""
from typing import Iterator, Optional, Sequence, Set, Tuple

from shsa_core.search.best import Usable
from shsa_core.search.depth_first import first_found
from shsa_core.search.derivation import SourceTable

Part = Tuple[Optional[Usable], bool]
"""The functions that are looked at, and whether no other could be of use."""


def nearest(
    table: SourceTable, targets: Sequence[int], usable: Optional[Usable], steps: Optional[int]
) -> Iterator[Part]:
    """Yield the first derivation of some properties with the `steps` functions next to them.

    Then all functions; at once if `steps` is None, or there is no derivation.
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
