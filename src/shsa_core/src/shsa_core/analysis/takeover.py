"""Plans what would take each service over if its node failed, as healing does."""
from typing import Callable, Collection, Iterable, Optional

from shsa_core.codegen.plans import Plan, plan_service
from shsa_core.codegen.prediction import predictor
from shsa_core.model.ontology import Ontology
from shsa_core.model.service import Service, Source
from shsa_core.search.derivation import SourceTable

SLOW = 5.0  # periods of a service: an input that is slower makes it repeat old values


def takeovers(ontology: Ontology, sources: Collection[Source]) -> Callable[[Service], Plan]:
    """Return what plans for a service whose node fails; it raises what `plan_service` raises."""
    table, errors = SourceTable(ontology.network, sources), predictor(ontology, sources)
    return lambda service: plan_service(ontology, service, table, [service.node], predictor=errors)


def slowest(service: Service, reads: Iterable[Source]) -> Optional[Source]:
    """Return the slowest of some sources, if it is more than SLOW times as slow as the service."""
    periodic = [source for source in reads if source.service.period is not None]
    slow = max(periodic, key=lambda source: source.service.period or 0.0, default=None)
    if slow is None or service.period is None:
        return None
    return slow if (slow.service.period or 0.0) > SLOW * service.period else None
