"""The pictures of an incident, as SVG: its moments, and its substitute beside the original."""
import io
from typing import Any, Optional, Sequence, Tuple

import numpy as np
from matplotlib import rc_context
from matplotlib.figure import Figure

from shsa_learning.incident_log import MOMENTS
from shsa_core.healing.incident import Incident
from shsa_learning.explain.bag import Values
from shsa_learning.explain.truth import Truth
from shsa_learning.explain.words import STEPS

ORIGINAL, COMPUTED, PUBLISHED, OUTAGE = "#1f5fa8", "#999999", "#d1592a", "#f4d7cc"
FIRST = MOMENTS[: MOMENTS.index("returned")]
"""The moments that lie close together."""
MOST_POINTS = 4000
"""Of a line: more are thinned out."""
AROUND_S = 20.0
"""Of the recording that is drawn before an incident and after it."""


def timeline(incident: Incident) -> str:
    """Draw the eight moments: all of them, and those of the takeover in large."""
    moments = [(name, getattr(incident, name)) for name in MOMENTS]
    known = [(name, moment) for name, moment in moments if moment is not None]
    close = [(name, moment) for name, moment in known if name in FIRST]
    figure = Figure(figsize=(10, 0.9 + 0.28 * (len(known) + len(close))))
    heights = [max(len(known), 1), max(len(close), 1)]
    grid = figure.add_gridspec(2, 1, height_ratios=heights, hspace=0.55)
    begin = min(moment for _, moment in known)
    _steps(figure.add_subplot(grid[0]), known, begin, 1.0, "s after the first moment")
    _steps(figure.add_subplot(grid[1]), close, begin, 1000.0, "the takeover, in ms")
    return _svg(figure)


def comparison(
    incident: Incident, truth: Truth, published: Optional[Values], unit: str, now: float
) -> str:
    """Draw what the original measured, what the program yields, and what was published.

    `now`: when the recording ends, in s.
    """
    figure = Figure(figsize=(10, 4))
    axes = figure.add_subplot(1, 1, 1)
    begin = incident.last_good or incident.detected
    end = incident.returned or incident.ended or now
    played = truth.played
    shown = (played.time >= begin - AROUND_S) & (played.time <= end + AROUND_S)
    time = played.time[shown] - begin
    _line(axes, time, played.values[shown], COMPUTED, "what its program yields")
    _line(axes, time, played.measured[shown], ORIGINAL, "the original")
    if published:
        moments, values = np.array(published).T
        near = moments <= end + AROUND_S
        _line(axes, moments[near] - begin, values[near], PUBLISHED, "what the substitute published")
    if incident.first_message is not None:
        axes.axvspan(0.0, incident.first_message - begin, color=OUTAGE, lw=0, label="outage")
    axes.set_xlabel("s after the last good message")
    axes.set_ylabel(f"{truth.property} / {unit}" if unit else truth.property)
    axes.legend(loc="upper right", fontsize="small")
    return _svg(figure)


def _steps(
    axes: Any, moments: Sequence[Tuple[str, float]], begin: float, factor: float, label: str
) -> None:
    places = range(len(moments), 0, -1)
    times = [factor * (moment - begin) for _, moment in moments]
    axes.hlines(places, 0.0, times, color="#cccccc", lw=1)
    axes.plot(times, list(places), "o", color=PUBLISHED, markersize=5)
    for place, at in zip(places, times):
        axes.annotate(f"{at:.3g}", (at, place), (6, -3), textcoords="offset points", fontsize=8)
    axes.set_yticks(list(places))
    axes.set_yticklabels([STEPS[name] for name, _ in moments], fontsize=8)
    axes.set_ylim(0.4, len(moments) + 0.6)
    axes.set_xlim(min([0.0, *times]), 1.12 * max([*times, 1e-3]))
    axes.set_xlabel(label, fontsize=8)
    axes.tick_params(axis="x", labelsize=8)
    for side in ("top", "right"):
        axes.spines[side].set_visible(False)


def _line(axes: Any, time: Any, values: Any, colour: str, label: str) -> None:
    every = max(1, len(time) // MOST_POINTS)
    axes.plot(time[::every], values[::every], color=colour, lw=1, label=label)


def _svg(figure: Figure) -> str:
    """Return the picture as a part of a page: without the XML declaration, the same each time."""
    stream = io.StringIO()
    with rc_context({"svg.hashsalt": "shsa", "svg.fonttype": "path"}):
        figure.savefig(stream, format="svg", bbox_inches="tight", metadata={"Date": None})
    text = stream.getvalue()
    return text[text.index("<svg") :]
