"""False alarms: healthy topics at 50 Hz, watched while the CPU is saturated by other work.

Many topics in parallel stand for a long time: 50 topics for 72 s are an hour. Appends to
results/bench/false_alarms.csv; ends with status 1 if there was a false alarm.
"""
import argparse
import csv
import os
import sys
import time
from pathlib import Path
from typing import Dict, List, Tuple

import numpy as np
import rospy
from tqdm import tqdm
from shsa_msgs.msg import Failure, Health

from graph import BENCH, MONITOR, PATIENCE_S, Graph, service, write_som
from shsa_testing.waiting import wait_until

TOPICS = 50
NODES = 5
PERIOD_S = 0.02
LOAD = 4  # busy processes a core
BUSY = "while True: pass"
COLUMNS = ("topic_hours", "busy_processes", "cores", "messages", "largest_gap_ms", "false_alarms")


def main() -> int:
    """Measure, print the verdict, write the CSV file."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--hours", type=float, default=1.0, help="topic hours to watch")
    parser.add_argument("--results", type=Path, default=Path("results/bench"))
    options = parser.parse_args()
    options.results.mkdir(parents=True, exist_ok=True)
    seconds = options.hours * 3600.0 / TOPICS
    heard: List[Tuple[float, str]] = []
    healthy: Dict[str, bool] = {}

    def look(table: Health) -> None:
        healthy.update({row.topic: row.state == "healthy" for row in table.publishers})

    with Graph() as graph:
        rospy.Subscriber("/shsa/health", Health, look)
        share = TOPICS // NODES
        services: List[Dict[str, object]] = []
        for node in range(NODES):
            arguments = [str(share), str(PERIOD_S), str(node * share), f"__name:=source_{node}"]
            graph.python(BENCH / "stream_source.py", *arguments)
            for i in range(node * share, (node + 1) * share):
                services.append(service(f"/stream_{i}", f"/source_{node}", PERIOD_S))
        graph.python(MONITOR, "--som", str(write_som(graph.folder / "som.yaml", services)))
        path = graph.folder / "rows.npy"
        well = lambda: len(healthy) == TOPICS and all(healthy.values())
        wait_until(well, PATIENCE_S, "all topics are healthy")
        hear = lambda f: heard.append((time.monotonic(), f"{f.topic}: {f.kind}: {f.detail}"))
        rospy.Subscriber("/shsa/failures", Failure, hear)
        probe = graph.python(BENCH / "stream_probe.py", str(path), str(share), str(seconds))
        cores = os.cpu_count() or 1
        for _ in range(LOAD * cores):
            graph.start(sys.executable, "-c", BUSY)
        end = time.monotonic() + seconds
        for _ in tqdm(range(round(seconds)), desc="watching", disable=None):
            rospy.rostime.wallsleep(min(1.0, max(0.0, end - time.monotonic())))
        probe.wait(60.0)
        rows = np.load(path)
    alarms = [text for at, text in heard if at <= end]  # later ones are of the end of the nodes
    gaps = [np.max(np.diff(rows[rows[:, 0] == topic][:, 2])) for topic in range(share)]
    row = (
        options.hours,
        LOAD * cores,
        cores,
        round(len(rows) / share * TOPICS),
        round(1e3 * max(gaps), 1),
        len(alarms),
    )
    file = options.results / "false_alarms.csv"
    new = not file.exists()
    with open(file, "a", newline="") as stream:
        writer = csv.writer(stream)
        if new:
            writer.writerow(COLUMNS)
        writer.writerow(row)
    for name, value in zip(COLUMNS, row):
        print(f"{name}: {value}")
    for alarm in alarms:
        print(alarm)
    return 1 if alarms else 0


if __name__ == "__main__":
    sys.exit(main())
