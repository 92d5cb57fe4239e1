"""What would take each service over if it failed: as healing plans it, for all services at once."""
from dataclasses import dataclass
from typing import Collection, Iterable, Optional, Sequence, Tuple

from shsa_core.analysis.failures import Failures
from shsa_core.codegen.plans import check_writable, plan_service, program_of
from shsa_core.codegen.prediction import predictor
from shsa_core.errors import GenerationError, NoSubstitute, ShsaError
from shsa_core.model.error import Error
from shsa_core.model.ontology import Ontology
from shsa_core.model.service import Service, Source
from shsa_core.search.derivation import LOST, SourceTable

SLOW = 5.0  # periods of a service: an input that is slower makes it repeat old values


@dataclass(frozen=True)
class Takeover:
    """What takes a service over: the quality of its best plan, and the sources that this reads.

    `errors`: what is expected of each value of the service, in its unit; None: not known.
    """

    quality: float
    reads: Tuple[Source, ...]
    errors: Tuple[Optional[Error], ...]

    def slower_than(self, service: Service) -> Optional[Source]:
        """The slowest source that it reads, if that is slower than the service by far."""
        return slowest(service, self.reads)


class Takeovers:
    """Answers as `plan_service` does, with what several services have in common worked out once.

    `failures`: what is left after failures, by the relations that can be executed; `predictor`:
    who predicts errors, None if none are known.
    """

    def __init__(self, ontology: Ontology, sources: Collection[Source]) -> None:
        self._ontology = ontology
        self._sources = sources
        self.predictor = predictor(ontology, sources)
        self.failures = Failures(ontology.network, sources, self.executable)
        self._of_all: Optional[Failures] = None
        self._table: Optional[SourceTable] = None

    def executable(self, function: int) -> bool:
        """Whether a function can be executed."""
        return self._ontology.network.functions[function].law is not None

    def of(self, service: Service) -> Takeover:
        """What takes a service over if its node fails.

        Raises NoSubstitute, or GenerationError, as `plan_service` would.
        """
        check_writable(service)
        numbers = [self._ontology.network.number(source.property) for source in service.sources]
        failure = self.failures.of(service, numbers)
        if any(failure.ratings[number] == LOST for number in numbers):
            raise self._why(service, numbers)
        if self.predictor is not None:  # the best is not the one of the highest quality
            return self._planned(service)
        derivations = [failure.ratings.derivation(number) for number in numbers]
        try:
            program_of(self._ontology, derivations, service.sources)
        except GenerationError:  # too large: the search passes it over
            return self._planned(service)
        quality = 1.0
        for number in numbers:
            quality *= failure.ratings[number][4]
        reads = dict.fromkeys(source for each in derivations for source in each.sources())
        return Takeover(quality, tuple(reads), (None,) * len(numbers))

    def _planned(self, service: Service) -> Takeover:
        if self._table is None:
            self._table = SourceTable(self._ontology.network, self._sources)
        plan = plan_service(
            self._ontology, service, self._table, [service.node], predictor=self.predictor
        )
        return Takeover(plan.quality, plan.inputs, plan.errors)

    def _why(self, service: Service, numbers: Sequence[int]) -> ShsaError:
        """Why nothing does: what is missing, or the relation that cannot be executed."""
        if self._of_all is None:
            self._of_all = Failures(self._ontology.network, self._sources)
        failure = self._of_all.of(service, numbers)
        lost = [number for number in numbers if failure.ratings[number] == LOST]
        if lost:
            names = [self._ontology.network.names[number] for number in lost]
            missing = {name for number in lost for name in self._of_all.missing(number, failure)}
            return NoSubstitute(names, sorted(missing))
        try:
            derivations = [failure.ratings.derivation(number) for number in numbers]
            program_of(self._ontology, derivations, service.sources)
        except GenerationError as error:
            return error
        raise AssertionError("what can be executed was found before")


def slowest(service: Service, reads: Iterable[Source]) -> Optional[Source]:
    """The slowest of some sources, if a service comes more than SLOW times as often."""
    periodic = [source for source in reads if source.service.period is not None]
    slow = max(periodic, key=lambda source: source.service.period or 0.0, default=None)
    if slow is None or service.period is None:
        return None
    return slow if (slow.service.period or 0.0) > SLOW * service.period else None
