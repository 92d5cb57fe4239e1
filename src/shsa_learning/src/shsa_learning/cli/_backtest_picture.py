"""The picture of a backtest: real against predicted errors, the ranking, and the best in time."""
from typing import Any, List, Sequence

import numpy as np
from matplotlib.figure import Figure

from shsa_core.model.ontology import Ontology
from shsa_learning.backtest.backtest import Backtest, Ranking, Trial
from shsa_learning.backtest.scores import MINUTE_S

MOST_PROPERTIES = 12
MOST_BARS = 10
MEASURED, BEST, CHOSEN, OTHER = "black", "tab:green", "tab:orange", "tab:blue"


def draw(backtest: Backtest, rankings: Sequence[Ranking], ontology: Ontology, path: str) -> None:
    """Draw a row for each property, the first ones; raises OSError if it cannot be written."""
    rankings = rankings[:MOST_PROPERTIES]
    figure = Figure(figsize=(15, 0.4 + 3.4 * len(rankings)))
    grid = figure.add_gridspec(
        len(rankings), 3, width_ratios=(1, 1, 2), hspace=0.55, wspace=0.35, left=0.06, right=0.99
    )
    for row, each in enumerate(rankings):
        prop = ontology.properties.get(each.target.property)
        unit = f", {prop.unit}" if prop is not None and prop.unit else ""
        _against(figure.add_subplot(grid[row, 0]), each, unit)
        _ranking(figure.add_subplot(grid[row, 1]), each, unit)
        _strip(figure.add_subplot(grid[row, 2]), backtest, each, unit)
    figure.savefig(path, dpi=110, bbox_inches="tight")


def _colour(ranking: Ranking, trial: Trial) -> str:
    if trial is ranking.best:
        return BEST
    return CHOSEN if trial is ranking.chosen else OTHER


def _scored(ranking: Ranking) -> List[Trial]:
    return [trial for trial in ranking.trials if trial.score is not None]


def _against(axes: Any, ranking: Ranking, unit: str) -> None:
    """Predicted and real errors; where none is predicted, what the quality promises."""
    all_ = [ranking.baseline] if ranking.baseline > 0.0 else []
    special = ranking.best, ranking.chosen
    for trial in sorted(_scored(ranking), key=lambda each: each in special):  # these on top
        assert trial.score is not None
        real, promised = trial.score.error.rms, (1.0 - trial.quality) * ranking.baseline
        expected = promised if trial.predicted is None else trial.predicted.rms
        all_ += [each for each in (real, expected) if each > 0.0]
        style = "none" if trial.predicted is None else "full"
        axes.plot(expected, real, "o", color=_colour(ranking, trial), markersize=5, fillstyle=style)
    axes.set_xscale("log")
    axes.set_yscale("log")
    low, high = (0.5 * min(all_), 2.0 * max(all_)) if all_ else (0.1, 10.0)
    axes.plot([low, high], [low, high], color="grey", linewidth=0.8)
    axes.set_xlim(low, high)
    axes.set_ylim(low, high)
    axes.axhline(ranking.baseline, color="grey", linestyle=":", linewidth=0.8)
    axes.set_xlabel(f"predicted error{unit} (hollow: by quality)", fontsize="small")
    axes.set_ylabel(f"real error{unit}", fontsize="small")
    axes.set_title(ranking.target.property, fontsize="medium")
    axes.tick_params(labelsize="small", which="both")


def _ranking(axes: Any, ranking: Ranking, unit: str) -> None:
    """Draw the best derivations, and the one that healing takes."""
    shown = _scored(ranking)[:MOST_BARS]
    chosen = ranking.chosen
    if chosen is not None and chosen.score is not None and chosen not in shown:
        shown[-1] = chosen
    worst = 0.0
    for place, trial in enumerate(reversed(shown)):
        assert trial.score is not None
        worst = max(worst, trial.score.charged)
        axes.barh(place, trial.score.charged, color=_colour(ranking, trial), alpha=0.6)
        name = ", ".join(trial.relations) or "passed on"
        rank = ranking.trials.index(trial) + 1
        axes.text(0.0, place, f" {rank}. {name[:40]}", va="center", fontsize="x-small")
    axes.axvline(ranking.baseline, color="grey", linestyle=":", linewidth=0.8)
    axes.set_xlim(0.0, 1.05 * min(max(worst, ranking.baseline), 2.0 * ranking.baseline) or 1.0)
    axes.locator_params(axis="x", nbins=5)
    axes.set_yticks([])
    axes.set_xlabel(f"real error{unit} (dotted: the mean)", fontsize="small")
    axes.set_title("ranking; green: best, orange: chosen", fontsize="medium")
    axes.tick_params(labelsize="small")


def _strip(axes: Any, backtest: Backtest, ranking: Ranking, unit: str) -> None:
    """Draw the worst minute of the best derivation, beside the chosen one and what was measured."""
    best, chosen = ranking.best, ranking.chosen
    assert best is not None and best.score is not None and chosen is not None
    worst = best.score.worst
    drawn = [(best, "best", BEST)]
    if chosen is not best:
        drawn.insert(0, (chosen, "chosen", CHOSEN))
    for trial, name, colour in drawn:
        part = backtest.replay(ranking.target, trial)[worst.recording]
        since = part.time - part.time[0]
        shown = (since >= worst.begin) & (since <= worst.begin + MINUTE_S)
        axes.plot(since[shown], part.values[shown], color=colour, linewidth=1.0, label=name)
    known = shown & np.isfinite(part.measured)
    axes.plot(since[known], part.measured[known], color=MEASURED, linewidth=0.7, label="measured")
    axes.set_xlabel("s", fontsize="small")
    axes.set_ylabel(f"{ranking.target.property}{unit}", fontsize="small")
    axes.set_title("the worst minute of the best", fontsize="medium")
    axes.legend(fontsize="x-small", loc="upper right")
    axes.tick_params(labelsize="small")
