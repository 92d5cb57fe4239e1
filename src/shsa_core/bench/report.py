"""What every benchmark says at its end: a table of p50, p95 and max, and its goals with their verdicts."""
import csv
import sys
from pathlib import Path
from typing import List, Sequence, Tuple

import matplotlib
import numpy as np
from rich.console import Console
from rich.table import Table

matplotlib.use("Agg")

CONSOLE = Console(width=None if sys.stdout.isatty() else 120)
COLUMNS = ("goal", "consumer", "at most", "measured", "verdict")


def summary(values: Sequence[float]) -> Tuple[float, float, float]:
    """Median, 95th percentile and maximum; not a number if there are no values."""
    if len(values) == 0:
        return (float("nan"),) * 3
    return float(np.median(values)), float(np.percentile(values, 95)), float(max(values))


def in_words(values: Sequence[float], digits: int = 1) -> str:
    """`median / p95 / max`."""
    return " / ".join(f"{value:.{digits}f}" for value in summary(values))


class Goals:
    """The goals of a benchmark, and whether they are met."""

    def __init__(self) -> None:
        self.rows: List[Tuple[str, ...]] = []

    def at_most(self, goal: str, consumer: str, limit: float, measured: float, unit: str) -> None:
        """A figure that must not be above a limit."""
        verdict = "met" if measured <= limit else "not met"
        figures = (f"{limit:.3g} {unit}", f"{measured:.3g} {unit}")
        self.rows.append((goal, consumer, *figures, verdict))

    def show(self, path: Path) -> None:
        """Print the goals, and write them to a CSV file."""
        CONSOLE.print(goals_table(self.rows))
        with open(path, "w", newline="") as file:
            csv.writer(file).writerows([COLUMNS, *self.rows])


def goals_table(rows: Sequence[Sequence[str]]) -> Table:
    """The goals as a table."""
    table = Table(*COLUMNS, title="Goals")
    colours = {"met": "green", "not met": "red"}
    for *words, verdict in rows:
        table.add_row(*words, f"[{colours[verdict]}]{verdict}[/]")
    return table
