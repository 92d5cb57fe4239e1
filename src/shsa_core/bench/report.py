"""Arguments, tables, goals and verdicts of the benchmarks."""
import argparse
import csv
import math
from pathlib import Path
from typing import Iterable, List, Sequence, Tuple

import matplotlib
import numpy as np
from tabulate import tabulate

matplotlib.use("Agg")

COLUMNS = ("goal", "consumer", "at most", "measured", "verdict")


def arguments(told: str, times: str, default: int, short: str, **flags: str) -> argparse.Namespace:
    """Return the arguments of a benchmark that measures rows, each some `times`; makes its folder.

    `short`: what is measured in its short form; `flags`: what it can be told besides, and what for.
    """
    parser = argparse.ArgumentParser(description=told)
    parser.add_argument(f"--{times}", type=int, default=default, help=f"{times} of each row")
    parser.add_argument(
        "--only", nargs="+", default=[""], help="only rows whose name contains one of these"
    )
    parser.add_argument("--short", action="store_true", help=f"{short}, as a check")
    for flag, meaning in flags.items():
        parser.add_argument(f"--{flag}", action="store_true", help=meaning)
    parser.add_argument("--results", type=Path, default=Path("results/bench"))
    options = parser.parse_args()
    options.results.mkdir(parents=True, exist_ok=True)
    return options


def summary(values: Sequence[float]) -> Tuple[float, float, float]:
    """Median, 95th percentile and maximum; not a number if there are no values.

    Values may be infinite.
    """
    if len(values) == 0:
        return (float("nan"),) * 3
    if np.isinf(values).any():  # nothing lies between a number and infinity
        ranked = sorted(values)
        middle, high = (ranked[math.ceil(share * (len(ranked) - 1))] for share in (0.5, 0.95))
        return middle, high, ranked[-1]
    return float(np.median(values)), float(np.percentile(values, 95)), float(max(values))


def in_words(values: Sequence[float], digits: int = 1) -> str:
    """`median / p95 / max`; `never` for what is infinite, once if all is; nothing of nothing."""
    if not len(values) or np.isnan(values).all():
        return ""
    words = [f"{value:.{digits}f}" if value != math.inf else "never" for value in summary(values)]
    return " / ".join(words) if words[0] != "never" else words[0]


def print_table(
    title: str, columns: Sequence[str], rows: Iterable[Sequence[str]], markdown: bool = False
) -> None:
    """Print a table; the first column is of words, the others of figures.

    `markdown`: as the documentation has it.
    """
    lines = list(rows)
    if markdown:
        text = tabulate(lines, columns, disable_numparse=True, tablefmt="github")
    else:
        align = ["left"] + ["right"] * (len(columns) - 1) if lines else None
        text = tabulate(lines, columns, disable_numparse=True, colalign=align)
    print(f"\n{title}\n{chr(10) if markdown else ''}{text}\n", flush=True)


def write_table(path: Path, columns: Sequence[str], rows: Iterable[Sequence[object]]) -> None:
    """Write a table to a CSV file."""
    with open(path, "w", newline="") as file:
        csv.writer(file).writerows([columns, *rows])


class Goals:
    """The goals of a benchmark, and whether they are met."""

    def __init__(self) -> None:
        self.rows: List[Tuple[str, ...]] = []

    def at_most(self, goal: str, of: str, limit: float, measured: float, unit: str) -> None:
        """A figure that must not be above a limit; `of`: what it was measured of."""
        self._add(goal, of, f"{limit:.3g} {unit}", measured, unit, measured <= limit)

    def at_least(self, goal: str, of: str, limit: float, measured: float) -> None:
        """A figure that must not be below a limit."""
        self._add(goal, of, f"at least {limit:.3g}", measured, "", measured >= limit)

    def within(self, goal: str, of: str, limits: Tuple[float, float], measured: float) -> None:
        """A share that must be within limits; all are shown in %."""
        low, high = (100.0 * each for each in limits)
        met = low <= 100.0 * measured <= high
        self._add(goal, of, f"{low:g} to {high:g} %", 100.0 * measured, "%", met)

    def _add(self, goal: str, of: str, limit: str, measured: float, unit: str, met: bool) -> None:
        verdict = "met" if met else "not met"
        self.rows.append((goal, of, limit.strip(), f"{measured:.3g} {unit}".strip(), verdict))

    def show(self, path: Path) -> None:
        """Print the goals, and write them to a CSV file."""
        print_table("Goals", COLUMNS, self.rows)
        write_table(path, COLUMNS, self.rows)
