"""What `shsa find` answers, as documents for programs."""
from itertools import islice
from typing import Any, Dict, FrozenSet, Iterator, List, NamedTuple, Optional, Sequence, Tuple

from shsa_core.analysis.loss import Loss, dead_branches
from shsa_core.analysis.takeover import slowest
from shsa_core.codegen.choice import substitutes
from shsa_core.codegen.generator import generate
from shsa_core.codegen.plans import Plan, plan_service, plan_sources
from shsa_core.codegen.prediction import Predictor
from shsa_core.codegen.program import INTEGRAL, compile_program
from shsa_core.errors import GenerationError, NoSubstitute
from shsa_core.model.error import Error
from shsa_core.model.ontology import Ontology
from shsa_core.model.service import Provision, Service, Source
from shsa_core.model.som import Som
from shsa_core.search.derivation import Derivation, SourceTable
from shsa_core.search.substitutes import Substitute

Answer = Dict[str, Any]
LOOKED_AT = 100  # derivations, for the alternatives of an explanation
MOST_LINES = 200  # of a derivation that an explanation has


class Asked(NamedTuple):
    """What is asked: of which models, and how.

    `alternatives`: how many an explanation gives, None for no explanation; `predictor`: who knows
    errors, if anybody.
    """

    ontology: Ontology
    som: Som
    without: Tuple[str, ...]
    method: str
    limit: int
    alternatives: Optional[int]
    predictor: Optional[Predictor] = None

    @property
    def first(self) -> str:
        """The method for one substitute."""
        return "best" if self.method == "all" else self.method


def of_service(asked: Asked, service: Service) -> Answer:
    """What would take a whole service over: what healing asks."""
    answer: Answer = {"service": service.name, "properties": list(service.properties)}
    table = SourceTable(asked.ontology.network, asked.som.sources)
    excluded = [service.node, *asked.without]
    try:
        plan = plan_service(
            asked.ontology, service, table, excluded, asked.first, predictor=asked.predictor
        )
    except (NoSubstitute, GenerationError) as error:
        return {**answer, **_refusal(error)}
    answer.update(_planned(plan))
    errors = [described(error) for error in plan.errors]
    answer["errors"] = dict(zip((source.property for source in plan.outputs), errors))
    shares = [c for c in service.shared if any(c in s.names for s in plan.inputs)]
    slow = slowest(service, plan.inputs)
    if shares:
        answer["shares"] = shares
    if slow is not None:
        answer["slow"] = {"service": slow.service.name, "period": slow.service.period}
    return answer


def of_property(asked: Asked, loss: Loss, whole: Optional[Answer] = None) -> Answer:
    """What replaces a lost property; `whole` is the answer for its service, if it has one.

    Where the whole service cannot be healed, neither is the property: what derives it `alone` is
    said.
    """
    healed = whole is None or "substitute" not in whole
    if loss.source is not None and whole is not None and healed:
        loss = loss.apart(whole.get("shares", ()))
    answer = _one(asked, loss)
    if not healed and "substitute" not in answer:
        assert whole is not None
        alone = {key: value for key, value in answer.items() if key != "property"}
        refusal = {
            key: whole[key]
            for key in ("service", "substitute", "missing", "refused")
            if key in whole
        }
        answer = {"property": loss.name, **refusal, "alone": alone}
    elif whole is not None and "substitute" not in answer:
        answer.update({key: whole[key] for key in ("shares", "slow") if key in whole})
    if asked.method == "all":
        refusal = answer if "substitute" in answer else {"property": loss.name}
        answer = {**refusal, **_all(asked, loss)}
    if asked.alternatives is not None:
        answer.update(_explanation(asked, loss, asked.alternatives))
    return answer


def _one(asked: Asked, loss: Loss) -> Answer:
    """What replaces the lost property alone."""
    table = SourceTable(asked.ontology.network, loss.available)
    output = loss.source or _new_source(loss.name)
    try:
        name = output.service.name
        plan = plan_sources(
            asked.ontology, name, [output], table, asked.first, predictor=asked.predictor
        )
    except (NoSubstitute, GenerationError) as error:
        return {"property": loss.name, **_refusal(error)}
    return {"property": loss.name, **_planned(plan), "error": described(plan.errors[0])}


def described(error: Optional[Error]) -> Optional[Answer]:
    """An expected error as programs read it."""
    keys = ("rms", "bias", "p95", "delay", "source")
    return None if error is None else {key: getattr(error, key) for key in keys}


def _planned(plan: Plan) -> Answer:
    program, outputs = plan.program, [source.path for source in plan.outputs]
    answer = _answer(plan.quality, plan.relations, plan.proven_best, program, outputs)
    if INTEGRAL in program.code:
        compiled = compile_program(program.code, len(program.inputs), len(outputs))
        answer.update({"starts_at_zero": True} if compiled.hidden else {})
    return answer


def _new_source(name: str) -> Source:
    """Where a property that nothing provides would be published: on a topic of its name."""
    service = Service(name, "/" + name, "", "", None, (Provision(name, "data"),))
    return service.sources[0]


def _answer(
    quality: float, relations: Sequence[str], proven_best: bool, program: Any, outputs: List[str]
) -> Answer:
    return {
        "quality": quality,
        "relations": list(relations),
        "proven_best": proven_best,
        "inputs": list(program.inputs) if program is not None else [],
        "code": program.code if program is not None else None,
        "output": ",".join(outputs),
    }


def _refusal(error: Exception) -> Answer:
    if isinstance(error, NoSubstitute):
        return {"substitute": None, "missing": list(error.missing)}
    return {"substitute": None, "missing": [], "refused": str(error)}


def _all(asked: Asked, loss: Loss) -> Answer:
    found = substitutes(asked.ontology, loss.available, loss.name, asked.predictor)
    answers = [_described(asked.ontology, loss, *each) for each in islice(found, asked.limit)]
    return {"substitutes": answers, "complete": next(found, None) is None}


def _described(
    ontology: Ontology, loss: Loss, substitute: Substitute, error: Optional[Error]
) -> Answer:
    derivation = substitute.derivation
    output = (loss.source or _new_source(loss.name)).path
    refused: Answer = {}
    program = None
    try:
        program = generate([(derivation, output)], ontology.constants)
    except GenerationError as refusal:
        refused = {"refused": str(refusal), "inputs": _paths(derivation)}
    relations = derivation.relations()
    answer = _answer(substitute.quality, relations, substitute.proven_best, program, [output])
    return {"property": loss.name, **answer, "error": described(error), **refused}


def _paths(derivation: Derivation) -> List[str]:
    return list(dict.fromkeys(source.path for source in derivation.sources()))


def _explanation(asked: Asked, loss: Loss, most: int) -> Answer:
    """The best derivation line by line, some alternatives, and what the dead branches lack."""
    # By relations and sources: where in the tree these stand is left out.
    alternatives: Dict[
        Tuple[Tuple[str, ...], FrozenSet[Source]], Tuple[Substitute, Optional[Error]]
    ] = {}
    ranked = substitutes(asked.ontology, loss.available, loss.name, asked.predictor)
    for each, error in islice(ranked, LOOKED_AT):
        key = each.derivation.relations(), frozenset(each.derivation.sources())
        alternatives.setdefault(key, (each, error))
    found = list(alternatives.values())
    return {
        "derivation": list(islice(_tree(found[0][0].derivation), MOST_LINES)) if found else [],
        "alternatives": [
            {
                "quality": each.quality,
                "relations": list(each.derivation.relations()),
                "inputs": [source.path for source in each.derivation.sources()],
                "error": described(error),
            }
            for each, error in found[1 : 1 + most]
        ],
        "more_alternatives": max(len(found) - 1 - most, 0),
        "dead": [dead._asdict() for dead in dead_branches(asked.ontology, loss)],
    }


def _tree(derivation: Derivation) -> Iterator[str]:
    """The derivation, one line for each property, indented by its depth."""
    stack = [(derivation, 0)]
    while stack:
        part, depth = stack.pop()
        if part.source is not None:
            by = f"measured by {part.source.node} at {part.source.path}"
            quality, error = part.source.quality, part.source.provision.error
        else:
            assert part.function is not None
            by = f"{part.function.relation}: {part.function.text}"
            quality, error = part.function.quality, part.function.error
        figure = "" if error is None else f", error {error.rms:g}"
        yield f"{'  ' * depth}{part.property}  {by}  (quality {quality:g}{figure})"
        stack.extend((input_, depth + 1) for input_ in reversed(part.inputs))
