"""Line 4: healthy topics beside an overloaded CPU."""
import csv
import subprocess
import sys
from typing import Iterator, Sequence

from graph import BENCH, Graph
from reliability.scoreboard import Figures, Line, Trial
from reliability.trying import attempt

HOURS, SHORT_HOURS = 1.0, 0.03


def overload(graph: Graph, seed: int, hours: float) -> Figures:
    """Watch 40 topics at 50 Hz for a while, 8 busy processes beside them."""
    command = [sys.executable, str(BENCH / "healthy_traffic.py"), "--hours", str(hours)]
    command += ["--topics", "40", "--busy", "8", "--alarms", "10"]
    done = subprocess.run(
        [*command, "--results", str(graph.folder)],
        stdout=subprocess.PIPE,
        universal_newlines=True,
    )
    assert done.returncode == 0, done.stdout[-2000:]
    with open(str(graph.folder / "healthy_traffic.csv"), newline="") as file:
        rows = list(csv.DictReader(file))
    messages = sum(float(row["messages"]) for row in rows)
    largest = max(float(row["largest_gap_ms"]) for row in rows)
    return {"topic hours": hours, "messages": messages, "largest_gap_ms": largest}


def hours(graph: Graph, seeds: Sequence[int]) -> Iterator[Trial]:
    """Yield trials: each is a topic hour; less in the short form."""
    length = HOURS if len(seeds) > 1 else SHORT_HOURS
    for seed in seeds:
        yield attempt(4, seed, lambda: overload(graph, seed, length))


LINES = (
    Line(
        4,
        "healthy, 4 times CPU overload",
        "no false healing over 24 hours' worth of messages",
        hours,
        full=24,
        short=1,
    ),
)
