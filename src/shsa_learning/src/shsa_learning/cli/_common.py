"""Options, tables and pages of the commands."""
import argparse
import re
import shutil
import textwrap
from pathlib import Path
from typing import Callable, Iterable, List, NamedTuple, Sequence, Tuple

import jinja2
from tabulate import tabulate

from shsa_core import message_types
from shsa_core.cli._common import say
from shsa_core.errors import ModelError
from shsa_core.files.ontology_file import read_ontology
from shsa_core.files.som_file import read_som
from shsa_core.model.conventions import with_unknowns
from shsa_core.model.ontology import Ontology
from shsa_core.model.som import Som
from shsa_core.text import LONGEST_LINE, nearest, shown
from shsa_learning.cli._namespace import add_namespace
from shsa_learning.type_check import available

NARROWEST_COLUMN = 12
WIDEST = 100
"""Characters of a table's line."""
"""Characters."""


def add_models(parser: argparse.ArgumentParser) -> None:
    """Add --ontology, --som and --namespace."""
    parser.add_argument("--ontology", metavar="FILE", required=True, help="the ontology")
    parser.add_argument(
        "--som", metavar="FILE", required=True, help="the service-to-ontology mapping"
    )
    add_namespace(parser)


def add_without(parser: argparse.ArgumentParser) -> None:
    """Add --without."""
    parser.add_argument(
        "--without",
        metavar="NAME",
        action="append",
        default=[],
        help="do without this node, topic, service, host or common cause (fails_with) as well; "
        "may be given several times",
    )


def read_models(args: argparse.Namespace) -> Tuple[Ontology, Som]:
    """Read the files of the options, the SOM with what messages can say. Raises ModelError."""
    ontology, som = read_ontology(args.ontology), read_som(args.som, args.namespace)
    return ontology, with_unknowns(som, message_types.layout) if available() else som


def check_property(name: str, ontology: Ontology, som: Som) -> None:
    """Raise ModelError, with the nearest names, if no model has a property of this name."""
    check_known(
        name, "property", {*ontology.properties, *(source.property for source in som.sources)}
    )


def check_known(name: str, kind: str, known: Iterable[str]) -> None:
    """Raise ModelError, with the nearest names, if a name is not known."""
    if name not in known:
        raise ModelError(name, f"no such {kind}{_nearest(name, known)}")


def without(args: argparse.Namespace, som: Som) -> List[str]:
    """Return what --without names, as the SOM names it; warn of what is not in the SOM."""
    known = {name for source in som.sources for name in source.names}
    names = [som.known_name(name, args.namespace) for name in args.without]
    for name in names:
        if name not in known:
            text = f"no service in the SOM has the node or topic {name}{_nearest(name, known)}"
            say(f"shsa: {text}", error=True)
    return names


def _nearest(name: str, known: Iterable[str]) -> str:
    return nearest(name, known, 3) or f"; known are {', '.join(sorted(known))}"


def whole_number(least: int) -> Callable[[str], int]:
    """Return a type for argparse: a whole number of at least `least`."""

    def read(text: str) -> int:
        if not re.fullmatch("[0-9]{1,9}", text) or int(text) < least:
            raise argparse.ArgumentTypeError(f"{text!a} is no whole number from {least} on")
        return int(text)

    return read


class Table(NamedTuple):
    """A title, the names of the columns, and rows of text; `nothing` stands for no rows."""

    title: str
    columns: Sequence[str]
    rows: Sequence[Sequence[str]]
    nothing: str


def show(table: Table) -> None:
    """Print a table no wider than the terminal and WIDEST: its widest cells are folded."""
    if not table.rows:
        say(f"{table.title}: {table.nothing}\n")
        return
    lines = [table.columns, *table.rows]
    widths = [max(len(line) for cell in each for line in cell.split("\n")) for each in zip(*lines)]
    width = min(WIDEST, shutil.get_terminal_size((WIDEST, 24)).columns)
    room = width - 5 * len(widths) - 1  # a heading is padded by two
    while sum(widths) > room and max(widths) > NARROWEST_COLUMN:
        widths[widths.index(max(widths))] -= 1
    columns, *rows = [[_fold(cell, width) for cell, width in zip(each, widths)] for each in lines]
    say(table.title)
    say(tabulate(rows, columns, tablefmt="grid", disable_numparse=True) + "\n")


def _fold(cell: str, width: int) -> str:
    lines = (textwrap.wrap(line, max(width, 1)) for line in cell.split("\n"))
    return "\n".join(line for part in lines for line in part)


def render(template: Path, **values: object) -> str:
    """Return the page that a template of jinja2 makes of some values, with text escaped."""

    def printable(value: object) -> object:
        if type(value) is not str:
            return value  # the drawing among them, which is markup
        return "\n".join(shown(line, LONGEST_LINE) for line in value.split("\n"))

    environment = jinja2.Environment(
        loader=jinja2.FileSystemLoader(str(template.parent)),
        autoescape=True,
        undefined=jinja2.StrictUndefined,
        finalize=printable,
        trim_blocks=True,
        keep_trailing_newline=True,
    )
    return environment.get_template(template.name).render(**values)
