"""Checks that substitutes fit where they would be placed: CPU and link of each host (Section IV-A).

It places them as healing does, by measured costs (docs/explanation/experiments.md), on hosts that
have nothing else to do.
"""
from typing import Callable, Collection, Dict, Iterator, List, Sequence

from shsa_core.codegen.plans import Plan, plan_service
from shsa_core.codegen.prediction import predictor
from shsa_core.errors import GenerationError, NoSubstitute
from shsa_core.healing.settings import Settings
from shsa_core.model.cost import Cost, cost, idle_cost
from shsa_core.model.kinds import Standby
from shsa_core.model.ontology import Ontology
from shsa_core.model.service import Service, Source
from shsa_core.model.som import Som
from shsa_core.planning.placement import OWN, Computers, Placement
from shsa_core.search.derivation import SourceTable
from shsa_learning.finding import Finding


def takeovers(ontology: Ontology, sources: Collection[Source]) -> Callable[[Service], Plan]:
    """Return what plans for a service whose node fails; it raises what `plan_service` raises."""
    table, errors = SourceTable(ontology.network, sources), predictor(ontology, sources)
    return lambda service: plan_service(ontology, service, table, [service.node], predictor=errors)


def check_placements(ontology: Ontology, som: Som) -> Iterator[Finding]:
    """Report the needed services whose substitutes do not fit where they would be, with the sums.

    For each node that fails: the substitutes of all that it provides, beside what stands by. The
    reconfigurator is taken to be on none of the hosts of the SOM.
    """
    if not som.hosts:
        return
    schedule = _Schedule(ontology, som)
    yield from schedule.stand_by()
    for node in dict.fromkeys(service.node for service in som.may_be_needed()):
        yield from schedule.after([each for each in som.may_be_needed() if each.node == node])


class _Schedule:
    """The places where substitutes would run, and what they take there."""

    def __init__(self, ontology: Ontology, som: Som) -> None:
        self._som = som
        plan_of = takeovers(ontology, som.sources)
        self._reads: Dict[str, List[Service]] = {}  # by whoever has a substitute
        for service in som.may_be_needed():
            if service.policy.substitutes:
                try:
                    reads = plan_of(service).inputs
                except (NoSubstitute, GenerationError):
                    continue  # `check` says why
                self._reads[service.name] = list(dict.fromkeys(each.service for each in reads))
        computers = Computers()
        for host in som.hosts.values():
            computers.seen(0.0, host.name, 0.0, host.cores or 0.0)
        self._placed: Dict[str, List[Cost]] = {}
        self._placement = Placement(
            computers, lambda host, _since: self._placed.get(host, []), lambda: som
        )

    def stand_by(self) -> Iterator[Finding]:
        """Place what runs while nothing has failed: hot substitutes, and the pools of warm ones."""
        pools: Dict[str, List[Service]] = {}
        for service in self._of(Standby.HOT):
            yield from self._place(service)
        for service in self._of(Standby.WARM):
            place = self._placement.place(0.0, service, self._reads[service.name])
            pools.setdefault(place.host, []).extend(self._reads[service.name])
        for host, inputs in pools.items():
            idle = idle_cost(inputs, [host])
            self._placed.setdefault(host, []).extend([idle] * Settings.pool)

    def after(self, services: Sequence[Service]) -> Iterator[Finding]:
        """Report what does not fit once some services have failed together."""
        before = {host: list(costs) for host, costs in self._placed.items()}
        for service in services:
            if service.name in self._reads and service.standby is not Standby.HOT:  # it runs
                yield from self._place(service)
        self._placed = before

    def _of(self, standby: Standby) -> List[Service]:
        placed = (each for each in self._som.may_be_needed() if each.name in self._reads)
        return [each for each in placed if each.standby is standby]

    def _place(self, service: Service) -> Iterator[Finding]:
        inputs = self._reads[service.name]
        place = self._placement.place(0.0, service, inputs)
        self._placed.setdefault(place.host, []).append(cost(inputs, service, [place.host]))
        if place.passed_over:
            why = "; ".join([*place.passed_over, f"it would run on {place.host or OWN}"])
            what = f"the substitute of {service.name} does not fit: {why}"
            todo = "Give it another placement or a colder standby, or its host more room"
            yield Finding("warning", service.where, what, todo)
