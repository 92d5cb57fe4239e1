"""The search of the paper: depth first, the first substitute found (`depth_first`, or `orr`)."""
from itertools import chain
from typing import Collection, Iterator, List, Optional, Set

from shsa_core.model.network import Network
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
    network: Network,
    sources: SourceTable,
    target: int,
    usable: Optional[Usable] = None,
    prefer: Collection[str] = (),
) -> Optional[Rated]:
    """Return a derivation of `target`: its source, else its first function that can be derived.

    A function of a relation to `prefer` comes before the source. Within a round, a property that
    failed is not tried again, though it may have failed only because of what was on the path then.
    So there are more rounds, each with what was found before, until one finds nothing new.
    """
    found = Ratings(network, sources)
    while found[target] == UNRATED:
        if not _round(network, sources, usable, target, found, prefer):
            return None
    return found.rated(target)


def _round(
    network: Network,
    sources: SourceTable,
    usable: Optional[Usable],
    target: int,
    found: Ratings,
    prefer: Collection[str],
) -> bool:
    """Search once; return True if anything new was found."""
    new = False
    tried: Set[int] = set()
    path: List[Branch] = []
    next_: Optional[int] = target
    while path or next_ is not None:
        if next_ is not None:
            tried.add(next_)
            functions = [f for f in network.functions_of[next_] if usable is None or usable(f)]
            wished = [f for f in functions if network.functions[f].relation in prefer]
            measured = sources.rating(next_) != LOST
            others = [f for f in functions if f not in wished and not measured]
            if wished or not measured:
                path.append(Branch(next_, chain(wished, others)))
            else:
                found[next_] = sources.rating(next_)
                new = True
            next_ = None
            continue
        branch = path[-1]
        if branch.function is None:
            path.pop()
            if sources.rating(branch.number) != LOST:  # what was preferred cannot be derived
                found[branch.number] = sources.rating(branch.number)
                new = True
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
