"""Freedom of interference (Section III-A3): what reconfigurations do to ten unconcerned topics.

Ten roscpp nodes publish at 50 Hz, and one roscpp node hears them all. Jitter is how far the time
between two messages is from the period. The phases:
    before, after: healing watches, and nothing happens. takeover: half a second from each failure
    on.   return: from the failed node's start to the incident's end; the start of a rospy node,
    which somebody else asked for, is part of it.
Writes interference.csv (every interval), interference_goals.csv and interference.png.
"""
import argparse
import csv
import random
import sys
import time
from pathlib import Path
from typing import Dict, Iterator, List, NamedTuple, Set, Tuple

import matplotlib.pyplot as plt
import numpy as np
from tqdm import tqdm

from contenders import Healed, repeat
from graph import PATIENCE_S, Graph
from report import Goals, print_table
from robot import TOPIC, Consumer, Consumers
from shsa_testing.waiting import wait_until

PERIOD_S = 0.02
TOPICS = tuple(f"/uninvolved_{number}" for number in range(10))
PHASES = ("before", "takeover", "return", "after")
TAKEOVER_S = 0.5
GOAL = 0.5 * 1e3 * PERIOD_S  # ms; by so much the 99th percentile of jitter may grow
STANDBYS = ("cold", "warm", "hot")
COLUMNS = ("standby", "phase", "topic", "at_s", "interval_ms", "lost")


class Interval(NamedTuple):
    """The time between two messages of a topic; `lost`: how many are missing between them."""

    standby: str
    phase: str
    topic: str
    at: float
    ms: float
    lost: int


Windows = Dict[str, List[Tuple[float, float]]]


def pause(seconds: float) -> Tuple[float, float]:
    """Let nothing happen; from when to when that was."""
    begun = time.monotonic()
    time.sleep(seconds)
    return begun, time.monotonic()


def disturb(robot: Healed, windows: Windows) -> None:
    """Fail and come back; note when."""
    time.sleep(PERIOD_S * random.random())
    begun = time.monotonic()
    robot.take_over()
    time.sleep(max(0.0, begun + TAKEOVER_S - time.monotonic()))
    windows["takeover"].append((begun, begun + TAKEOVER_S))
    begun = time.monotonic()
    robot.bring_back()
    robot.await_well()
    windows["return"].append((begun, time.monotonic()))


def _heard(listener: Consumer) -> Set[str]:
    return {message.topic for message in list(listener.messages)}


def intervals(standby: str, listener: Consumer, windows: Windows) -> Iterator[Interval]:
    """Yield the intervals in each phase."""
    for topic in TOPICS:
        messages = [m for m in list(listener.messages) if m.topic == topic]
        for before, after in zip(messages, messages[1:]):
            for phase in PHASES:
                if any(begin <= after.at <= end for begin, end in windows[phase]):
                    lost = round(after.value - before.value) - 1
                    gap = 1e3 * (after.at - before.at)
                    yield Interval(standby, phase, topic, after.at, gap, lost)


def jitter(found: List[Interval], standby: str, phase: str) -> np.ndarray:
    """Return the distance of each interval of a phase from the period, in ms."""
    values = [each.ms for each in found if (each.standby, each.phase) == (standby, phase)]
    return np.abs(np.array(values) - 1e3 * PERIOD_S)


def show(found: List[Interval]) -> Goals:
    """Print the table; the goals."""
    columns = ("", "n", "period: mean", "jitter: p50", "p95", "p99", "max", "messages lost")
    table: List[Tuple[str, ...]] = []
    goals = Goals()
    for standby in dict.fromkeys(each.standby for each in found):
        p99 = {}
        lost = dict.fromkeys(PHASES, 0)
        for phase in PHASES:
            part = [each for each in found if (each.standby, each.phase) == (standby, phase)]
            values = jitter(found, standby, phase)
            p50, p95, p99[phase] = np.percentile(values, (50, 95, 99))
            lost[phase] = sum(each.lost for each in part)
            mean = np.mean([each.ms for each in part])
            figures = (f"{each:.2f}" for each in (mean, p50, p95, p99[phase], values.max()))
            table.append((f"{standby}, {phase}", str(len(part)), *figures, str(lost[phase])))
        for phase in ("takeover", "return", "after"):
            more = p99[phase] - p99["before"]
            goals.at_most(f"{standby}, {phase}: p99 of jitter grows by", "roscpp", GOAL, more, "ms")
        goals.at_most(f"{standby}: messages lost", "roscpp", 0, sum(lost.values()), "")
    print_table("Ten uninvolved topics at 50 Hz; times in ms", columns, table)
    return goals


def plot(found: List[Interval], path: Path) -> None:
    """Draw the share of intervals whose jitter is above a value, one panel a standby."""
    standbys = list(dict.fromkeys(each.standby for each in found))
    figure, axes = plt.subplots(
        1, len(standbys), figsize=(5 * len(standbys), 4), sharey=True, squeeze=False
    )
    for axis, standby in zip(axes[0], standbys):
        for phase in PHASES:
            values = np.sort(jitter(found, standby, phase))
            axis.step(values, 1.0 - np.arange(len(values)) / len(values), label=phase)
        axis.set_xscale("log")
        axis.set_yscale("log")
        axis.set_xlabel("jitter, ms")
        axis.set_title(f"reconfigurations of a {standby} topic")
        axis.grid(True, alpha=0.3)
    axes[0][0].set_ylabel("share of intervals above")
    axes[0][0].legend()
    figure.tight_layout()
    figure.savefig(str(path), dpi=120)
    plt.close(figure)


def main() -> int:
    """Measure, then say the verdict."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--reconfigurations", type=int, default=50, help="for each standby")
    parser.add_argument("--seconds", type=float, default=30.0, help="before and after")
    parser.add_argument("--only", nargs="+", choices=STANDBYS, default=STANDBYS)
    parser.add_argument("--short", action="store_true", help="two of a hot topic, as a check")
    parser.add_argument("--results", type=Path, default=Path("results/bench"))
    options = parser.parse_args()
    options.results.mkdir(parents=True, exist_ok=True)
    count = 2 if options.short else options.reconfigurations
    seconds = 2.0 if options.short else options.seconds
    found: List[Interval] = []
    misses = 0
    with Graph() as graph:
        consumers = Consumers(graph, TOPIC)
        for topic in TOPICS:
            graph.cpp("talker", topic, str(PERIOD_S), f"__name:={topic[1:]}")
        for standby in ("hot",) if options.short else options.only:
            progress = tqdm(total=count, desc=standby, disable=None)
            make = lambda: Healed(graph, consumers, standby, PERIOD_S)
            process = graph.cpp("consumer", *TOPICS, "__name:=listener", heard=True)
            listener = Consumer(process, "/listener")
            wait_until(lambda: len(_heard(listener)) == len(TOPICS), PATIENCE_S, "all topics")
            windows: Windows = {phase: [] for phase in PHASES}

            def once(robot: Healed) -> None:
                robot.await_well()
                if not windows["before"]:
                    windows["before"].append(pause(seconds))
                disturb(robot, windows)
                progress.update()
                if enough():
                    windows["after"].append(pause(seconds))

            enough = lambda: len(windows["return"]) >= count
            misses += repeat(graph, make, once, enough)
            listener.end()
            progress.close()
            found += intervals(standby, listener, windows)
    with open(options.results / "interference.csv", "w", newline="") as file:
        writer = csv.writer(file)
        writer.writerow(COLUMNS)
        for each in found:
            writer.writerow([*each[:3], f"{each.at:.4f}", f"{each.ms:.3f}", each.lost])
    show(found).show(options.results / "interference_goals.csv")
    plot(found, options.results / "interference.png")
    return 1 if misses else 0


if __name__ == "__main__":
    sys.exit(main())
