"""Tables for people: cells are folded where the terminal is too narrow."""
import shutil
import textwrap
from typing import List, NamedTuple, Sequence

from tabulate import tabulate

from shsa_core.cli._output import say

MIN_WIDTH = 12  # of a column, in characters


class Table(NamedTuple):
    """A title, the names of the columns, and rows of text; `nothing` stands for no rows."""

    title: str
    columns: Sequence[str]
    rows: Sequence[Sequence[str]]
    nothing: str


def show(table: Table) -> None:
    """Print a table, as wide as the terminal."""
    if not table.rows:
        say(f"{table.title}: {table.nothing}\n")
        return
    widths = _widths([table.columns, *table.rows], shutil.get_terminal_size((120, 24)).columns)
    rows = [[_fold(cell, width) for cell, width in zip(row, widths)] for row in table.rows]
    columns = [_fold(column, width) for column, width in zip(table.columns, widths)]
    say(table.title)
    say(tabulate(rows, columns, tablefmt="grid", disable_numparse=True) + "\n")


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
