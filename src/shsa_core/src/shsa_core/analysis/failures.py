"""The best derivations after failures, from those before: only what used something that is gone is rated again."""
from typing import Dict, Iterable, List, Optional

from shsa_core.model.network import Network
from shsa_core.model.service import Source
from shsa_core.search.best import BestDerivations, Usable
from shsa_core.search.derivation import LOST, SourceTable
from shsa_core.search.ratings import Ratings, dependents


class Failures:
    """The best derivation of every property of a network, and what becomes of it when nodes fail."""

    def __init__(
        self, network: Network, sources: Iterable[Source], usable: Optional[Usable] = None
    ) -> None:
        self._network = network
        self._table = SourceTable(network)
        self._measures: Dict[str, List[int]] = {}  # the properties that a node measures
        for source in sources:
            self._table.add(source)
            number = network.number(source.property)
            self._measures.setdefault(source.node, []).append(number)
        self._best = BestDerivations(network, self._table, usable, prune=False)
        numbers = range(len(network.names))
        for number in numbers:
            self._best.settle(number)
        self._users = self._best.ratings.users(numbers)

    def ratings(self, failed: Iterable[str], blocked: Optional[int] = None) -> Ratings:
        """The best derivations that use none of the nodes `failed`, nor the property `blocked`."""
        nodes = tuple(failed)
        gone = [number for node in nodes for number in self._measures.get(node, ())]
        if blocked is not None:
            gone.append(blocked)
        affected = dependents(self._users, gone)
        ratings = Ratings(self._network, self._table.excluding(nodes), self._best.ratings)
        if blocked is not None:
            affected.remove(blocked)
            ratings[blocked] = LOST
        self._best.settle_cycle(affected, ratings)
        return ratings

    def missing(self, target: int, ratings: Ratings) -> List[str]:
        """What a lost property lacks; as BestDerivations.missing, after a failure."""
        return self._best.missing(target, ratings)
