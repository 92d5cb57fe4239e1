"""Line 4: healthy topics beside an overloaded CPU."""
import subprocess
import sys
from typing import Iterator, Sequence

from graph import BENCH, Graph
from reliability.scoreboard import Figures, Line, Trial
from reliability.trying import attempt

HOURS, SHORT_HOURS = 1.0, 0.03


def overload(graph: Graph, seed: int, hours: float) -> Figures:
    """Watch 50 topics at 50 Hz for a while, 8 busy processes beside them."""
    command = [sys.executable, str(BENCH / "false_alarms.py"), "--hours", str(hours)]
    done = subprocess.run(
        [*command, "--results", str(graph.folder)],
        stdout=subprocess.PIPE,
        universal_newlines=True,
    )
    told = dict(line.split(": ", 1) for line in done.stdout.splitlines() if ": " in line)
    assert done.returncode == 0, done.stdout[-2000:]
    names = ("messages", "largest_gap_ms")
    return {"topic hours": hours, **{name: float(told[name]) for name in names}}


def hours(graph: Graph, seeds: Sequence[int]) -> Iterator[Trial]:
    """Each trial is a topic hour; less in the short form."""
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
