"""The search of the paper: depth first, the first substitute found (`depth_first`, or `orr`)."""
from typing import Iterator, List, Optional, Set

from shsa_core.search.best import Usable
from shsa_core.search.derivation import LOST, UNRATED, Rated, SourceTable
from shsa_core.search.ratings import Ratings


class Branch:
    """A property on the path of the search, the function tried for it, and those left to try."""

    def __init__(self, number: int, functions: Iterator[int]) -> None:
        self.number = number
        self.functions = functions
        self.function = next(functions, None)


def first_found(
    sources: SourceTable, target: int, usable: Optional[Usable] = None
) -> Optional[Rated]:
    """Return a derivation of `target`: its source, else its first function that can be derived.

    Within a round, a property that failed is not tried again, though it may have failed only
    because of what was on the path then. So there are more rounds, each with what was found before,
    until one finds nothing new.
    """
    found = Ratings(sources)
    while found[target] == UNRATED:
        if not _round(sources, usable, target, found):
            return None
    return found.rated(target)


def _round(sources: SourceTable, usable: Optional[Usable], target: int, found: Ratings) -> bool:
    """Search once; return True if anything new was found."""
    network = sources.network
    new = False
    tried: Set[int] = set()
    path: List[Branch] = []
    next_: Optional[int] = target
    while path or next_ is not None:
        if next_ is not None:
            tried.add(next_)
            if sources.rating(next_) != LOST:
                found[next_] = sources.rating(next_)
                new = True
            else:
                functions = iter(network.functions_of[next_])
                if usable is not None:
                    functions = filter(usable, functions)
                path.append(Branch(next_, functions))
            next_ = None
            continue
        branch = path[-1]
        if branch.function is None:
            path.pop()
            continue
        inputs = network.inputs[branch.function]
        next_ = next((i for i in inputs if found[i] == UNRATED), None)
        if next_ is None:
            found[branch.number] = found.by_function(branch.function)
            new = True
            path.pop()
        elif next_ in tried:
            branch.function = next(branch.functions, None)
            next_ = None
    return new
