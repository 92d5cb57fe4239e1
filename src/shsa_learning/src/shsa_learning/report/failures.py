"""Rates what is left of a robot after failures, one after the other."""
from typing import Collection, Dict, Iterable, List, Optional

from shsa_core.model.ontology import Network
from shsa_core.model.service import Source
from shsa_core.search.best import BestDerivations, Ratings, dependents
from shsa_core.search.derivation import LOST, SourceTable


class Failures:
    """The best derivations of all properties, and what failures leave of them.

    A failure rates again only what used something that is gone.
    """

    def __init__(self, network: Network, sources: Collection[Source]) -> None:
        self._table = SourceTable(network, sources)
        self._provides: Dict[str, List[int]] = {}  # the properties that go with a name
        for source in sources:
            for name in source.names:
                self._provides.setdefault(name, []).append(network.number(source.property))
        self._best = BestDerivations(self._table, network.executable, prune=False)
        numbers = range(len(network.names))
        for number in numbers:
            self._best.settle(number)
        self._users = self._best.ratings.users(numbers)

    def after(self, failed: Iterable[str], blocked: Optional[int] = None) -> Ratings:
        """Rate what is left once some causes have failed, and a `blocked` property with them."""
        names = tuple(failed)
        gone = {number for name in names for number in self._provides.get(name, ())}
        ratings = Ratings(self._table.excluding(names), self._best.ratings)
        affected = dependents(self._users, gone if blocked is None else gone | {blocked})
        if blocked is not None:
            affected.remove(blocked)
            ratings[blocked] = LOST
        self._best.settle_cycle(affected, ratings)
        return ratings
