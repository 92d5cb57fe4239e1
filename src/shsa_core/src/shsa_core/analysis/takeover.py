"""Plans what would take each service over if its node failed, as healing does."""
from typing import Collection, Iterable, Optional

from shsa_core.codegen.plans import Plan, plan_service
from shsa_core.codegen.prediction import predictor
from shsa_core.model.ontology import Ontology
from shsa_core.model.service import Service, Source
from shsa_core.search.derivation import SourceTable

SLOW = 5.0  # periods of a service: an input that is slower makes it repeat old values


class Takeovers:
    """Plans by all sources; `predictor` is None if no errors are known."""

    def __init__(self, ontology: Ontology, sources: Collection[Source]) -> None:
        self._ontology = ontology
        self._table = SourceTable(ontology.network, sources)
        self.predictor = predictor(ontology, sources)

    def of(self, service: Service) -> Plan:
        """Return the best plan if the service's node fails. Raises what `plan_service` raises."""
        question = self._ontology, service, self._table, [service.node]
        return plan_service(*question, predictor=self.predictor)


def slowest(service: Service, reads: Iterable[Source]) -> Optional[Source]:
    """Return the slowest of some sources, if it is more than SLOW times as slow as the service."""
    periodic = [source for source in reads if source.service.period is not None]
    slow = max(periodic, key=lambda source: source.service.period or 0.0, default=None)
    if slow is None or service.period is None:
        return None
    return slow if (slow.service.period or 0.0) > SLOW * service.period else None
