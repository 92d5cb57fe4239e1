"""`shsa report`: the resilience of a robot."""
import argparse
import json
import textwrap
from dataclasses import asdict
from pathlib import Path
from typing import Any, List, Optional, Sequence

from shsa_core.cli._common import say
from shsa_core.model.error import Error
from shsa_core.model.ontology import Ontology
from shsa_core.model.som import Som
from shsa_learning.cli._common import (
    Table,
    WIDEST,
    add_models,
    read_models,
    render,
    show,
    whole_number,
)
from shsa_learning.cli.plot import CannotDraw, draw
from shsa_learning.report.report import NodeReport, Report, ServiceReport, Suggestion, Survival
from shsa_learning.report.resilience import analyse

TEMPLATE = Path(__file__).resolve().parent / "templates" / "report.html"


def add_parser(subparsers: Any) -> None:
    """Add the command."""
    parser = subparsers.add_parser(
        "report",
        help="say how resilient a robot is",
        description="Says what replaces each needed service, what the loss of each node costs, "
        "which nodes must not fail, alone or together, and what would help most.",
    )
    add_models(parser)
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
        Path(args.html).write_text(_page(ontology, som, report), encoding="utf-8")
    if args.json:
        print(json.dumps(asdict(report), indent=2))
        return 0
    for table in tables(report):
        show(table)
    for line in summary(report):
        say(textwrap.fill(line, WIDEST, break_long_words=False, break_on_hyphens=False))
    return 0


def _page(ontology: Ontology, som: Som, report: Report) -> str:
    """Return the report as one HTML page that needs nothing else, with the graph as SVG."""
    svg, not_drawn = "", ""
    try:
        svg = draw(ontology, som.sources, "svg").decode()
    except CannotDraw as error:
        not_drawn = str(error)
    return render(
        TEMPLATE,
        summary=summary(report),
        tables=tables(report),
        svg=svg[svg.index("<svg") :] if svg else "",  # without the XML declaration
        not_drawn=not_drawn,
    )


def summary(report: Report) -> List[str]:
    """Return the report in a few sentences."""
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
    """Return the report as tables."""
    alone = [cut for cut in report.cuts if len(cut.nodes) == 1]
    together = [cut for cut in report.cuts if len(cut.nodes) > 1]
    return [
        Table(
            "Needed services",
            ("service, topic, node", "quality", "alternatives, best first", "fatal with it"),
            [_service(each) for each in report.services],
            "The SOM needs no service.",
        ),
        Table(
            "What the loss of a node costs",
            ("node", "lost", "replaced (quality)", "best substitute lost of"),
            [_node(each) for each in report.nodes],
            "The SOM has no nodes.",
        ),
        Table(
            "Single points of failure",
            ("node", "services lost"),
            [(cut.nodes[0], ", ".join(cut.services)) for cut in alone],
            "No node alone is fatal.",
        ),
        Table(
            "Nodes that must not fail together",
            ("nodes", "services lost"),
            [(" + ".join(cut.nodes), ", ".join(cut.services)) for cut in together],
            "No such nodes.",
        ),
    ]


def _node(node: NodeReport) -> Sequence[str]:
    healed = ", ".join(f"{service} ({quality:.3g})" for service, quality in node.healed)
    return node.node, ", ".join(node.lost), healed, ", ".join(node.leaned_on)


def _service(service: ServiceReport) -> Sequence[str]:
    several = len(service.properties) > 1
    alternatives = [
        f"{a.property + ' ' if several else ''}by {a.by} ({a.quality:.3g}{_error(a.error)})"
        for a in service.alternatives
    ]
    quality = "lost"
    if service.refused:
        alternatives.append(service.refused)
    elif service.quality is None:
        lacking = ", ".join(service.missing) or "any relation that yields it"
        alternatives.append(f"missing: {lacking}")
    if service.quality is not None:
        errors = [
            f"{name if several else ''}{_error(error)}".lstrip(", ")
            for name, error in zip(service.properties, service.errors)
            if error is not None
        ]
        quality = "\n".join([f"{service.quality:.3g}", *errors])
    cuts = [cut for cut in service.cuts if len(cut) > 1]
    others = [" + ".join(name for name in cut if name != service.node) for cut in cuts]
    named = "\n".join((service.service, service.topic, service.node))
    return named, quality, "\n".join(alternatives), "\n".join(others)


def _error(error: Optional[Error]) -> str:
    return "" if error is None else f", error {error.rms:.3g}"
