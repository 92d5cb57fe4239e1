"""Options, tables and pages of the commands."""
import argparse
import re
import shutil
import textwrap
from pathlib import Path
from typing import Callable, NamedTuple, Sequence

import jinja2
from tabulate import tabulate

from shsa_core.cli._common import say
from shsa_core.text import LONGEST_LINE, shown

NARROWEST_COLUMN = 12
WIDEST = 100
"""Characters of a table's line."""
"""Characters."""


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
