"""`shsa report`: how resilient a robot is."""
import argparse
import json
import shutil
import textwrap
from dataclasses import asdict
from typing import Any, List, NamedTuple, Optional, Sequence, Tuple

from tabulate import tabulate

from shsa_core.analysis.report import Report, Suggestion, Survival, ServiceReport
from shsa_core.analysis.resilience import analyse
from shsa_core.cli._files import add_options, read_models
from shsa_core.errors import ModelError

MIN_WIDTH = 12  # of a column, in characters


class Table(NamedTuple):
    """A title, the names of the columns, and rows of text; `nothing` stands for no rows."""

    title: str
    columns: Sequence[str]
    rows: Sequence[Sequence[str]]
    nothing: str


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
        type=int,
        default=2,
        metavar="N",
        help="how many nodes may fail together (2); more takes longer",
    )
    parser.add_argument("--json", action="store_true", help="print one JSON document")
    parser.add_argument("--html", metavar="FILE", help="write one page that needs nothing else")


def run(args: argparse.Namespace) -> int:
    """Print the report, and write the page. Returns 0."""
    if args.size < 1:
        raise ModelError("--size", f"{args.size} nodes cannot fail; at least 1")
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
        _print(table)
    for line in summary(report):
        print(line)
    return 0


def summary(report: Report) -> List[str]:
    """The report in a few sentences."""
    lost = [each for each in report.services if each.quality is None]
    count = len(report.services)
    lines = [
        f"{count - len(lost)} of {count} needed services can be replaced when their node fails.",
        f"Failures of one node survived: {_share(report.survival.single)}; of two nodes at once: "
        f"{_share(report.survival.double)}.",
    ]
    for kind, suggestion in (("sensor", report.sensor), ("relation", report.relation)):
        lines.append(_suggestion(kind, suggestion))
    return lines


def _suggestion(kind: str, suggestion: Optional[Suggestion]) -> str:
    if suggestion is None:
        return f"No single new {kind} would raise that."
    what = f"of {suggestion.property} on a node of its own"
    if suggestion.source is not None:
        what = f"that yields {suggestion.property} from {suggestion.source}, if there is one"
    return (
        f"The new {kind} that would raise it most: one {what}, to {_survival(suggestion.survival)}."
    )


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
            ("service", "topic", "node", "quality", "alternatives, best first", "fatal with it"),
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
        f"{a.property + ' ' if several else ''}by {a.by} ({a.quality:.3g})"
        for a in service.alternatives
    ]
    if service.quality is None:
        lacking = ", ".join(service.missing) or "any relation that yields it"
        alternatives.append(f"missing: {lacking}")
    cuts = [cut for cut in service.cuts if len(cut) > 1]
    others = (" + ".join(n for n in cut if n != service.node) for cut in cuts)
    return (
        service.service,
        service.topic,
        service.node,
        "lost" if service.quality is None else f"{service.quality:.3g}",
        "\n".join(alternatives),
        "\n".join(others),
    )


def _print(table: Table) -> None:
    if not table.rows:
        print(f"{table.title}: {table.nothing}\n")
        return
    widths = _widths([table.columns, *table.rows], shutil.get_terminal_size((120, 24)).columns)
    rows = [[_fold(cell, width) for cell, width in zip(row, widths)] for row in table.rows]
    columns = [_fold(column, width) for column, width in zip(table.columns, widths)]
    print(table.title)
    print(tabulate(rows, columns, tablefmt="grid", disable_numparse=True), end="\n\n")


def _widths(rows: Sequence[Sequence[str]], room: int) -> List[int]:
    """How wide each column may be, in characters: the widest ones give way."""
    widths = [
        max(len(line) for cell in column for line in cell.split("\n")) for column in zip(*rows)
    ]
    while sum(widths) + 3 * len(widths) + 1 > room and max(widths) > MIN_WIDTH:
        widths[widths.index(max(widths))] -= 1
    return widths


def _fold(cell: str, width: int) -> str:
    """The lines of a cell, none longer than its column is wide."""
    lines = (textwrap.wrap(line, max(width, 1)) for line in cell.split("\n"))
    return "\n".join(line for part in lines for line in part)
