"""A learned relation as one HTML page that needs nothing else"""
import base64
import io
import re
from pathlib import Path
from typing import List, Mapping, Sequence, Tuple

import numpy as np
from matplotlib.figure import Figure

from shsa_learning.cli._common import render
from shsa_learning.figures import rms
from shsa_learning.learn.learner import Learned

MEASURED, SAID, OTHER = "#1f5fa8", "#d1592a", "#999999"
LONGEST = 400
"""Characters of a function that a person reads."""
_NUMBER = re.compile(r"\d+\.\d{4,}(e[+-]?\d+)?")
_RANGE = re.compile(r"(\S+) < (\w+) < (\S+)")


def page(learned: Learned, outliers: Mapping[str, int], notes: Sequence[str]) -> str:
    """Return the page: the function, its error, where it holds, what was left out, and pictures.

    `outliers`: how many were left out, by property; `notes`: what else was done to the data.
    """
    model = learned.model
    function = _NUMBER.sub(
        lambda found: f"{float(found.group()):.4g}", model.function if model else ""
    )
    return render(
        Path(__file__).resolve().parent / "templates" / "learn.html",
        property=learned.target,
        accepted=learned.accepted,
        reasons=learned.reasons,
        model=model.name if model else "",
        function=function,
        short=len(function) <= LONGEST,
        figures=_figures(learned),
        terms=_terms(learned),
        ranges=_RANGE.findall(model.constraint) if model else (),
        left_out=sorted(learned.left_out.items()),
        skipped=learned.skipped,
        outliers=sorted(outliers.items()),
        notes=notes,
        pictures=_pictures(learned),
    )


def digits_of(value: float, error: float) -> str:
    """Return a value with its standard error, both with the digits that the error bears."""
    if not 0.0 < error < np.inf:
        return f"{value:.4g}"
    places = 1 - int(np.floor(np.log10(error)))
    if places > 6 or places < 0:
        return f"{value:.4g} ± {error:.2g}"
    return f"{value:.{places}f} ± {error:.{places}f}"


def _terms(learned: Learned) -> List[Tuple[str, str, str]]:
    """Return the terms, their coefficients, and the error without each, in parts of that of all."""
    assert learned.error is not None or learned.model is None
    return [
        (
            part.term,
            digits_of(part.coefficient, part.standard_error),
            f"{1.0 + part.gain / learned.error.rms:.2f} times" if learned.error else "",
        )
        for part in (learned.model.parts if learned.model else ())
    ]


def _figures(learned: Learned) -> List[Tuple[str, str]]:
    error, span = learned.error, learned.span
    if error is None or error.baseline is None or error.p95 is None:
        return []

    def told(value: float) -> str:
        return f"{value:.3g} ({100.0 * value / span:.2f} % of the range)"

    return [
        (f"RMS error on {learned.blocks} blocks that it had not seen", told(error.rms)),
        ("of its worst block", told(learned.worst)),
        ("of who always says the mean", told(error.baseline)),
        ("95 % of the errors are within", told(error.p95)),
        ("bias", f"{error.bias:.2g}"),
        ("it lags by", f"{error.delay:.2g} s"),
    ]


def _pictures(learned: Learned) -> List[Tuple[str, str]]:
    if learned.validation is None or learned.model is None:
        return []
    pictures = [
        ("Measured, and predicted without having seen it", _over_time(learned)),
        ("Residuals by block of time", _blocks(learned)),
    ]
    if learned.model.parts:
        pictures.append(("What each term gains", _gains(learned)))
    return [(title, _png(made)) for title, made in [*pictures, ("All models", _ladder(learned))]]


def _over_time(learned: Learned) -> Figure:
    columns, validation = learned.columns, learned.validation
    assert columns is not None and validation is not None
    figure = Figure(figsize=(11, 4))
    axes = figure.add_subplot(1, 1, 1)
    rows = np.arange(len(columns.target))  # recordings follow one another without the time between
    axes.plot(rows, columns.target, color=MEASURED, lw=1, label="measured")
    axes.plot(rows, validation.predicted, color=SAID, lw=1, label="predicted")
    edges = np.flatnonzero(np.diff(validation.block))
    for edge in edges:
        axes.axvline(edge + 0.5, color=OTHER, lw=0.8, ls=":")
    ticks = np.linspace(0, len(rows) - 1, 7).astype(int)
    axes.set_xticks(ticks)
    axes.set_xticklabels([f"{columns.time[tick] - columns.time[0]:.0f}" for tick in ticks])
    axes.set_xlabel("time in s; dotted: ends of blocks")
    axes.set_ylabel(learned.target)
    axes.legend(loc="upper right")
    return figure


def _blocks(learned: Learned) -> Figure:
    columns, validation = learned.columns, learned.validation
    assert columns is not None and validation is not None
    off = validation.predicted - columns.target
    numbers = np.unique(validation.block)
    parts = [off[(validation.block == number) & np.isfinite(off)] for number in numbers]
    figure = Figure(figsize=(8, 3))
    axes = figure.add_subplot(1, 1, 1)
    axes.boxplot(parts, positions=numbers + 1, whis=(5, 95), showfliers=False)
    axes.axhline(0.0, color=OTHER, lw=0.8)
    names = [choice.recipe.named(learned.ladder) for choice in validation.choices]
    axes.set_xticks(numbers + 1)
    axes.set_xticklabels(
        [f"{n + 1}\n{name}\nRMS {rms(part):.2g}" for n, name, part in zip(numbers, names, parts)]
    )
    axes.set_ylabel("predicted - measured")
    return figure


def _gains(learned: Learned) -> Figure:
    assert learned.model is not None and learned.error is not None
    parts = learned.model.parts[::-1]
    figure = Figure(figsize=(8, 1 + 0.4 * len(parts)))
    axes = figure.add_subplot(1, 1, 1)
    axes.barh(range(len(parts)), [part.gain for part in parts], color=SAID)
    axes.set_yticks(range(len(parts)))
    axes.set_yticklabels([_cut(part.term) for part in parts])
    axes.set_xlabel("RMS error that is added without it")
    return figure


def _ladder(learned: Learned) -> Figure:
    assert learned.model is not None
    rungs = [rung for rung in learned.model.choice.rungs if np.isfinite(rung.rms)]
    figure = Figure(figsize=(8, 1 + 0.3 * len(rungs)))
    axes = figure.add_subplot(1, 1, 1)
    chosen = learned.model.choice.recipe
    axes.barh(
        range(len(rungs)),
        [rung.rms for rung in rungs],
        xerr=[rung.standard_error for rung in rungs],
        color=[SAID if rung.recipe == chosen else OTHER for rung in rungs],
    )
    axes.set_yticks(range(len(rungs)))
    axes.set_yticklabels([rung.recipe.named(learned.ladder) for rung in rungs])
    axes.invert_yaxis()
    axes.set_xlabel("RMS error on blocks, and the standard error of its distance from the best")
    return figure


def _cut(text: str) -> str:
    return text if len(text) <= 40 else f"{text[:25]} ... {text[-12:]}"


def _png(figure: Figure) -> str:
    """Return a picture as text that a page can hold."""
    figure.tight_layout()
    stream = io.BytesIO()
    figure.savefig(stream, format="png", dpi=80)
    return base64.b64encode(stream.getvalue()).decode("ascii")
