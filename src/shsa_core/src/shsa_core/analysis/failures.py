"""The best derivations after failures, from those before.

Only what used something that is gone is rated again.
"""
from typing import Dict, FrozenSet, Iterable, List, NamedTuple, Optional, Sequence

from shsa_core.model.network import Network
from shsa_core.model.service import Service, Source
from shsa_core.search.best import BestDerivations, Usable
from shsa_core.search.derivation import LOST, SourceTable
from shsa_core.search.missing import lacking
from shsa_core.search.ratings import Ratings, dependents


class Failure(NamedTuple):
    """What a failure leaves: the best derivations, and the numbers of lost properties."""

    ratings: Ratings
    lost: FrozenSet[int]


class Failures:
    """The best derivation of every property, and what becomes of it when nodes fail."""

    def __init__(
        self, network: Network, sources: Iterable[Source], usable: Optional[Usable] = None
    ) -> None:
        self._network = network
        self._table = SourceTable(network)
        self._measures: Dict[str, List[int]] = {}  # the properties that go with a name
        for source in sources:
            self._table.add(source)
            number = network.number(source.property)
            for name in source.names:
                self._measures.setdefault(name, []).append(number)
        self._best = BestDerivations(network, self._table, usable, prune=False)
        numbers = range(len(network.names))
        for number in numbers:
            self._best.settle(number)
        self._users = self._best.ratings.users(numbers)
        self._lost = frozenset(n for n in numbers if self._best.ratings[n] == LOST)
        # The lost inputs of each function of a lost property.
        self._lacks: Dict[int, Sequence[Sequence[int]]] = {}
        self._uses: Optional[Dict[int, List[int]]] = None  # see _users_of

    def after(self, failed: Iterable[str], blocked: Optional[int] = None) -> Failure:
        """What is left once some nodes or common causes have failed.

        `blocked`: and without this property.
        """
        names = tuple(failed)
        gone = [number for name in names for number in self._measures.get(name, ())]
        if blocked is not None:
            gone.append(blocked)
        affected = dependents(self._users, gone)
        ratings = Ratings(self._network, self._table.excluding(names), self._best.ratings)
        if blocked is not None:
            affected.remove(blocked)
            ratings[blocked] = LOST
        self._best.settle_cycle(affected, ratings)
        lost = {number for number in affected if ratings[number] == LOST}
        return Failure(ratings, frozenset(lost if blocked is None else lost | {blocked}))

    def of(self, service: Service, numbers: Sequence[int]) -> Failure:
        """What is left for some values of a service that has failed, as `plan_service` chooses.

        That is, without what shares a cause with it, unless these values need that.
        """
        own = service.node, service.name
        for causes in service.avoided:
            apart = self.after([*own, *causes])
            if all(apart.ratings[number] != LOST for number in numbers):
                return apart
        return self.after(own)

    def missing(self, target: int, failure: Failure) -> List[str]:
        """What a lost property lacks after a failure; as BestDerivations.missing.

        What is lost without any failure is looked up once; it is the same for all targets, save
        what uses the target or what the failure loses.
        """
        lost = failure.lost
        others = {user for number in (target, *lost) for user in self._users_of(number)} | lost
        lacks, of = self._lacks, self._lost

        def lost_inputs(number: int) -> Sequence[Sequence[int]]:
            if number in others or number == target:
                return self._lost_inputs(number, target, lost)
            if number not in lacks:
                lacks[number] = self._lost_inputs(number, -1, of)
            return lacks[number]

        return sorted(self._network.names[number] for number in lacking(target, lost_inputs))

    def _lost_inputs(
        self, number: int, target: int, lost: FrozenSet[int]
    ) -> Sequence[Sequence[int]]:
        """The lost inputs of each function that does not use the target."""
        inputs_of, before = self._network.inputs, self._lost
        of = [inputs_of[function] for function in self._best.functions(number)]
        return tuple(
            tuple(i for i in inputs if i in before or i in lost)
            for inputs in of
            if target not in inputs
        )

    def _users_of(self, number: int) -> Sequence[int]:
        """The properties that a function yields from a property, whether it is used or not."""
        if self._uses is None:
            self._uses = {}
            for function, output in enumerate(self._network.outputs):
                for input_ in self._network.inputs[function]:
                    self._uses.setdefault(input_, []).append(output)
        return self._uses.get(number, ())
