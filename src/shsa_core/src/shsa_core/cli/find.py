"""`shsa find`: what would replace a property."""
import argparse
import json
from itertools import islice
from typing import Any, Dict, FrozenSet, Iterator, Tuple

from shsa_core.analysis.loss import Loss, dead_branches, lose
from shsa_core.cli._files import add_options, check_property, read_models, warn_of_unknown
from shsa_core.codegen.generator import generate
from shsa_core.errors import GenerationError, NoSubstitute
from shsa_core.healing.plans import METHODS, plan_fields
from shsa_core.model.ontology import Ontology
from shsa_core.model.som import Service
from shsa_core.search.derivation import Derivation, ServiceTable
from shsa_core.search.substitutes import Substitute, iter_substitutes

Answer = Dict[str, Any]
ALTERNATIVES = 100  # that an explanation looks at
MOST_LINES = 200  # of a derivation that an explanation has


def add_parser(subparsers: Any) -> None:
    """Adds the command."""
    parser = subparsers.add_parser(
        "find",
        help="say what would replace a property",
        description="Says what would replace a property if the node that provides it failed. "
        "Every service in the SOM counts as available, save those of that node.",
    )
    parser.add_argument("property", metavar="PROPERTY", help="the lost property")
    add_options(parser)
    parser.add_argument(
        "--without",
        metavar="NODE|TOPIC",
        action="append",
        default=[],
        help="do without this node or topic as well; may be given several times",
    )
    parser.add_argument(
        "--method",
        choices=[*METHODS, "all"],
        default="best",
        help="best (default); orr: the first found, depth first; all: every one, best first",
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
    """Prints what would replace the property. Returns 0 if something does, else 1."""
    ontology, som = read_models(args)
    check_property(args.property, ontology, som)
    warn_of_unknown(args.without, som)
    loss = lose(som, args.property, args.without)
    if args.method == "all":
        answer = _all(ontology, loss, args.limit)
    else:
        answer = _one(ontology, loss, args.method)
    if args.explain:
        answer.update(_explanation(ontology, loss))
    print(json.dumps(answer, indent=2) if args.json else "\n".join(_text(answer)))
    return 1 if "substitute" in answer else 0


def _one(ontology: Ontology, loss: Loss, method: str) -> Answer:
    services = ServiceTable(ontology.network, loss.available)
    try:
        plan = plan_fields(ontology, services, "", [(loss.name, loss.output)], method)
    except NoSubstitute as none:
        return {"property": loss.name, "substitute": None, "missing": list(none.missing)}
    except GenerationError as error:
        return {"property": loss.name, "substitute": None, "missing": [], "refused": str(error)}
    return {
        "property": loss.name,
        "quality": plan.quality,
        "relations": list(plan.relations),
        "proven_best": plan.proven_best,
        "inputs": list(plan.program.inputs),
        "code": plan.program.code,
        "output": loss.output,
    }


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
    described: Answer = {
        "property": loss.name,
        "quality": substitute.quality,
        "relations": list(derivation.relations()),
        "proven_best": substitute.proven_best,
        "inputs": list(dict.fromkeys(service.path for service in derivation.services())),
        "code": None,
        "output": loss.output,
    }
    try:
        program = generate([(derivation, loss.output)], ontology.constants)
    except GenerationError as error:
        described["refused"] = str(error)
    else:
        described.update(inputs=list(program.inputs), code=program.code)
    return described


def _explanation(ontology: Ontology, loss: Loss) -> Answer:
    """The best derivation line by line, the alternatives, and what the dead branches lack."""
    # By relations and services: where in the tree these stand is left out.
    alternatives: Dict[Tuple[Tuple[str, ...], FrozenSet[Service]], Substitute] = {}
    for each in islice(iter_substitutes(ontology, loss.available, loss.name), ALTERNATIVES):
        services = each.derivation.services()
        alternatives.setdefault((each.derivation.relations(), frozenset(services)), each)
    found = list(alternatives.values())
    return {
        "derivation": list(islice(_tree(found[0].derivation), MOST_LINES)) if found else [],
        "alternatives": [
            {
                "quality": each.quality,
                "relations": list(each.derivation.relations()),
                "inputs": [service.path for service in each.derivation.services()],
            }
            for each in found[1:]
        ],
        "dead": [dead._asdict() for dead in dead_branches(ontology, loss)],
    }


def _tree(derivation: Derivation) -> Iterator[str]:
    """The derivation, one line for each property, indented by its depth."""
    stack = [(derivation, 0)]
    while stack:
        node, depth = stack.pop()
        if node.service is not None:
            by = f"measured by {node.service.node} at {node.service.path}"
            quality = node.service.quality
        else:
            assert node.function is not None
            by = f"{node.function.relation}: {node.function.text}"
            quality = node.function.quality
        yield f"{'  ' * depth}{node.property}  {by}  (quality {quality:g})"
        stack.extend((part, depth + 1) for part in reversed(node.inputs))


def _text(answer: Answer) -> Iterator[str]:
    """The answer in words, line by line."""
    name = answer["property"]
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
