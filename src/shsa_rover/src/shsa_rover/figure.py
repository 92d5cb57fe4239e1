"""The demonstration's figure: the current, the reconfiguration, and the paper's Fig. 10 beneath."""
from pathlib import Path
from typing import Dict, List, Tuple

import matplotlib

matplotlib.use("Agg")

import matplotlib.pyplot as plt  # noqa: E402
from matplotlib.axes import Axes  # noqa: E402

from shsa_rover.recording import Recording, Series, last_error, unhealed  # noqa: E402

SENSOR, SUBSTITUTE, TRUTH, UNHEALED = "#1f5fa8", "#d1592a", "#9a9a9a", "#3d8f4a"
STEPS = (
    ("last_good", "last good message"),
    ("detected", "failure detected"),
    ("killed", "faulty node gone"),
    ("found", "substitute found"),
    ("spawned", "substitute set to work"),
    ("first_message", "first message of the substitute"),
)


def draw(recording: Recording, file: Path) -> None:
    """Draw one run into `file` (PNG)."""
    figure, (current, events, soc) = plt.subplots(
        3, 1, figsize=(11, 10), gridspec_kw={"height_ratios": [3, 2.2, 1.6]}
    )
    _draw_current(current, recording)
    _draw_events(events, recording)
    _draw_soc(soc, recording)
    end = max((t for t, _ in recording.true_current), default=1.0)
    for axes in (current, soc):
        axes.set_xlim(0, end)
        for start, stop in outages(recording):
            axes.axvspan(start, stop, color="#d1592a", alpha=0.25, lw=0)
    figure.tight_layout()
    figure.savefig(str(file), dpi=120)
    plt.close(figure)


def outages(recording: Recording) -> List[Tuple[float, float]]:
    """Return the times without a message, from the last good one to the substitute's first."""
    spans = []
    for incident in recording.incidents:
        start, stop = incident["last_good"], incident["first_message"]
        if isinstance(start, float) and isinstance(stop, float):
            spans.append((start, stop))
    return spans


def substituted(recording: Recording) -> List[Tuple[float, float]]:
    """Return the times at which a substitute published."""
    nodes = [series for node, series in recording.current.items() if node.startswith("/substitute")]
    return [(part[0][0], part[-1][0]) for series in nodes for part in unbroken(series)]


def _draw_current(axes: Axes, recording: Recording) -> None:
    axes.set_title("The amperemeter dies, a generated substitute takes over, the original returns")
    axes.set_ylabel("battery current / A")
    _line(axes, recording.true_current, TRUTH, "simulated truth", 1.0)
    shown: Dict[str, str] = {}
    for node, series in recording.current.items():
        substitute = node.startswith("/substitute")
        label = f"substitute ({node})" if substitute else f"sensor ({node})"
        colour = SUBSTITUTE if substitute else SENSOR
        for part in unbroken(series):
            _line(axes, part, colour, "" if label in shown else label, 1.6)
            shown[label] = colour
    axes.set_xlabel("time / s")
    axes.grid(alpha=0.3)
    axes.legend(loc="upper right", fontsize=9)


def _draw_events(axes: Axes, recording: Recording) -> None:
    axes.set_xlabel("time since the last good message / ms")
    axes.grid(alpha=0.3)
    axes.set_yticks([])
    if not recording.incidents:
        return
    incident = recording.incidents[0]
    known = [(incident.get(name), text) for name, text in STEPS]
    moments = sorted((t, text) for t, text in known if isinstance(t, float))
    origin = moments[0][0]
    for row, (moment, text) in enumerate(moments):
        passed = 1000 * (moment - origin)
        colour = SUBSTITUTE if text.startswith("first message") else SENSOR
        axes.plot([passed, passed], [-0.6, row], color=colour, lw=1)
        axes.plot([passed], [row], "o", color=colour)
        label = f"{text}, {passed:.0f} ms"
        axes.annotate(label, (passed, row), xytext=(7, -3), textcoords="offset points", fontsize=9)
    axes.set_ylim(-0.6, len(moments) - 0.4)
    axes.set_xlim(-0.04 * passed, 1.5 * passed)
    axes.set_title(f"Reconfiguration: what happened in these {passed:.0f} ms", fontsize=10)


def _draw_soc(axes: Axes, recording: Recording) -> None:
    axes.set_title(
        "What the estimator makes of it, and would have made of it (Fig. 10)", fontsize=10
    )
    axes.set_ylabel("state of charge / %")
    axes.set_xlabel("time / s")
    _line(axes, _percent(recording.true_soc), TRUTH, "simulated truth", 1.0)
    curves = [("with healing", recording.soc, SENSOR, 1.4)]
    failed = recording.incidents[0]["faulty_node"] if recording.incidents else ""
    curves.append(("without healing", unhealed(recording, str(failed)), UNHEALED, 1.4))
    for name, series, colour, width in curves:
        error = 100.0 * last_error(series, recording.true_soc)
        _line(axes, _percent(series), colour, f"{name}: {error:+.3f} points at the end", width)
    for start, stop in substituted(recording):
        axes.axvspan(
            start, stop, color=SUBSTITUTE, alpha=0.08, lw=0, label="the substitute publishes"
        )
    axes.grid(alpha=0.3)
    axes.legend(loc="lower left", fontsize=9)


def _percent(series: Series) -> Series:
    return [(time, 100.0 * value) for time, value in series]


def _line(axes: Axes, series: Series, colour: str, label: str, width: float) -> None:
    times, values = [t for t, _ in series], [v for _, v in series]
    axes.plot(times, values, color=colour, lw=width, label=label or None)


def unbroken(series: Series) -> List[Series]:
    """Cut a series where more than 0.3 s lie between two values."""
    parts: List[Series] = []
    for point in series:
        if not parts or point[0] - parts[-1][-1][0] > 0.3:
            parts.append([])
        parts[-1].append(point)
    return parts
