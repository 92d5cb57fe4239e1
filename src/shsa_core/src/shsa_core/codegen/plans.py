"""Plans: what takes a failed service over. One substitute gives all of its values again."""
from dataclasses import dataclass, field
from itertools import islice
from typing import Collection, Iterable, Iterator, Optional, Sequence, Tuple

from shsa_core.codegen.generator import Program, generate, generate_values, inputs_of
from shsa_core.errors import GenerationError, ModelError, NoSubstitute, ShsaError
from shsa_core.model.network import Network
from shsa_core.model.ontology import Ontology
from shsa_core.model.service import Service, Source
from shsa_core.search.best import BestDerivations
from shsa_core.search.depth_first import first_found
from shsa_core.search.derivation import Derivation, Rated, SourceTable, rate_joint
from shsa_core.search.ranking import Ranking
from shsa_core.search.substitutes import SMALLEST_QUALITY

METHODS = ("best", "depth_first", "orr")  # orr: the paper's word for depth_first
# How many derivations are passed over because no code can be generated for them, as for a very
# large one.
REFUSED_AT_MOST = 100


@dataclass(frozen=True)
class Plan:
    """How a service is taken over: the substitute's program, and where it comes from.

    Plans are equal if they do the same: the same program for the same service from the same inputs.
    `inputs` and `outputs` are the sources that the program reads and gives again, in its order.
    `quality`, in (0, 1], is the product over all outputs; `derivations` follow them. `proven_best`:
    no plan that was asked for is better.
    """

    service: str
    program: Program
    inputs: Tuple[Source, ...] = field(repr=False)
    outputs: Tuple[Source, ...] = field(compare=False, repr=False)
    quality: float = field(compare=False)
    relations: Tuple[str, ...] = field(compare=False)
    proven_best: bool = field(compare=False)
    derivations: Tuple[Derivation, ...] = field(compare=False, repr=False)


@dataclass(frozen=True)
class SafeValues:
    """How a service is taken over when nothing can be computed.

    The program gives fixed values for `outputs`.
    """

    service: str
    program: Program
    outputs: Tuple[Source, ...] = field(compare=False, repr=False)


def plan_service(
    ontology: Ontology,
    service: Service,
    table: SourceTable,
    excluded: Iterable[str] = (),
    method: str = "best",
    tried: Collection[Plan] = (),
) -> Plan:
    """The best plan for a lost service, other than those `tried`, from the sources in the table.

    Neither the service itself is used nor the services, topics and nodes `excluded`. `method`:
    `best`; or `depth_first`, the first found. Raises NoSubstitute with what is missing,
    GenerationError if only relations that cannot be executed would do.
    """
    return plan_sources(
        ontology,
        service.name,
        service.sources,
        table.excluding([service.name, *excluded]),
        method,
        tried,
    )


def plan_sources(
    ontology: Ontology,
    service: str,
    outputs: Sequence[Source],
    table: SourceTable,
    method: str = "best",
    tried: Collection[Plan] = (),
) -> Plan:
    """The plan that gives some sources of a service again, from all that is in the table.

    The rest is as in `plan_service`.
    """
    if method not in METHODS:
        raise ModelError("method", f"{method!r} is not known; allowed are {', '.join(METHODS)}")
    properties = [source.property for source in outputs]
    refused: Optional[GenerationError] = None
    failed = set()
    found = _derivations(ontology.network, table, properties, method)
    for rated, proven_best in islice(found, len(tried) + REFUSED_AT_MOST):
        derivations = rated.derivation.inputs
        try:
            program = _program(ontology, derivations, outputs)
        except GenerationError as error:
            refused = refused or error
            continue
        plan = Plan(
            service,
            program,
            inputs_of(derivations),
            tuple(outputs),
            max(rated.quality, SMALLEST_QUALITY),
            tuple(dict.fromkeys(r for d in derivations for r in d.relations())),
            proven_best,
            derivations,
        )
        if plan not in tried:
            return plan
        failed.add(plan)
    if refused is not None:
        raise refused
    if failed:
        raise NoSubstitute(properties, (), tried=len(failed))
    raise _nothing(ontology, table, properties, outputs)


def safe_values(service: Service) -> Optional[SafeValues]:
    """The program that publishes the safe values of a service; None if the SOM gives none."""
    values = dict(service.last_resort.values)
    outputs = tuple(source for source in service.sources if source.property in values)
    if not outputs:
        return None
    program = generate_values([(source, values[source.property]) for source in outputs])
    return SafeValues(service.name, program, outputs)


def _program(
    ontology: Ontology, derivations: Sequence[Derivation], outputs: Sequence[Source]
) -> Program:
    parts = [(derivation, source.path) for derivation, source in zip(derivations, outputs)]
    return generate(parts, ontology.constants)


def _derivations(
    network: Network, table: SourceTable, properties: Sequence[str], method: str
) -> Iterator[Tuple[Rated, bool]]:
    """Joint derivations of the properties: the one by `method`, then all; and if it is best."""
    numbers = [network.number(name) for name in properties]

    def executable(function: int) -> bool:
        return network.functions[function].law is not None

    if method == "best":
        best = BestDerivations(network, table, executable)
        for number in numbers:
            best.settle(number)
        firsts = [best.ratings.rated(number) for number in numbers]
    else:
        firsts = [first_found(network, table, number, executable) for number in numbers]
    parts = [rated for rated in firsts if rated is not None]
    if len(parts) == len(properties):
        yield rate_joint(parts), method == "best"
        for rated in Ranking(network, table, executable).joint(numbers):
            yield rated, True


def _nothing(
    ontology: Ontology, table: SourceTable, properties: Sequence[str], outputs: Sequence[Source]
) -> ShsaError:
    """Why there is no plan: what is missing, or the relation that cannot be executed."""
    best = BestDerivations(ontology.network, table)
    numbers = [ontology.network.number(name) for name in properties]
    lost = [number for number in numbers if not best.settle(number)]
    if lost:
        missing = {name for number in lost for name in best.missing(number)}
        return NoSubstitute(properties, sorted(missing))
    try:
        _program(ontology, [best.ratings.derivation(number) for number in numbers], outputs)
    except GenerationError as error:
        return error
    raise AssertionError("what can be generated was found before")
