"""The answers of `shsa find`, as documents for programs."""
from itertools import islice
from typing import Any, Dict, Iterable, Iterator, List, NamedTuple, Optional, Tuple

from shsa_core.codegen.generator import generate
from shsa_core.codegen.plans import Plan, plan_service, plan_sources
from shsa_core.codegen.prediction import Predictor
from shsa_core.codegen.program import INTEGRAL, compile_program
from shsa_core.errors import GenerationError, NoSubstitute
from shsa_core.planning.planner import Calibrations
from shsa_core.model.error import Error, refusal
from shsa_core.model.ontology import Ontology
from shsa_core.model.service import Provision, Service, Source
from shsa_core.model.som import Som
from shsa_core.search.derivation import Derivation, SourceTable
from shsa_learning.check import slowest
from shsa_learning.loss import Loss, dead_branches, ranked
from shsa_learning.substitutes import Substitute

Answer = Dict[str, Any]
Found = Tuple[Substitute, Optional[Error]]
MOST = 1000
"""Substitutes, where all are asked for."""
ALTERNATIVES = 5
LOOKED_AT = 100
"""Derivations, for the alternatives of an explanation."""
MOST_LINES = 200
"""Of a derivation in an explanation."""


class Asked(NamedTuple):
    """A question: the models, what they do without, and the options.

    `explain`: with the derivation, alternatives and dead branches; `predictor`: None where no
    errors are known; `steps`: the deadline of the search, None: it has none; `measured`: by a
    running monitor, None: it was not asked.
    """

    ontology: Ontology
    som: Som
    without: Tuple[str, ...]
    method: str
    explain: bool
    predictor: Optional[Predictor] = None
    steps: Optional[int] = None
    measured: Optional[Calibrations] = None

    def about(self, service: Optional[Service]) -> "Asked":
        """Return it with what a running monitor has measured of a service's substitutes."""
        if service is None or self.predictor is None or self.measured is None:
            return self
        known = self.measured.knowing(service.name, self.predictor)
        return self._replace(predictor=known)

    @property
    def first(self) -> str:
        """The method for one substitute."""
        return "best" if self.method == "all" else self.method


def of_service(asked: Asked, service: Service) -> Answer:
    """Return the substitute of a whole service, as healing would choose it."""
    answer: Answer = {"service": service.name, "properties": list(service.properties)}
    table = SourceTable(asked.ontology.network, asked.som.sources)
    excluded = [service.node, *asked.without]
    try:
        question = asked.ontology, service, table, excluded, asked.first
        plan = plan_service(*question, predictor=asked.predictor, steps=asked.steps)
    except (NoSubstitute, GenerationError) as error:
        return {**answer, **_refusal(error)}
    answer.update(_planned(plan))
    if plan.left_out:
        answer.update({"unknown": list(plan.left_out), "missing": list(plan.missing)})
    errors = [described(error) for error in plan.errors]
    answer["errors"] = dict(zip((source.property for source in plan.outputs), errors))
    shares = [c for c in service.shared if any(c in s.names for s in plan.inputs)]
    slow = slowest(service, plan.inputs)
    answer.update(_wishes(service, plan.relations, plan.inputs))
    if shares:
        answer["shares"] = shares
    if slow is not None:
        answer["slow"] = {"service": slow.service.name, "period": slow.service.period}
    return answer


def of_property(asked: Asked, loss: Loss, whole: Optional[Answer] = None) -> Answer:
    """Return the substitute of a lost property; `whole` is the answer for its service, if any.

    Where a service cannot be healed, nor can the property. What would derive it is given as
    `alone`.
    """
    if whole is None:
        answer = _one(asked, loss)
    elif "substitute" in whole:
        answer = _one(asked, loss)
        if "substitute" not in answer:
            kept = {key: whole[key] for key in _REFUSAL if key in whole}
            answer = {"property": answer.pop("property"), **kept, "alone": answer}
    else:
        loss = loss.apart([*whole.get("shares", ()), *whole.get("to_avoid", ())])
        answer = _one(asked, loss)
        if "substitute" not in answer:
            answer.update({key: whole[key] for key in ("shares", "slow") if key in whole})
    if asked.method == "all":
        refusal = answer if "substitute" in answer else {"property": loss.name}
        found = _ranked(asked, loss)
        several = [_described(asked.ontology, loss, *each) for each in islice(found, MOST)]
        answer = {**refusal, "substitutes": several, "complete": next(found, None) is None}
    if asked.explain:
        answer.update(_explanation(asked, loss))
    return answer


def described(error: Optional[Error]) -> Optional[Answer]:
    """Return an expected error as a document."""
    keys = ("rms", "bias", "p95", "delay", "source")
    return None if error is None else {key: getattr(error, key) for key in keys}


_REFUSAL = ("service", "substitute", "missing", "refused")


def _refusal(error: Exception) -> Answer:
    if isinstance(error, NoSubstitute):
        answer: Answer = {"substitute": None, "missing": list(error.missing)}
        more = {"in_the_way": list(error.in_the_way), "refused": error.refused}
        return {**answer, **{key: value for key, value in more.items() if value}}
    return {"substitute": None, "missing": [], "refused": str(error)}


def _one(asked: Asked, loss: Loss) -> Answer:
    """Return the substitute of a lost property alone."""
    table, output = SourceTable(asked.ontology.network, loss.available), _output(loss)
    try:
        plan = plan_sources(
            asked.ontology,
            [output],
            table,
            asked.first,
            predictor=asked.predictor,
            steps=asked.steps,
        )
    except (NoSubstitute, GenerationError) as error:
        return {"property": loss.name, **_refusal(error)}
    wishes = _wishes(output.service, plan.relations, plan.inputs)
    return {"property": loss.name, **_planned(plan), **wishes, "error": described(plan.errors[0])}


def _output(loss: Loss) -> Source:
    """Return the lost source; of a property that nothing provides, one on a topic of its name."""
    service = Service(loss.name, "/" + loss.name, "", "", None, (Provision(loss.name, "data"),))
    return loss.source or service.sources[0]


def _planned(plan: Plan) -> Answer:
    program, outputs = plan.program, [source.path for source in plan.outputs]
    answer = _answer(plan.quality, plan.relations, plan.proven_best, program, outputs)
    if INTEGRAL in program.code:
        compiled = compile_program(program.code, len(program.inputs), len(outputs))
        answer.update({"starts_at_zero": True} if compiled.hidden else {})
    return answer


def _answer(
    quality: float, relations: Iterable[str], proven_best: bool, program: Any, outputs: List[str]
) -> Answer:
    return {
        "quality": quality,
        "relations": list(relations),
        "proven_best": proven_best,
        "inputs": list(program.inputs) if program is not None else [],
        "code": program.code if program is not None else None,
        "output": ",".join(outputs),
    }


def _ranked(asked: Asked, loss: Loss) -> Iterator[Found]:
    return ranked(asked.ontology, loss, asked.predictor)


def _wishes(service: Service, relations: Iterable[str], sources: Iterable[Source]) -> Answer:
    """Return what a substitute uses of preferred relations and nodes to avoid, and its cost."""
    costs = {source: source.service.cost for source in sources}
    nodes = {source.node for source in costs}
    preferred = [each for each in relations if each in service.prefer]
    to_avoid = [each for each in service.avoid if each in nodes]
    found = {"preferred": preferred, "to_avoid": to_avoid}
    said = {"cost": sum(costs.values())} if any(each > 1 for each in costs.values()) else {}
    return {**{key: names for key, names in found.items() if names}, **said}


def _described(ontology: Ontology, loss: Loss, found: Substitute, error: Optional[Error]) -> Answer:
    output, refused, program = _output(loss).path, {}, None
    try:
        program = generate([(found.derivation, output)], ontology.constants)
    except GenerationError as refusal:
        paths = dict.fromkeys(source.path for source in found.derivation.sources())
        refused = {"refused": str(refusal), "inputs": list(paths)}
    relations = found.derivation.relations()
    answer = _answer(found.quality, relations, found.proven_best, program, [output])
    answer.update(_wishes(_output(loss).service, relations, found.derivation.sources()))
    return {"property": loss.name, **answer, **_erring(loss, error), **refused}


def _erring(loss: Loss, error: Optional[Error]) -> Answer:
    """Return an expected error, and why it is too large to be used, if it is."""
    why = refusal(error, loss.limit)
    return {"error": described(error), **({"not_used": why} if why else {})}


def _explanation(asked: Asked, loss: Loss) -> Answer:
    """Return the best derivation line by line, alternatives, and what dead branches lack.

    Alternatives differ in their relations or sources; where in the tree these stand is left out.
    """
    distinct: Dict[Any, Found] = {}
    for found, error in islice(_ranked(asked, loss), LOOKED_AT):
        key = found.derivation.relations(), frozenset(found.derivation.sources())
        distinct.setdefault(key, (found, error))
    best, others = [*distinct.values()][:1], [*distinct.values()][1:]
    return {
        "fusion": _fusion(asked, loss),
        "derivation": [
            line for each, _ in best for line in islice(_tree(each.derivation), MOST_LINES)
        ],
        "alternatives": [
            {
                "quality": each.quality,
                "relations": list(each.derivation.relations()),
                "inputs": [source.path for source in each.derivation.sources()],
                **_erring(loss, error),
                **_wishes(
                    _output(loss).service,
                    each.derivation.relations(),
                    each.derivation.sources(),
                ),
            }
            for each, error in others[:ALTERNATIVES]
        ],
        "more_alternatives": max(len(others) - ALTERNATIVES, 0),
        "dead": [dead._asdict() for dead in dead_branches(asked.ontology, loss)],
    }


def _fusion(asked: Asked, loss: Loss) -> str:
    """Return which derivations are fused, or why none are."""
    if asked.measured is None:
        return "none: it takes errors at the same moments, of a running robot (--live)"
    fusions = asked.predictor.fusions if asked.predictor else ()
    found = [each.function for each in fusions if each.function.output == loss.name]
    if found:
        return f"{found[0].relation} errs clearly less than each part: {found[0].text}"
    return "none: no sum of what is calibrated has erred 5 % less than the best part of it"


def _tree(derivation: Derivation) -> Iterator[str]:
    """Yield a line for each property of a derivation, indented by its depth."""
    stack = [(derivation, 0)]
    while stack:
        part, depth = stack.pop()
        if part.source is not None:
            by = f"measured by {part.source.node} at {part.source.path}"
            quality, error = part.source.quality, part.source.provision.error
            cost = part.source.service.cost
        else:
            assert part.function is not None
            by = f"{part.function.relation}: {part.function.text}"
            quality, error, cost = part.function.quality, part.function.error, 1
        figure = "" if error is None else f", error {error.rms:g}"
        figure += f", cost {cost}" if cost > 1 else ""
        yield f"{'  ' * depth}{part.property}  {by}  (quality {quality:g}{figure})"
        stack.extend((input_, depth + 1) for input_ in reversed(part.inputs))
