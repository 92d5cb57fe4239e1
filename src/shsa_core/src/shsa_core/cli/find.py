"""`shsa find`: what would replace a property, or a topic."""
import argparse
import json
from itertools import islice
from typing import Any, Dict, FrozenSet, Iterator, List, Sequence, Tuple

from shsa_core.analysis.loss import Loss, dead_branches, lose
from shsa_core.cli._files import (
    add_options,
    add_without,
    check_property,
    read_models,
    services_of,
    warn_of_unknown,
)
from shsa_core.codegen.generator import generate
from shsa_core.codegen.plans import METHODS, plan_service, plan_sources
from shsa_core.errors import GenerationError, ModelError, NoSubstitute
from shsa_core.model.ontology import Ontology
from shsa_core.model.service import Provision, Service, Source
from shsa_core.model.som import Som
from shsa_core.search.derivation import Derivation, SourceTable
from shsa_core.search.substitutes import Substitute, iter_substitutes

Answer = Dict[str, Any]
ALTERNATIVES = 100  # that an explanation looks at
MOST_LINES = 200  # of a derivation that an explanation has


def add_parser(subparsers: Any) -> None:
    """Add the command."""
    parser = subparsers.add_parser(
        "find",
        help="say what would replace a property or a topic",
        description="Says what would replace a property, or all values of a topic, if the node "
        "that provides it failed. Every service in the SOM counts as available, save those of "
        "that node.",
    )
    lost = parser.add_mutually_exclusive_group(required=True)
    lost.add_argument("property", metavar="PROPERTY", nargs="?", help="the lost property")
    lost.add_argument("--topic", metavar="TOPIC", help="the lost topic")
    add_options(parser)
    add_without(parser)
    parser.add_argument(
        "--method",
        choices=[*METHODS, "all"],
        default="best",
        help="best (default); depth_first, or orr as the paper calls it: the first found; "
        "all: every one, best first",
    )
    parser.add_argument(
        "--limit", type=int, default=1000, metavar="N", help="with all: stop after N (1000)"
    )
    parser.add_argument(
        "--explain",
        action="store_true",
        help="show the derivation, the alternatives, and what dead branches lack",
    )
    parser.add_argument("--json", action="store_true", help="print one JSON document")


def run(args: argparse.Namespace) -> int:
    """Print what would replace it. Returns 0 if something does, else 1."""
    ontology, som = read_models(args)
    warn_of_unknown(args.without, som)
    if args.topic is not None:
        if args.method == "all" or args.explain:
            raise ModelError("--topic", "all and --explain are for a property")
        services = services_of(args.topic, som)
        answers = [_of_service(ontology, som, each, args) for each in services]
        answer: Answer = {"topic": args.topic, "services": answers}
    else:
        check_property(args.property, ontology, som)
        answer = _of_property(ontology, lose(som, args.property, args.without), args)
        answers = [answer]
    lines = (line for each in answers for line in _text(each))
    print(json.dumps(answer, indent=2) if args.json else "\n".join(lines))
    return 1 if any("substitute" in each for each in answers) else 0


def _of_property(ontology: Ontology, loss: Loss, args: argparse.Namespace) -> Answer:
    if args.method == "all":
        answer = _all(ontology, loss, args.limit)
    else:
        answer = _one(ontology, loss, args.method)
    if args.explain:
        answer.update(_explanation(ontology, loss))
    return answer


def _of_service(ontology: Ontology, som: Som, service: Service, args: argparse.Namespace) -> Answer:
    """What would take a whole service over."""
    answer: Answer = {"service": service.name, "properties": list(service.properties)}
    table = SourceTable(ontology.network, som.sources)
    try:
        plan = plan_service(ontology, service, table, [service.node, *args.without], args.method)
    except (NoSubstitute, GenerationError) as error:
        return {**answer, **_refusal(error)}
    outputs = [source.path for source in plan.outputs]
    return {
        **answer,
        **_answer(plan.quality, plan.relations, plan.proven_best, plan.program, outputs),
    }


def _one(ontology: Ontology, loss: Loss, method: str) -> Answer:
    """What replaces the lost property."""
    table = SourceTable(ontology.network, loss.available)
    output = loss.lost[0] if loss.lost else _new_source(loss.name)
    try:
        plan = plan_sources(ontology, output.service.name, [output], table, method)
    except (NoSubstitute, GenerationError) as error:
        return {"property": loss.name, **_refusal(error)}
    found = _answer(plan.quality, plan.relations, plan.proven_best, plan.program, [output.path])
    return {"property": loss.name, **found}


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


def _all(ontology: Ontology, loss: Loss, limit: int) -> Answer:
    found = iter_substitutes(ontology, loss.available, loss.name)
    substitutes = [_described(ontology, loss, each) for each in islice(found, limit)]
    answer: Answer = {"property": loss.name, "substitutes": substitutes}
    answer["complete"] = next(found, None) is None
    if not substitutes:
        answer.update(_one(ontology, loss, "best"))
    return answer


def _described(ontology: Ontology, loss: Loss, substitute: Substitute) -> Answer:
    derivation = substitute.derivation
    output = (loss.lost[0] if loss.lost else _new_source(loss.name)).path
    refused: Answer = {}
    program = None
    try:
        program = generate([(derivation, output)], ontology.constants)
    except GenerationError as error:
        refused = {"refused": str(error), "inputs": _paths(derivation)}
    relations = derivation.relations()
    answer = _answer(substitute.quality, relations, substitute.proven_best, program, [output])
    return {"property": loss.name, **answer, **refused}


def _paths(derivation: Derivation) -> List[str]:
    return list(dict.fromkeys(source.path for source in derivation.sources()))


def _explanation(ontology: Ontology, loss: Loss) -> Answer:
    """The best derivation line by line, the alternatives, and what the dead branches lack."""
    # By relations and sources: where in the tree these stand is left out.
    alternatives: Dict[Tuple[Tuple[str, ...], FrozenSet[Source]], Substitute] = {}
    for each in islice(iter_substitutes(ontology, loss.available, loss.name), ALTERNATIVES):
        key = each.derivation.relations(), frozenset(each.derivation.sources())
        alternatives.setdefault(key, each)
    found = list(alternatives.values())
    return {
        "derivation": list(islice(_tree(found[0].derivation), MOST_LINES)) if found else [],
        "alternatives": [
            {
                "quality": each.quality,
                "relations": list(each.derivation.relations()),
                "inputs": [source.path for source in each.derivation.sources()],
            }
            for each in found[1:]
        ],
        "dead": [dead._asdict() for dead in dead_branches(ontology, loss)],
    }


def _tree(derivation: Derivation) -> Iterator[str]:
    """The derivation, one line for each property, indented by its depth."""
    stack = [(derivation, 0)]
    while stack:
        part, depth = stack.pop()
        if part.source is not None:
            by = f"measured by {part.source.node} at {part.source.path}"
            quality = part.source.quality
        else:
            assert part.function is not None
            by = f"{part.function.relation}: {part.function.text}"
            quality = part.function.quality
        yield f"{'  ' * depth}{part.property}  {by}  (quality {quality:g})"
        stack.extend((input_, depth + 1) for input_ in reversed(part.inputs))


def _text(answer: Answer) -> Iterator[str]:
    """The answer in words, line by line."""
    name = answer.get("property") or f"the service {answer['service']}"
    if answer.get("refused"):
        yield f"Nothing that can be executed replaces {name}: {answer['refused']}"
    elif "substitute" in answer:
        lacking = ", ".join(answer["missing"]) or f"any relation that yields {name}"
        yield f"Nothing replaces {name}. Missing: {lacking}"
    for number, each in enumerate(answer.get("substitutes", []), 1):
        yield f"{number:4}. {_summary(each)}"
    if not answer.get("complete", True):
        yield "and more; see --limit"
    if "code" in answer:
        yield f"{name}: {_summary(answer)}{', proven best' if answer['proven_best'] else ''}"
        yield f"inputs  {','.join(answer['inputs'])}"
        yield f"output  {answer['output']}"
        yield "code"
        yield from ("    " + line for line in answer["code"].splitlines())
    if answer.get("derivation"):
        yield "derivation"
        yield from ("    " + line for line in answer["derivation"])
    if answer.get("alternatives"):
        yield "alternatives"
        yield from ("    " + _summary(each) for each in answer["alternatives"])
    if answer.get("dead"):
        yield "dead branches"
        for dead in answer["dead"]:
            yield f"    {dead['relation']} for {dead['output']} lacks {', '.join(dead['lacking'])}"


def _summary(each: Answer) -> str:
    by = ", ".join(each["relations"]) or "the same property elsewhere"
    refused = "  (cannot be executed)" if "refused" in each else ""
    return f"quality {each['quality']:.4g} by {by} from {', '.join(each['inputs'])}{refused}"
