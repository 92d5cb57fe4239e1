"""Plans what would take each service over if its node failed, as healing does, for all at once."""
from typing import Collection, Dict, Iterable, List, Optional, Sequence

from shsa_core.codegen.plans import Plan, check_writable, make_plan, part, plan_service
from shsa_core.codegen.prediction import predictor
from shsa_core.errors import NoSubstitute
from shsa_core.model.ontology import Ontology
from shsa_core.model.service import Service, Source
from shsa_core.search.best import BestDerivations
from shsa_core.search.derivation import LOST, SourceTable, rate_joint
from shsa_core.search.ratings import Ratings, dependents

SLOW = 5.0  # periods of a service: an input that is slower makes it repeat old values


class Takeovers:
    """The best derivations of all properties, what failures leave of them, and plans by that.

    A failure rates again only what used something that is gone. `predictor` is None if no errors
    are known.
    """

    def __init__(self, ontology: Ontology, sources: Collection[Source]) -> None:
        self._ontology = ontology
        network = self._network = ontology.network
        self._table = SourceTable(network, sources)
        self.predictor = predictor(ontology, sources)
        self._provides: Dict[str, List[int]] = {}  # the properties that go with a name
        for source in sources:
            for name in source.names:
                self._provides.setdefault(name, []).append(network.number(source.property))
        self._best = BestDerivations(network, self._table, network.executable, prune=False)
        numbers = range(len(network.names))
        for number in numbers:
            self._best.settle(number)
        self._users = self._best.ratings.users(numbers)
        self._all_executable = all(map(network.executable, range(len(network.functions))))

    def after(self, failed: Iterable[str], blocked: Optional[int] = None) -> Ratings:
        """Rate what is left once some causes have failed, and a `blocked` property with them."""
        names = tuple(failed)
        gone = {number for name in names for number in self._provides.get(name, ())}
        ratings = Ratings(self._network, self._table.excluding(names), self._best.ratings)
        affected = dependents(self._users, gone if blocked is None else gone | {blocked})
        if blocked is not None:
            affected.remove(blocked)
            ratings[blocked] = LOST
        self._best.settle_cycle(affected, ratings)
        return ratings

    def of(self, service: Service) -> Plan:
        """Return the best plan if the service's node fails. Raises what `plan_service` raises."""
        check_writable(service)
        network = self._network
        numbers = [network.number(name) for name in service.properties]
        ratings = self._without(service, numbers)
        lost = [number for number in numbers if ratings[number] == LOST]
        names = [network.names[number] for number in lost]
        if lost and self._all_executable and not part(service, names):
            missing = {name for number in lost for name in self._best.missing(number, ratings)}
            raise NoSubstitute(service.properties, sorted(missing), lost=names)
        by_quality = self.predictor is None and not service.prefer
        if not lost and by_quality:  # else the best may be of another quality
            rated = rate_joint([each for each in map(ratings.rated, numbers) if each is not None])
            plan = make_plan(self._ontology, service.name, service.sources, rated, True, None)
            if isinstance(plan, Plan):
                return plan
        question = self._ontology, service, self._table, [service.node]
        return plan_service(*question, predictor=self.predictor)

    def _without(self, service: Service, numbers: Sequence[int]) -> Ratings:
        """Rate what is left for some values of a failed service, as `plan_service` chooses."""
        own = service.node, service.name
        for causes in service.avoided:
            apart = self.after([*own, *causes])
            if all(apart[number] != LOST for number in numbers):
                return apart
        return self.after(own)


def slowest(service: Service, reads: Iterable[Source]) -> Optional[Source]:
    """Return the slowest of some sources, if it is more than SLOW times as slow as the service."""
    periodic = [source for source in reads if source.service.period is not None]
    slow = max(periodic, key=lambda source: source.service.period or 0.0, default=None)
    if slow is None or service.period is None:
        return None
    return slow if (slow.service.period or 0.0) > SLOW * service.period else None
