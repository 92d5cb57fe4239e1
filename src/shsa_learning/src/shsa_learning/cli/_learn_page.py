"""A learned relation as one HTML page that needs nothing else."""
import base64
import io
from pathlib import Path
from typing import List, Sequence, Tuple

import numpy as np
from matplotlib.figure import Figure

from shsa_learning.cli._common import render
from shsa_learning.figures import rms
from shsa_learning.learn.learner import Learned

MEASURED, SAID = "#1f5fa8", "#d1592a"


def page(learned: Learned, summary: Sequence[str]) -> str:
    """Return the page: what is said of it in words, and the pictures, if anything was fitted."""
    pictures: List[Tuple[str, str]] = []
    if learned.validation is not None:
        pictures = [
            ("Measured, and predicted without having seen it", _png(_over_time(learned))),
            ("Predicted by measured", _png(_scatter(learned))),
            ("Blocks of time", _png(_blocks(learned))),
            ("The ladder of models", _png(_ladder(learned))),
        ]
    return render(
        Path(__file__).resolve().parent / "templates" / "learn.html",
        property=learned.target,
        accepted=learned.accepted,
        summary=summary,
        pictures=pictures,
    )


def _over_time(learned: Learned) -> Figure:
    columns, validation = learned.columns, learned.validation
    assert columns is not None and validation is not None
    figure = Figure(figsize=(11, 4))
    axes = figure.add_subplot(1, 1, 1)
    rows = np.arange(len(columns.target))  # recordings follow one another without the time between
    axes.plot(rows, columns.target, color=MEASURED, lw=1, label="measured")
    axes.plot(rows, validation.predicted, color=SAID, lw=1, label="predicted")
    for edge in np.flatnonzero(np.diff(validation.block)):
        axes.axvline(edge + 0.5, color="#999999", lw=0.8, ls=":")
    axes.set_xlabel("row")
    axes.set_ylabel(learned.target)
    axes.legend(loc="upper right")
    return figure


def _scatter(learned: Learned) -> Figure:
    columns, validation = learned.columns, learned.validation
    assert columns is not None and validation is not None
    figure = Figure(figsize=(5, 5))
    axes = figure.add_subplot(1, 1, 1)
    axes.plot(columns.target, validation.predicted, ".", ms=2, color=SAID)
    ends = [float(np.min(columns.target)), float(np.max(columns.target))]
    axes.plot(ends, ends, color="#555555", lw=0.8)
    axes.set_xlabel("measured")
    axes.set_ylabel("predicted")
    return figure


def _blocks(learned: Learned) -> Figure:
    columns, validation = learned.columns, learned.validation
    assert columns is not None and validation is not None
    numbers = np.unique(validation.block)
    figure = Figure(figsize=(8, 3))
    axes = figure.add_subplot(1, 1, 1)
    for values, shift, colour, label in (
        (validation.predicted, -0.2, SAID, "model"),
        (validation.mean, 0.2, "#999999", "mean"),
    ):
        off = values - columns.target
        errors = [rms(off[(validation.block == number) & np.isfinite(off)]) for number in numbers]
        axes.bar(numbers + 1 + shift, errors, 0.4, color=colour, label=label)
    names = [str(choice.recipe) for choice in validation.choices]
    axes.set_xticks(numbers + 1)
    axes.set_xticklabels([f"{number + 1}\n{name}" for number, name in zip(numbers, names)])
    axes.set_ylabel("RMS error")
    axes.legend()
    return figure


def _ladder(learned: Learned) -> Figure:
    assert learned.model is not None
    rungs = [rung for rung in learned.model.choice.rungs if np.isfinite(rung.rms)]
    figure = Figure(figsize=(8, 3))
    axes = figure.add_subplot(1, 1, 1)
    chosen = learned.model.choice.recipe
    axes.bar(
        range(len(rungs)),
        [rung.rms for rung in rungs],
        yerr=[rung.standard_error for rung in rungs],
        color=[SAID if rung.recipe == chosen else "#999999" for rung in rungs],
    )
    axes.set_xticks(range(len(rungs)))
    axes.set_xticklabels([str(rung.recipe) for rung in rungs], rotation=20)
    axes.set_ylabel("RMS error on blocks")
    return figure


def _png(figure: Figure) -> str:
    """Return a picture as text that a page can hold."""
    figure.tight_layout()
    stream = io.BytesIO()
    figure.savefig(stream, format="png", dpi=80)
    return base64.b64encode(stream.getvalue()).decode("ascii")
