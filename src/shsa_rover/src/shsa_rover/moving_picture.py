"""A moving picture of the demonstration: an SVG that needs nothing else, drawn from a real run."""
import argparse
import math
import sys
from dataclasses import dataclass
from pathlib import Path
from typing import Dict, List, Optional

import jinja2

from shsa_core.errors import ShsaError
from shsa_core.text import shown
from shsa_rover.figure import unbroken
from shsa_rover.recording import CURRENT, Recording, Series, read_recording

TEMPLATES = Path(__file__).resolve().parent / "templates"
LOOP_S = 13.0  # how long the picture runs before it begins anew
STAYS = 85.0  # % of the loop after which all is heard, and stays to be looked at
BEFORE_S, AFTER_S = 6.0, 4.0  # of the run, before the failure and after its end
LONGEST_NAME = 34  # characters that fit into the picture


class NoPicture(ShsaError):
    """A run has nothing to show."""


@dataclass(frozen=True)
class Tick:
    """A line of the scale: where it is, and what it says."""

    at: float
    text: str


@dataclass(frozen=True)
class Curve:
    """A line or a mark: `kind` is truth, sensor or substitute."""

    kind: str
    path: str


@dataclass(frozen=True)
class Mark:
    """A moment in the plot."""

    kind: str
    at: float
    text: str


@dataclass(frozen=True)
class Plot:
    """From times in s and currents in A to places in the picture."""

    start: float
    end: float
    low: float
    high: float
    left: float = 56.0
    right: float = 556.0
    top: float = 90.0
    bottom: float = 340.0

    @property
    def width(self) -> float:
        return self.right - self.left

    @property
    def times(self) -> List[Tick]:
        """A tick each 5 s."""
        first = math.ceil(self.start / 5.0)
        seconds = [5 * k for k in range(first, math.floor(self.end / 5.0) + 1)]
        return [Tick(self.across(s), str(s)) for s in seconds]

    @property
    def values(self) -> List[Tick]:
        """A tick each 2 A."""
        values = range(math.ceil(self.low), math.floor(self.high) + 1)
        return [Tick(self.up(value), str(value)) for value in values if value % 2 == 0]

    def across(self, time: float) -> float:
        share = (time - self.start) / (self.end - self.start)
        return round(self.left + share * self.width, 1)

    def up(self, value: float) -> float:
        share = (value - self.low) / (self.high - self.low)
        return round(self.bottom - share * (self.bottom - self.top), 1)

    def path(self, series: Series) -> str:
        """Return the line through a series."""
        return "M" + " ".join(f"{self.across(t)},{self.up(v)}" for t, v in series)

    def percent(self, time: float) -> float:
        """Return the part of the loop, in %, at which a time of the run is reached."""
        return round(STAYS * (time - self.start) / (self.end - self.start), 3)


def main(arguments: Optional[List[str]] = None) -> int:
    """Draw a run of the demonstration; 0 if that was done, 1 if there was nothing to show."""
    parser = argparse.ArgumentParser(description="Draw a run of the demonstration as moving SVG.")
    parser.add_argument("--results", type=Path, default=Path("results/demo"), help="folder")
    parser.add_argument("--output", type=Path, default=Path("demo.svg"), help="the image")
    args = parser.parse_args(arguments)
    files = args.results / "run.bag", args.results / "incidents.jsonl"
    try:
        for file in files:
            if not file.is_file():
                raise NoPicture(f"{file}: there is no such file; `make demo` makes it")
        picture = moving_picture(read_recording(*files))
    except ShsaError as error:
        print(f"moving_picture: {error}", file=sys.stderr)
        return 1
    args.output.write_text(picture, encoding="utf-8")
    print(f"{args.output}: {len(picture) // 1000} kB")
    return 0


def moving_picture(recording: Recording) -> str:
    """Return a run as SVG. Raises NoPicture if no failure of it was healed and ended."""
    incident = _healed(recording)
    dies, speaks, returns, ended = (
        float(str(incident[name])) for name in ("last_good", "first_message", "returned", "ended")
    )
    plot = _plot(recording, dies - BEFORE_S, ended + AFTER_S)
    inputs: List[str] = list(incident["inputs"])  # type: ignore[call-overload]
    relations: List[str] = list(incident["relations"])  # type: ignore[call-overload]
    return _template().render(
        well="The amperemeter measures the battery's current. A muted substitute is ready.",
        lost="The amperemeter is dead",
        healed=f"{1000 * (speaks - dies):.0f} ms later a substitute publishes on its topic"
        f"{_expected(incident)}.",
        back=f"The amperemeter is back after {returns - dies:.0f} s. "
        "It publishes, and the substitute has gone.",
        loop=LOOP_S,
        stays=STAYS,
        dies=plot.percent(dies),
        returns=plot.percent(returns),
        speed=f"{(plot.end - plot.start) / (LOOP_S * STAYS / 100.0):.1f}",
        plot=plot,
        curves=_curves(recording, plot),
        marks=[
            Mark("substitute", plot.across(dies), "it dies"),
            Mark("sensor", plot.across(returns), "it is back"),
        ],
        inputs=[_short(name) for name in inputs],
        relation=_short(", ".join(relations) or "the same value"),
        topic=CURRENT,
    )


def _healed(recording: Recording) -> Dict[str, object]:
    moments = ("last_good", "first_message", "returned", "ended")
    for incident in recording.incidents:
        if all(isinstance(incident.get(name), float) for name in moments):
            return incident
    raise NoPicture("no failure of this run was healed and ended with the original's return")


def _plot(recording: Recording, start: float, end: float) -> Plot:
    heard = [point for series in recording.current.values() for point in series]
    last = max((time for time, _ in heard), default=0.0)
    values = [value for time, value in heard if start <= time <= end]
    if not values:
        raise NoPicture(f"no message of {CURRENT} was recorded around the failure")
    low = math.floor(min(0.0, *values))  # a scale that begins elsewhere makes changes look larger
    return Plot(max(0.0, start), min(last, end), low, math.ceil(max(values)))


def _curves(recording: Recording, plot: Plot) -> List[Curve]:
    within = lambda series: [(t, v) for t, v in series if plot.start <= t <= plot.end]
    curves = [Curve("truth", plot.path(part)) for part in unbroken(within(recording.true_current))]
    for node, series in sorted(recording.current.items()):
        kind = "substitute" if node.startswith("/substitute") else "sensor"
        curves += [Curve(kind, plot.path(part)) for part in unbroken(within(series))]
    return curves


def _expected(incident: Dict[str, object]) -> str:
    errors = incident.get("errors")
    if not isinstance(errors, list) or not errors or not errors[0]:
        return ""
    return f", expected to err by {errors[0]['rms']:.2f} A (RMS)"


def _short(name: str) -> str:
    return shown(name, LONGEST_NAME)


def _template() -> jinja2.Template:
    environment = jinja2.Environment(
        loader=jinja2.FileSystemLoader(str(TEMPLATES)),
        autoescape=True,
        undefined=jinja2.StrictUndefined,
        trim_blocks=True,
        keep_trailing_newline=True,
    )
    return environment.get_template("moving_picture.svg")
