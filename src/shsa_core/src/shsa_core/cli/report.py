"""`shsa report`: how resilient a robot is."""
import argparse
import json
from dataclasses import asdict
from typing import Any, List, Optional, Tuple

from shsa_core.analysis.report import Report, Suggestion, Survival, ServiceReport
from shsa_core.analysis.resilience import analyse
from shsa_core.cli._files import add_options, read_models
from shsa_core.cli._output import say, whole_number
from shsa_core.cli._tables import Table, show
from shsa_core.model.error import Error


def add_parser(subparsers: Any) -> None:
    """Add the command."""
    parser = subparsers.add_parser(
        "report",
        help="say how resilient a robot is",
        description="Says what replaces each needed service, what the loss of each node costs, "
        "which nodes must not fail, alone or together, and what would help most.",
    )
    add_options(parser)
    parser.add_argument(
        "--size",
        type=whole_number(1),
        default=2,
        metavar="N",
        help="how many nodes may fail together (2); more takes longer",
    )
    parser.add_argument("--json", action="store_true", help="print one JSON document")
    parser.add_argument("--html", metavar="FILE", help="write one page that needs nothing else")


def run(args: argparse.Namespace) -> int:
    """Print the report, and write the page. Returns 0."""
    ontology, som = read_models(args)
    report = analyse(ontology, som, args.size)
    if args.html:
        from shsa_core.cli._page import page  # a template engine that only this option needs

        with open(args.html, "w", encoding="utf-8") as stream:
            stream.write(page(ontology, som, summary(report), tables(report)))
    if args.json:
        print(json.dumps(asdict(report), indent=2))
        return 0
    for table in tables(report):
        show(table)
    for line in summary(report):
        say(line)
    return 0


def summary(report: Report) -> List[str]:
    """The report in a few sentences."""
    lost = [each for each in report.services if each.quality is None]
    count = len(report.services)
    lines = [
        f"{count - len(lost)} of {count} needed services can be replaced when their node fails.",
        f"Failures of one {_kind(report)} survived: {_share(report.survival.single)}; of two "
        f"{_kind(report)}s at once: {_share(report.survival.double)}.",
    ]
    for kind, suggestion in (("sensor", report.sensor), ("relation", report.relation)):
        lines.append(_suggestion(kind, suggestion, kind in report.exact))
    lines += [f"{late}." for late in report.late]
    return lines + [f"{why[0].upper()}{why[1:]}." for why in report.unfit]


def _kind(report: Report) -> str:
    """What fails: a node, or a cause where services fail with more than nodes."""
    return "node" if all(each.node.startswith("/") for each in report.nodes) else "cause"


def _suggestion(kind: str, suggestion: Optional[Suggestion], exact: bool) -> str:
    if suggestion is None:
        which = f"No single new {kind}" if exact else f"No new {kind} that was looked at"
        return f"{which} would raise that."
    what = f"of {suggestion.property} on a node of its own"
    if suggestion.source is not None:
        what = f"that yields {suggestion.property} from {suggestion.source}, if there is one"
    which = f"The new {kind} that would raise it most" if exact else f"A new {kind} that would help"
    return f"{which}: one {what}, to {_survival(suggestion.survival)}."


def _survival(survival: Survival) -> str:
    if survival.double is None:
        return _share(survival.single)
    return f"{_share(survival.single)} and {_share(survival.double)}"


def _share(share: Optional[float]) -> str:
    return "not worked out" if share is None else f"{100 * share:.1f} %"


def tables(report: Report) -> List[Table]:
    """The report as tables."""
    return [
        Table(
            "Needed services",
            (
                "service",
                "topic",
                "node",
                "quality",
                "alternatives, best first",
                "fatal with it",
            ),
            [_service(each) for each in report.services],
            "The SOM marks no service as needed.",
        ),
        Table(
            "What the loss of a node costs",
            ("node", "lost", "replaced (quality)", "best substitute lost of"),
            [
                (
                    node.node,
                    ", ".join(node.lost),
                    ", ".join(f"{service} ({quality:.3g})" for service, quality in node.healed),
                    ", ".join(node.leaned_on),
                )
                for node in report.nodes
            ],
            "The SOM has no nodes.",
        ),
        Table(
            "Single points of failure",
            ("node", "services lost"),
            [(c.nodes[0], ", ".join(c.services)) for c in report.cuts if len(c.nodes) == 1],
            "No node alone is fatal.",
        ),
        Table(
            "Nodes that must not fail together",
            ("nodes", "services lost"),
            [(" + ".join(c.nodes), ", ".join(c.services)) for c in report.cuts if len(c.nodes) > 1],
            "No such nodes.",
        ),
    ]


def _service(service: ServiceReport) -> Tuple[str, ...]:
    several = len(service.properties) > 1
    alternatives = [
        f"{a.property + ' ' if several else ''}by {a.by} ({a.quality:.3g}{_error(a.error)})"
        for a in service.alternatives
    ]
    if service.refused:
        alternatives.append(service.refused)
    elif service.quality is None:
        lacking = ", ".join(service.missing) or "any relation that yields it"
        alternatives.append(f"missing: {lacking}")
    cuts = [cut for cut in service.cuts if len(cut) > 1]
    others = (" + ".join(n for n in cut if n != service.node) for cut in cuts)
    return (
        service.service,
        service.topic,
        service.node,
        "lost" if service.quality is None else _rated(service),
        "\n".join(alternatives),
        "\n".join(others),
    )


def _rated(service: ServiceReport) -> str:
    """The quality of a service's substitute, and its error, of each value a line."""
    lines = [
        f"{name if len(service.properties) > 1 else ''}{_error(error)}".lstrip(", ")
        for name, error in zip(service.properties, service.errors)
        if error is not None
    ]
    return "\n".join([f"{service.quality:.3g}", *lines])


def _error(error: Optional[Error]) -> str:
    return "" if error is None else f", error {error.rms:.3g}"
