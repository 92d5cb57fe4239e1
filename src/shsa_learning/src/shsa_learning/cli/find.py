"""`shsa find`: the substitute of a property, a service, or all services of a topic or a node."""
import argparse
import json
import os
from typing import Any, Iterator, List, Optional, Sequence, Tuple

from shsa_core.cli._common import say
from shsa_core.codegen.prediction import predictor
from shsa_core.errors import ShsaError, listed
from shsa_core.planning.planner import Calibrations
from shsa_core.model.kinds import Method
from shsa_core.model.names import full_name
from shsa_core.model.ontology import Ontology
from shsa_core.model.service import Service
from shsa_core.model.som import Som
from shsa_learning.cli._answers import Answer, Asked, of_property, of_service
from shsa_learning.cli._common import add_models, add_without, check_known, read_models
from shsa_learning.cli._common import whole_number, without
from shsa_learning.loss import lose


def add_parser(subparsers: Any) -> None:
    """Add the command."""
    parser = subparsers.add_parser(
        "find",
        usage="%(prog)s (NAME | --topic NAME) --ontology FILE --som FILE [option ...]",
        help="say what would replace a property, a service, a topic or a node",
        description="All services count as available, save those of the node that provides it. A "
        "service is healed with all of its values, or with some if its message says of the rest "
        "that it is unknown.",
    )
    lost = parser.add_mutually_exclusive_group(required=True)
    lost.add_argument("name", metavar="NAME", nargs="?", help="property, service, topic or node")
    lost.add_argument("--topic", metavar="NAME", help="the topic, where a property has its name")
    add_models(parser)
    add_without(parser)
    parser.add_argument(
        "--method",
        choices=[*map(str, Method), "all"],
        default="best",
        help="best (default); depth_first, or orr as the paper calls it: the first found; "
        "all: the best 1000",
    )
    parser.add_argument(
        "--steps",
        metavar="N",
        type=whole_number(1),
        help="a deadline: the best of what is found first and of the N relations nearest to it",
    )
    parser.add_argument(
        "--explain",
        action="store_true",
        help="show the derivation, the alternatives, and what dead branches lack",
    )
    parser.add_argument(
        "--live", action="store_true", help="count what the robot that runs here has measured"
    )
    parser.add_argument("--json", action="store_true", help="print one JSON document")


def run(args: argparse.Namespace) -> int:
    """Print what would replace it. Returns 0 if something does, else 1."""
    ontology, som = read_models(args)
    asked = Asked(
        ontology,
        som,
        tuple(without(args, som)),
        args.method,
        args.explain,
        predictor(ontology, som.sources),
        args.steps,
        _measured(args.namespace) if args.live else None,
    )
    kind, services = _lost(args, ontology, som)
    if services and (args.method == "all" or args.explain):
        option = "--explain" if args.explain else "--method all"
        names = listed(tuple(dict.fromkeys(name for each in services for name in each.properties)))
        raise ShsaError(
            f"{option} needs a property, and {args.topic or args.name} is a {kind}; it has {names}"
        )
    if services:
        answers = [of_service(asked.about(each), each) for each in services]
        named: Answer = {kind: args.topic or args.name, "services": answers}
        answer = answers[0] if kind == "service" else named
        lines = [line for each in answers for line in _text(each)]
    else:
        answer, lines = _property(asked, args.name)
        answers = [answer]
    say(json.dumps(answer, indent=2) if args.json else "\n".join(lines))
    return 1 if any("substitute" in each for each in answers) else 0


def _lost(args: argparse.Namespace, ontology: Ontology, som: Som) -> Tuple[str, Sequence[Service]]:
    """Return the kind of what is named, and its services; none of a property."""
    name, topic = args.name, full_name(args.topic or args.name, args.namespace)
    if name is not None and (name in ontology.properties or som.of_property(name)):
        return "property", ()
    if name in som.services:
        return "service", [som.services[name]]
    known = {*som.topics(), *(each.node for each in som if name is not None)}
    if topic not in known:
        known |= {*ontology.properties, *som.services}
        check_known(name or topic, "property, service, topic or node", known)
    of_node = [each for each in som if each.node == topic]
    return ("topic", som.of_topic(topic)) if som.of_topic(topic) else ("node", of_node)


def _property(asked: Asked, name: str) -> Tuple[Answer, List[str]]:
    """Return the answer for a property, and its text: of each needed service that provides it.

    The answer for programs is that of the first service that cannot be healed, else of the first.
    """
    losses = lose(asked.som, name, asked.without)
    parts: List[Tuple[Service, Answer, Answer]] = []
    for loss in losses:
        if loss.source is None:
            answer = of_property(asked, loss)
            return answer, list(_text(answer))
        service = loss.source.service
        about = asked.about(service)
        whole = of_service(about, service)
        parts.append((service, whole, of_property(about, loss, whole)))
    lines: List[str] = []
    for service, whole, answer in parts:
        if len(parts) > 1:
            lines.append(f"If the service {service.name} of {service.node} fails:")
        lines += _text(answer)
        if len(service.properties) > 1 and "substitute" not in whole:
            lines.append(
                f"The service {service.name} ({service.topic}) is healed with "
                f"{whole['output']}: {_summary(whole)}"
            )
    chosen = next((each for _, _, each in parts if "substitute" in each), parts[0][2])
    if len(parts) > 1:
        several = [{**whole, "value": answer} for _, whole, answer in parts]
        return {**chosen, "services": several}, lines
    if len(parts[0][0].properties) > 1:
        return {**chosen, "services": [parts[0][1]]}, lines
    return chosen, lines


def _measured(namespace: str) -> Calibrations:
    """Return what a running monitor has measured. Raises ShsaError if none is heard."""
    os.environ["ROS_NAMESPACE"] = namespace or "/"  # as rospy takes it
    try:
        from shsa_learning.ros.calibrated import calibrations  # ROS loads slowly
    except ImportError as error:
        raise ShsaError(f"--live needs ROS: source its setup.bash ({error})") from error
    return calibrations()


def _text(answer: Answer) -> Iterator[str]:
    """Yield the answer in words, line by line."""
    name = answer.get("property", "")
    if "service" in answer:
        name = f"the service {answer['service']}"
    if "substitute" in answer and answer.get("refused"):
        yield f"Nothing that can be used replaces {name}: {answer['refused']}"
    elif "substitute" in answer:
        values = answer.get("property") or " and ".join(answer["properties"])
        lacking = ", ".join(answer["missing"]) or f"any relation that yields {values}"
        yield f"Nothing replaces {name}. Missing: {lacking}"
    if "in_the_way" in answer and "properties" in answer:
        yield f"In the way: {', '.join(answer['in_the_way'])}; the other values can be derived"
    if "alone" in answer:
        yield f"{answer['property']} alone could be derived: {_summary(answer['alone'])}"
        yield "But its message cannot say of the service's other values that they are unknown"
    for number, each in enumerate(answer.get("substitutes", []), 1):
        yield f"{number:4}. {_summary(each)}"
    if not answer.get("complete", True):
        yield "and more"
    if "code" in answer:
        yield f"{name}: {_summary(answer)}{', proven best' if answer['proven_best'] else ''}"
        yield f"inputs  {','.join(answer['inputs'])}"
        yield f"output  {answer['output']}"
        yield "code"
        yield from ("    " + line for line in answer["code"].splitlines())
    if "unknown" in answer:
        lacking = ", ".join(answer["missing"]) or "any relation that yields it"
        yield f"Its messages leave {', '.join(answer['unknown'])} unknown. Missing: {lacking}"
    if "starts_at_zero" in answer:
        yield "It has an integral within an expression, which starts at 0: its first value may jump"
    if "shares" in answer:
        yield f"It reads what fails with {', '.join(answer['shares'])} too; nothing else would do"
    if "slow" in answer:
        slow = answer["slow"]
        yield f"It reads {slow['service']}, which comes every {slow['period']:g} s: it repeats"
    if answer.get("derivation"):
        yield "derivation"
        yield from ("    " + line for line in answer["derivation"])
    if "fusion" in answer:
        yield f"fusion  {answer['fusion']}"
    if answer.get("alternatives"):
        yield "alternatives"
        yield from ("    " + _summary(each) for each in answer["alternatives"])
        if answer["more_alternatives"]:
            yield f"    and {answer['more_alternatives']} more; see --method all"
    if answer.get("dead"):
        yield "dead branches"
        for dead in answer["dead"]:
            yield f"    {dead['relation']} for {dead['output']} lacks {', '.join(dead['lacking'])}"


def _summary(each: Answer) -> str:
    by = ", ".join(each["relations"]) or "the same property elsewhere"
    refused = "  (cannot be executed)" if "refused" in each else ""
    refused += f"  (not used: {each['not_used']})" if "not_used" in each else ""
    error = _error(each.get("error"))
    for name, of in each.get("errors", {}).items():
        error += _error(of, f"{name} " if len(each["errors"]) > 1 else "")
    inputs = ", ".join(each["inputs"])
    wishes = (("preferred", "preferred"), ("to_avoid", "to be avoided"))
    wished = "".join(f"  ({word}: {', '.join(each[k])})" for k, word in wishes if k in each)
    error += f", cost {each['cost']}" if "cost" in each else ""
    return f"quality {each['quality']:.4g}{error} by {by} from {inputs}{wished}{refused}"


def _error(error: Optional[Answer], of: str = "") -> str:
    return "" if error is None else f", {of}error {error['rms']:.3g} (95 %: {error['p95']:.3g})"
