"""Healthy traffic beside busy processes: is anybody blamed, and how often would a topic be bridged?

    python3 healthy_traffic.py [--hours H] [--topics N] [--busy N] [--standby WORD] [--results DIR]

Many topics in parallel stand for a long time: 60 topics for 24 minutes are a day. Half of them
have the fixed deadline, half one that is learned while the computer is idle; then it becomes busy.
Healing is there as on a robot, and would kill whom it blames. An independent consumer in plain
sockets notes each pause: how many are longer than a bridge waits is predicted by the tail of those
of the first half, and counted in the second.

Writes healthy_traffic.csv and healthy_traffic_goals.csv; ends with status 1 if there was a failure.
Ctrl-C ends a phase: what was seen until then counts.
"""
import argparse
import json
import os
import re
import math
import statistics
import sys
import time
from pathlib import Path
from typing import Dict, List, NamedTuple, Sequence, Tuple

import rospy
from diagnostic_msgs.msg import DiagnosticArray
from shsa_msgs.msg import Failure, Health
from tqdm import tqdm

from graph import BENCH, Graph, ask_to_leave, service, write_som
from probe import STARTUP_S, Probe
from report import Goals, print_table, write_table
from shsa_core.monitoring.settings import LEARN_GAPS, LEARN_SHARE
from shsa_core.watch import INSTANT_S
from shsa_testing.waiting import wait_until

PERIOD_S = 0.02
A_NODE = 20
BRIDGE_PERIODS = 2.5
NOTED_PERIODS = 1.5
SLICES = 20
"""Of the first half: how much counts differ from one to the next says how sure a prediction is."""
SIGMAS = 3.0
FIXED, LEARNED = "fixed", "learned"
FIXED_S = 0.25


class Row(NamedTuple):
    """The outcome for the topics of a kind of deadline; `killed`: nodes, of both kinds."""

    deadline: str
    topics: int
    topic_hours: float
    busy_processes: int
    cores: int
    messages: int
    allowed_ms: float
    most_allowed_ms: float
    failures: int
    killed: int
    largest_gap_ms: float


class Bridges(NamedTuple):
    """Pauses longer than a bridge waits, in the second half: as predicted, at most, and as seen."""

    predicted: float
    at_most: float
    seen: int


class Consumer(Probe):
    """The independent consumer, and what its pauses say of bridges."""

    def lengths(self, begin: float, end: float) -> List[float]:
        """Return the pauses that ended in a time, in s, in order of length."""
        return sorted(e - b for _, b, e in list(self.pauses) if begin <= e < end)

    def bridges(self, begin: float, end: float) -> Bridges:
        """Judge the second half of a time by the first."""
        wait, half = BRIDGE_PERIODS * PERIOD_S, (end - begin) / 2.0
        noted = self.lengths(begin, begin + half)
        predicted = 0.0
        if len(noted) > 1:
            beyond = max(0.0, wait - noted[0])
            excess = sum(noted) / len(noted) - noted[0]
            predicted = len(noted) * math.exp(-beyond / max(excess, INSTANT_S))
        step = half / SLICES
        counts = [
            sum(each > wait for each in self.lengths(begin + n * step, begin + (n + 1) * step))
            for n in range(SLICES)
        ]
        spread = (SLICES * statistics.variance(counts)) ** 0.5
        unsure = SIGMAS * max(spread, predicted**0.5, 1.0)
        seen = sum(each > wait for each in self.lengths(begin + half, end))
        return Bridges(predicted, predicted + unsure, seen)


class Deadlines:
    """The learned deadlines as /diagnostics shows them, in s, by service."""

    def __init__(self) -> None:
        self.learned: Dict[str, float] = {}
        rospy.Subscriber("/diagnostics", DiagnosticArray, self._hear, queue_size=10)

    def _hear(self, array: DiagnosticArray) -> None:
        for row in array.status:
            told = {each.key: each.value for each in row.values}.get("deadline", "")
            found = re.match(r"([0-9.]+) s, learned from", told)
            if found:
                self.learned[row.name.split(": ")[-1]] = float(found.group(1))


def write_models(graph: Graph, count: int, standby: str, alarms: float) -> Tuple[Path, Path]:
    """Let each topic be computed from the one of the same place in the next node.

    The deadline of each second one is learned.
    """
    services, relations = [], {}
    for number in range(count):
        node = f"/source_{number // A_NODE}"
        more = {"deadline": {"false_alarms": alarms}} if number % 2 else {}
        topic = f"/stream_{number}"
        services.append(service(topic, node, PERIOD_S, needed=True, standby=standby, **more))
        relations[f"r_{number}"] = {f"stream_{number}": f"2*stream_{(number + A_NODE) % count}"}
    properties = {f"stream_{number}": {"unit": "m"} for number in range(count)}
    ontology = graph.folder / "ontology.yaml"
    ontology.write_text(json.dumps({"properties": properties, "relations": relations}))
    return ontology, write_som(graph.folder / "som.yaml", services)


def watch(seconds: float, what: str) -> float:
    """Let time pass, in sight of who waits for it; how much has passed, in s.

    An interrupt ends it early.
    """
    begin = time.monotonic()
    try:
        for _ in tqdm(range(max(1, round(seconds))), desc=what, disable=None):
            rospy.rostime.wallsleep(min(1.0, max(0.0, begin + seconds - time.monotonic())))
    except KeyboardInterrupt:
        print(f"{what}: interrupted; what was seen until now counts", flush=True)
    return time.monotonic() - begin


def measure(options: argparse.Namespace) -> Tuple[List[Row], Bridges, List[str]]:
    """One robot: a row for each kind of deadline, the bridges, and what was told of failures."""
    learning = max(LEARN_GAPS * PERIOD_S, LEARN_SHARE * 3600.0 / options.alarms)
    topics = [f"/stream_{number}" for number in range(options.topics)]
    kinds = {FIXED: topics[::2], LEARNED: topics[1::2]}
    failures: List[Tuple[float, Failure]] = []
    with Graph() as graph:
        nodes = [
            graph.python(
                *(BENCH / "stream_source.py", str(A_NODE), str(PERIOD_S), str(first)),
                f"__name:=source_{first // A_NODE}",
            )
            for first in range(0, options.topics, A_NODE)
        ]
        there = lambda: {topic for topic, _ in rospy.get_published_topics()} >= set(topics)
        wait_until(there, STARTUP_S, "the robot is up")
        hear = lambda each: failures.append((time.monotonic(), each))
        rospy.Subscriber("/shsa/failures", Failure, hear)
        healthy: Dict[str, bool] = {}
        look = lambda table: healthy.update(
            {r.topic: r.state == "healthy" for r in table.publishers}
        )
        rospy.Subscriber("/shsa/health", Health, look)
        deadlines = Deadlines()
        ontology, som = write_models(graph, options.topics, options.standby, options.alarms)
        launch = graph.start(
            *("roslaunch", "shsa_core", "shsa.launch", f"ontology:={ontology}", f"som:={som}"),
            f"incident_log:={graph.folder / 'incidents.jsonl'}",
        )
        well = lambda: sum(healthy.values()) == len(topics)
        wait_until(well, STARTUP_S, "all topics are healthy")
        consumer = Consumer(graph, topics, NOTED_PERIODS * PERIOD_S)
        watch(learning + 3.0, "idle, learning")
        idle = sorted(deadlines.learned.values())
        busy = graph.start_busy(options.busy)
        begin = time.monotonic()
        seconds = watch(options.hours * 3600.0 / options.topics, "busy")
        end = begin + seconds
        for process in busy:
            process.kill()
        killed = sum(node.poll() is not None for node in nodes)
        told = [(at, each) for at, each in failures if at <= end]  # later ones are of the end
        bridges = consumer.bridges(begin, end)
        learned = sorted(deadlines.learned.values())
        print(f"learned while idle: {_ms(idle)} ms; when busy: {_ms(learned)} ms (median, most)")
        rows = [
            Row(
                *(kind, len(own), round(len(own) * seconds / 3600.0, 3)),
                *(options.busy, os.cpu_count() or 1, round(len(own) * seconds / PERIOD_S)),
                *_ms(learned if kind == LEARNED else [FIXED_S]),
                *(sum(each.topic in own for _, each in told), killed),
                round(1e3 * consumer.longest(begin, end, own), 1),
            )
            for kind, own in kinds.items()
        ]
        words = [
            f"{at - begin:.2f} s: {e.publisher} on {e.topic}: {e.kind}: {e.detail}"
            for at, e in told
        ]
        ask_to_leave(launch, 30.0)
    return rows, bridges, words


def _ms(seconds: Sequence[float]) -> Tuple[float, float]:
    if not seconds:
        return float("nan"), float("nan")
    return round(1e3 * statistics.median(seconds), 1), round(1e3 * max(seconds), 1)


def main() -> int:
    """Measure, print the verdict, write the CSV files."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--hours", type=float, default=24.0, help="topic hours to watch while busy")
    parser.add_argument("--topics", type=int, default=60, help=f"a multiple of {A_NODE}")
    parser.add_argument("--busy", type=int, default=4, help="busy processes")
    parser.add_argument("--standby", default="cold", help="of each topic: cold, warm or hot")
    parser.add_argument("--alarms", type=float, default=0.01, help="asked for, an hour of a topic")
    parser.add_argument("--short", action="store_true", help="for seconds, as a check")
    parser.add_argument("--results", type=Path, default=Path("results/bench"))
    options = parser.parse_args()
    if options.short:
        options.hours, options.topics, options.alarms = 0.2, 2 * A_NODE, 100.0
    if options.topics % A_NODE or options.topics < 2 * A_NODE:
        parser.error(f"--topics must be a multiple of {A_NODE}, and {2 * A_NODE} at least")
    options.results.mkdir(parents=True, exist_ok=True)
    rows, bridges, told = measure(options)
    for line in told:
        print(line)
    print_table("Healthy traffic", Row._fields, [[str(each) for each in row] for row in rows])
    write_table(options.results / "healthy_traffic.csv", Row._fields, rows)
    goals = Goals()
    hours = sum(row.topic_hours for row in rows)
    name = f"{hours:.3g} h-equivalent beside {options.busy} busy processes"
    for row in rows:
        goals.at_most(f"{name}: failures", f"{row.deadline} deadline", 0, row.failures, "")
    goals.at_most(f"{name}: nodes killed", "all", 0, rows[0].killed, "")
    what = f"{name}: pauses beyond {BRIDGE_PERIODS:g} periods in its second half"
    goals.at_most(what, f"{bridges.predicted:.3g} predicted", bridges.at_most, bridges.seen, "")
    goals.show(options.results / "healthy_traffic_goals.csv")
    return 1 if told else 0


if __name__ == "__main__":
    sys.exit(main())
