"""Plans the substitute of a failed service, which publishes its values again.

That is all of them, or else those that can be computed, if the message says "unknown" of the rest.
"""
from dataclasses import dataclass, field, replace
from itertools import islice
from math import prod
from typing import Collection, Iterable, Optional, Sequence, Set, Tuple

from shsa_core.codegen.choice import listing
from shsa_core.codegen.generator import function_of, generate, inputs_of
from shsa_core.codegen.prediction import Predictor
from shsa_core.errors import GenerationError, ModelError, NoSubstitute, ShsaError, listed
from shsa_core.model.error import Error, refusal
from shsa_core.model.field import reduces
from shsa_core.model.kinds import Method, Others
from shsa_core.model.ontology import Ontology
from shsa_core.model.service import Service, Source
from shsa_core.model.substitution import Program
from shsa_core.search.best import BestDerivations
from shsa_core.search.derivation import Derivation, Rated, SourceTable
from shsa_core.search.depth_first import nearest

REFUSED_AT_MOST = 20
"""The most derivations that are passed over as too large for code, or too wrong."""
SMALLEST_QUALITY = 5e-324
"""A product of many qualities may be too small for a float, but it is not 0."""


@dataclass(frozen=True)
class Plan:
    """The program of a service's substitute, and where it comes from.

    Plans are equal if they have the same program for the same service from the same inputs.
    `inputs` and `outputs` are the sources that the program reads and gives again, in its order.
    `quality`, in (0, 1], is the product over all outputs, 0: they are a service's safe values, when
    nothing can be computed; `derivations` follow them, and so do
    `errors`, the expected ones in the unit of each property, None: not known. `proven_best`: no
    plan that was asked for is better. `left_out`: the properties of the service that it leaves
    unknown, as they are `missing` something.
    """

    service: str
    program: Program
    inputs: Tuple[Source, ...] = field(repr=False)
    outputs: Tuple[Source, ...] = field(compare=False, repr=False)
    quality: float = field(compare=False)
    relations: Tuple[str, ...] = field(compare=False)
    proven_best: bool = field(compare=False)
    derivations: Tuple[Derivation, ...] = field(compare=False, repr=False)
    errors: Tuple[Optional[Error], ...] = field(compare=False, repr=False)
    left_out: Tuple[str, ...] = field(default=(), compare=False)
    missing: Tuple[str, ...] = field(default=(), compare=False)

    @property
    def computes(self) -> bool:
        """Tell that it computes its values; else they are fixed, for when nothing can be."""
        return self.quality > 0.0

    @property
    def told(self) -> str:
        """Return it in words."""
        using = ", ".join(self.relations) or "the same property elsewhere"
        inputs = ", ".join(self.program.inputs) or "constants"
        lacks = f"; {self.lacks}" if self.left_out else ""
        return f"quality {self.quality:.2g} by {using} from {inputs}{lacks}"

    @property
    def lacks(self) -> str:
        """Return what it leaves unknown, and why, in words; empty: it gives all values."""
        if not self.left_out:
            return ""
        missing = listed(self.missing) or "any relation that yields it"
        return f"{listed(self.left_out)} is left unknown, missing {missing}"


def plan_service(
    ontology: Ontology,
    service: Service,
    table: SourceTable,
    excluded: Iterable[str] = (),
    method: str = "best",
    tried: Collection[Plan] = (),
    predictor: Optional[Predictor] = None,
    steps: Optional[int] = None,
) -> Plan:
    """Return the best plan for a lost service, other than those `tried`, from the table's sources.

    It uses neither the service itself nor what is `excluded`, and what shares a cause with it only
    if nothing else will do. Where no plan gives all values, it gives a `part`. With a `predictor`
    the best is that of the smallest error. `steps`: as for `nearest`. Raises NoSubstitute with what
    is missing, GenerationError if no code can be generated, or its messages cannot be written.
    """
    why = service.unwritable or read_alone(service)
    if why:
        raise GenerationError(f"no substitute for {service.name}: {why}")
    available = table.excluding([service.name, *excluded])
    none: ShsaError = NoSubstitute(service.properties, ())
    for whole in (True, False):
        for causes in (*service.avoided, ()):
            apart = available.excluding(causes)
            outputs = service.sources if whole else _derivable(service, apart)
            question = ontology, outputs, apart, method, tried, predictor, steps
            try:
                plan = plan_sources(*question) if outputs else None
            except (NoSubstitute, GenerationError) as error:
                none = error if whole else none
                continue
            if plan is not None:
                left = tuple(s.property for s in service.sources if s not in outputs)
                missing = none.missing if left and isinstance(none, NoSubstitute) else ()
                return replace(plan, left_out=left, missing=missing)
    raise none


def _derivable(service: Service, table: SourceTable) -> Tuple[Source, ...]:
    """Return what can be published of a service that lacks a value; nothing if it lacks none.

    Nor where its message does not say of each lost one that it is unknown.
    """
    if len({source.provision.unknown_with for source in service.sources}) < 2:
        return ()
    best = BestDerivations(table, table.network.executable)
    number = table.network.number
    lost = [s for s in service.sources if not best.settle(number(s.property))]
    unknown = {source.provision.unknown_with for source in lost}
    if not lost or "" in unknown or service.others is not Others.UNKNOWN:
        return ()
    return tuple(s for s in service.sources if s.provision.unknown_with not in unknown)


def plan_sources(
    ontology: Ontology,
    outputs: Sequence[Source],
    table: SourceTable,
    method: str = "best",
    tried: Collection[Plan] = (),
    predictor: Optional[Predictor] = None,
    steps: Optional[int] = None,
) -> Plan:
    """Return the best plan for sources of one service, as `plan_service`, from all in the table."""
    if method not in list(Method):
        known = ", ".join(map(str, Method))
        raise ModelError("method", f"{method!r} is not known; allowed are {known}")
    network, properties = ontology.network, [source.property for source in outputs]
    limits = [source.provision.fault_tolerant_error for source in outputs]
    asked = predictor, outputs[0].service.prefer, limits
    refused: Optional[GenerationError] = None
    too_wrong = ""
    failed: Set[Plan] = set()
    numbers = [network.number(name) for name in properties]
    for usable, whole in nearest(table, numbers, network.executable, steps):
        found = listing(table, properties, usable, *asked, method=method)
        for rated, proven in islice(found, len(tried) + REFUSED_AT_MOST):
            try:
                plan = make_plan(ontology, outputs, rated, proven and whole, predictor)
            except GenerationError as error:
                refused = refused or error
                continue
            why = errs_too_much(plan, plan.errors)
            if why:
                too_wrong = too_wrong or why
            elif plan not in tried:
                return plan
            else:
                failed.add(plan)
    if refused is not None:
        raise refused
    if failed:
        raise NoSubstitute(properties, (), tried=len(failed))
    if too_wrong:
        raise NoSubstitute(properties, (), refused=too_wrong)
    best = BestDerivations(table)
    lost = [name for name in properties if not best.settle(network.number(name))]
    if lost:
        missing = {each for name in lost for each in best.missing(network.number(name))}
        raise NoSubstitute(properties, sorted(missing), lost=lost)
    program_of(ontology, [best.ratings.derivation(number) for number in numbers], outputs)
    raise AssertionError("what can be generated was found before")


def errs_too_much(plan: Plan, errors: Iterable[Optional[Error]]) -> str:
    """Return why a plan is not used if it errs like that, in words; empty: it may be."""
    for source, derivation, error in zip(plan.outputs, plan.derivations, errors):
        why = refusal(error, source.provision.fault_tolerant_error)
        if why:
            by = listed(derivation.relations()) or "the same property elsewhere"
            return f"{source.property} by {by}: {why}"
    return ""


def make_plan(
    ontology: Ontology,
    outputs: Sequence[Source],
    rated: Rated,
    proven_best: bool,
    predictor: Optional[Predictor],
) -> Plan:
    """Return the plan by a joint derivation of `outputs`. Raises GenerationError."""
    derivations = rated.derivation.inputs
    program = program_of(ontology, derivations, outputs)
    errors = predictor.of(derivations) if predictor else [None] * len(derivations)
    known = [error.quality for error in errors if error is not None and error.quality is not None]
    quality = prod(known) if len(known) == len(errors) else rated.quality
    return Plan(
        outputs[0].service.name,
        program,
        inputs_of(derivations),
        tuple(outputs),
        max(quality, SMALLEST_QUALITY),
        tuple(dict.fromkeys(r for d in derivations for r in d.relations())),
        proven_best,
        derivations,
        tuple(errors),
    )


def safe_values(service: Service) -> Optional[Plan]:
    """Return the plan of a service's safe values; None if the SOM gives none."""
    values = dict(service.last_resort.values)
    outputs = tuple(source for source in service.sources if source.property in values)
    if not outputs or service.unwritable or read_alone(service):
        return None
    fixed = lambda name: function_of("safe value", name, repr(values[name]))
    parts = [(Derivation(s.property, None, fixed(s.property)), s.output) for s in outputs]
    program = generate(parts, {})
    return Plan(service.name, program, (), outputs, 0.0, (), False, (), (None,) * len(outputs))


def read_alone(service: Service) -> str:
    """Return why the fields of a service cannot be written by any type; empty if they can."""
    fields = (provision.field for provision in service.provides)
    return next((f"{field} is read-only" for field in fields if reduces(field)), "")


def program_of(
    ontology: Ontology, derivations: Sequence[Derivation], outputs: Sequence[Source]
) -> Program:
    """Return the program that derives each output. Raises GenerationError."""
    parts = [(derivation, source.output) for derivation, source in zip(derivations, outputs)]
    return generate(parts, ontology.constants)
