"""What every benchmark says at its end: tables, and its goals with their verdicts."""
import csv
from pathlib import Path
from typing import Iterable, List, Sequence, Tuple

import matplotlib
import numpy as np
from tabulate import tabulate

matplotlib.use("Agg")

COLUMNS = ("goal", "consumer", "at most", "measured", "verdict")


def summary(values: Sequence[float]) -> Tuple[float, float, float]:
    """Median, 95th percentile and maximum; not a number if there are no values."""
    if len(values) == 0:
        return (float("nan"),) * 3
    return float(np.median(values)), float(np.percentile(values, 95)), float(max(values))


def in_words(values: Sequence[float], digits: int = 1) -> str:
    """`median / p95 / max`."""
    return " / ".join(f"{value:.{digits}f}" for value in summary(values))


def print_table(title: str, columns: Sequence[str], rows: Iterable[Sequence[str]]) -> None:
    """Print a table; the first column is of words, the others of figures."""
    align = ["left"] + ["right"] * (len(columns) - 1)
    text = tabulate(list(rows), columns, disable_numparse=True, colalign=align)
    print(f"\n{title}\n{text}\n", flush=True)


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
        print_table("Goals", COLUMNS, self.rows)
        with open(path, "w", newline="") as file:
            csv.writer(file).writerows([COLUMNS, *self.rows])
