"""Topics of high rates: the outage at a consumer, and the slots that the hot substitute keeps.

The original and the input of the substitute are roscpp nodes of the same rate; the original is
killed with `kill -9`. The substitute's rate is what its consumers heard, a second after the
takeover; beside it stands what the original kept just before on the same machine, and the
substitute's share of a core. Writes results/bench/kilohertz.csv.
"""
import subprocess
import sys
import time
from typing import Dict, List, NamedTuple, Tuple

import numpy as np
from tqdm import tqdm

from contenders import Healed, repeat
from faults import FAULTS
from graph import Graph
from report import Goals, arguments, in_words, print_table, write_table
from robot import NODE, TOPIC, Consumers, HealthyRobot
from shsa_testing.graph import node_pid, node_process
from substitute_cost import cpu_time
from takeover import STEPS, Takeover

PERIODS_S = (0.01, 0.002, 0.001, 0.0005)
GOAL_S, GOAL_PERIODS, GOAL_SHARE = 0.001, 5.0, 0.005
SETTLING_TIME_S, RATE_S, SHORT_RATE_S = 1.0, 10.0, 2.0
COLUMNS = (
    *("hz", "number", "rospy_rate_hz", "roscpp_rate_hz", "original_rate_hz", "cpu_percent"),
    *("lost_slots", "longest_gap_ms", "original_longest_gap_ms"),
    *("rospy_outage_ms", "roscpp_outage_ms", *(f"{step}_ms" for step in STEPS)),
)


class FastRobot(HealthyRobot):
    """The small robot, with nodes in roscpp: they keep any rate."""

    def _talker(self, node: str, topic: str, value: float) -> "subprocess.Popen[str]":
        arguments = (topic, str(self.period), str(value), f"__name:={node[1:]}")
        return self._graph.cpp("talker", *arguments)


class Run(NamedTuple):
    """One takeover, and what came of the substitute after it; rates in Hz."""

    takeover: Takeover
    rospy_rate: float
    roscpp_rate: float
    original_rate: float
    cpu: float
    lost: int
    longest_ms: float
    original_ms: float

    def columns(self) -> List[float]:
        """Return a row of the CSV file, without what names it."""
        outages = (self.takeover.rospy_ms, self.takeover.roscpp_ms)
        steps = (getattr(self.takeover, f"{step}_ms") for step in STEPS)
        return [round(each, 3) for each in (*self[1:], *outages, *steps)]


class Fast(Healed):
    """The robot at one rate."""

    def __init__(self, graph: Graph, consumers: Consumers, period: float) -> None:
        self.period = period
        self._consumers = consumers
        self._robot = FastRobot(graph, consumers, "hot", period)
        self._fault = FAULTS["kill -9"]

    def await_well(self) -> None:
        self._robot.await_well()

    def run(self, seconds: float) -> Run:
        """Listen to the original for so long, fail once, listen to the substitute, come back."""
        self.await_well()
        before = self._listen(NODE, seconds)[1]
        for each in self._consumers:
            each.forget()  # to look through so many would be our share of the outage
        takeover = self.take_over()
        time.sleep(SETTLING_TIME_S)
        pid = node_pid(takeover.substitute)
        spent, begin = cpu_time(pid), time.monotonic()
        at_rospy, after = self._listen(takeover.substitute, seconds)
        took = time.monotonic() - begin
        assert node_process(takeover.substitute) is not None, "the substitute was replaced"
        share = (cpu_time(pid) - spent) / took
        self.bring_back()
        lost = round((after[-1] - after[0]) / self.period) - (len(after) - 1)
        rates = [rate(each) for each in (at_rospy, after, before)]
        gaps = [1e3 * float(np.max(np.diff(each))) for each in (after, before)]
        return Run(takeover, rates[0], rates[1], rates[2], 100.0 * share, lost, *gaps)

    def _listen(self, node: str, seconds: float) -> Tuple[List[float], List[float]]:
        """Return when messages of a node came to the rospy consumer, and to the roscpp one."""
        begin = time.monotonic()
        time.sleep(seconds)
        heard = [[m for m in each.since(begin) if m.node == node] for each in self._consumers]
        return [m.at for m in heard[0]], [m.at for m in heard[1]]


def rate(moments: List[float]) -> float:
    """Return a rate, in Hz."""
    return (len(moments) - 1) / (moments[-1] - moments[0])


def main() -> int:
    """Measure, print and judge; 1 if a failure was not healed in time."""
    options = arguments(str(__doc__), "failures", 20, short="1 kHz, once, 2 s")
    failures, seconds = options.failures, RATE_S
    periods = [each for each in PERIODS_S if any(part in title(each) for part in options.only)]
    if options.short:
        periods, failures, seconds = [GOAL_S], 1, SHORT_RATE_S
    runs: Dict[float, List[Run]] = {}
    misses = 0
    with Graph() as graph:
        consumers = Consumers(graph, TOPIC)
        for period in periods:
            found = runs[period] = []
            progress = tqdm(total=failures, desc=title(period), disable=None)

            def once(robot: Fast) -> None:
                found.append(robot.run(seconds))
                progress.update()

            make = lambda: Fast(graph, consumers, period)
            misses += repeat(graph, make, once, lambda: len(found) >= failures)
            progress.close()
            write_table(options.results / "kilohertz.csv", COLUMNS, table(runs))
    show(runs)
    goals = Goals()
    for consumer in ("rospy", "roscpp") if runs.get(GOAL_S) else ():
        outages = [getattr(each.takeover, f"{consumer}_ms") for each in runs[GOAL_S]]
        periods_out = float(np.median(outages)) / (1e3 * GOAL_S)
        goals.at_most("1 kHz: p50, periods", consumer, GOAL_PERIODS, periods_out, "")
        rate = float(np.median([getattr(each, f"{consumer}_rate") for each in runs[GOAL_S]]))
        limits = (1.0 - GOAL_SHARE, 1.0 + GOAL_SHARE)
        goals.within("1 kHz: rate", consumer, limits, rate * GOAL_S)
    goals.show(options.results / "kilohertz_goals.csv")
    return 1 if misses else 0


def title(period: float) -> str:
    """Return the name of a rate."""
    return f"{1 / period:g} Hz"


def table(runs: Dict[float, List[Run]]) -> List[Tuple[object, ...]]:
    """Return a row for each failure."""
    return [
        (f"{1 / period:g}", number, *run.columns())
        for period, found in runs.items()
        for number, run in enumerate(found, 1)
    ]


def show(runs: Dict[float, List[Run]]) -> None:
    """Print the rates and the outages."""
    lines, steps = [], []
    for period, found in runs.items():
        if not found:
            continue
        of = lambda name: [getattr(each, name) for each in found]
        taken = lambda name: [getattr(each.takeover, name) for each in found]
        figures = (in_words(taken("rospy_ms")), in_words(taken("roscpp_ms")))
        kept = [
            f"{100 * np.median(of(name)) * period:.2f}" for name in ("roscpp_rate", "original_rate")
        ]
        told = (f"{np.median(of('cpu')):.0f}", f"{np.median(of('lost')):g}")
        gaps = [in_words(of(name)) for name in ("longest_ms", "original_ms")]
        lines.append((title(period), *kept, *told, *gaps, *figures))
        medians = (f"{np.median(taken(step + '_ms')):.1f}" for step in STEPS)
        steps.append((title(period), *medians))
    columns = (
        *("", "kept, %", "by the original", "core, %", "lost", "longest gap", "of the original"),
        *("outage, rospy", "outage, roscpp"),
    )
    print_table("The hot substitute, ms: median / p95 / max", columns, lines)
    print_table("Steps of the outage at the rospy consumer, ms: medians", ("", *STEPS), steps)


if __name__ == "__main__":
    sys.exit(main())
