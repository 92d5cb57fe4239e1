"""The trials of a scoreboard, and what follows from them."""
import json
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any, Callable, Dict, Iterable, Iterator, List, Sequence, Tuple

import numpy as np
from scipy.stats import beta

CONFIDENCE = 0.95
Figures = Dict[str, float]


@dataclass(frozen=True)
class Trial:
    """One trial of a line: whether it held, what was measured, and why not if it did not."""

    line: int
    seed: int
    held: bool
    figures: Figures = field(default_factory=dict)
    why: str = ""


@dataclass(frozen=True)
class Mark:
    """A figure whose p95 over all trials must not be above a limit."""

    figure: str
    limit: float
    unit: str


@dataclass(frozen=True)
class Line:
    """A line of the scoreboard: the fault, what must hold, and how it is tried.

    `trials` makes the trials of seeds, one by one, on a graph; `full` and `short` are how many;
    none in the short form where `make test` has a test of the same.
    `so_far` says how far the line can be proven on one machine, where it cannot be in full.
    """

    number: int
    fault: str
    must_hold: str
    trials: Callable[[Any, Sequence[int]], Iterator[Trial]]
    full: int
    short: int
    marks: Tuple[Mark, ...] = ()
    so_far: str = ""


@dataclass(frozen=True)
class Verdict:
    """A line of trials: how many held, and the largest share that fails (95 % certain)."""

    line: int
    fault: str
    must_hold: str
    trials: int
    held: int
    fails_at_most: float
    figures: Dict[str, Tuple[float, float, float]]
    missed: Tuple[str, ...]
    so_far: str

    @property
    def good(self) -> bool:
        """True if every trial held, and no figure is above its mark."""
        return self.trials > 0 and self.held == self.trials and not self.missed


def fails_at_most(trials: int, failed: int) -> float:
    """Return the upper bound of the share that fails: Clopper and Pearson (1934), one-sided."""
    if failed >= trials:
        return 1.0
    return float(beta.ppf(CONFIDENCE, failed + 1, trials - failed))


def judge(line: Line, trials: Sequence[Trial], marks: bool = True) -> Verdict:
    """Return the verdict of a line's trials; figures are median, p95 and largest.

    `marks`: whether they count; those of a few trials on a busy machine say little.
    """
    mine = [each for each in trials if each.line == line.number]
    names = sorted({name for each in mine for name in each.figures})
    figures = {}
    for name in names:
        values = [each.figures[name] for each in mine if name in each.figures]
        p50, p95 = (float(np.percentile(values, share)) for share in (50, 95))
        figures[name] = (p50, p95, float(max(values)))
    missed = tuple(
        f"{mark.figure}: p95 {figures[mark.figure][1]:.3g} {mark.unit}, mark {mark.limit:g}"
        for mark in line.marks
        if marks and mark.figure in figures and figures[mark.figure][1] > mark.limit
    )
    held = sum(each.held for each in mine)
    bound = fails_at_most(len(mine), len(mine) - held)
    return Verdict(
        *(line.number, line.fault, line.must_hold, len(mine), held, bound, figures, missed),
        so_far=line.so_far,
    )


class Record:
    """The trials made so far, one JSON line each: a run goes on where the last one ended."""

    def __init__(self, path: Path) -> None:
        self._path = path
        self.trials: List[Trial] = []
        if path.exists():
            self.trials = [Trial(**json.loads(line)) for line in path.read_text().splitlines()]

    def missing(self, line: int, seeds: Iterable[int]) -> List[int]:
        """Return those of a line's seeds that were not tried yet."""
        known = {each.seed for each in self.trials if each.line == line}
        return [seed for seed in seeds if seed not in known]

    def add(self, trial: Trial) -> None:
        """Keep a trial."""
        self.trials.append(trial)
        with open(self._path, "a") as file:
            file.write(json.dumps(asdict(trial)) + "\n")
