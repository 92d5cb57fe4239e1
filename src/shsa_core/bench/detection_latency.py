"""Latency of the monitor, from a fault to the message on /shsa/failures.

Topics at 50 Hz, one rospy node each.

`heard`: from causing the fault to a subscriber's hearing of it. `after_last_good`: from the last
good message to the decision, as the monitor tells it. Writes results/bench/detection_latency.csv.
"""
import argparse
import csv
import signal
import time
from pathlib import Path
from typing import Callable, Dict, List, Tuple

import numpy as np
import rospy
from shsa_msgs.msg import Failure, Health

from graph import (
    FAULTY_PUBLISHER,
    MONITOR,
    PATIENCE_S,
    Graph,
    ask_to_leave,
    service,
    shut_down,
    write_som,
)
from report import print_table
from shsa_testing.faulty_publisher import FaultHandle
from shsa_testing.waiting import wait_until

PERIOD_S = 0.02
SILENCE_S = 0.1  # the monitor's deadline: five periods
NODES_AT_ONCE = 5
COLUMNS = ("fault", "kind", "heard_ms", "after_last_good_ms")


class Target:
    """One faulty publisher on a topic of its own."""

    def __init__(self, graph: Graph, name: str) -> None:
        self.name, self.topic = "/" + name, f"/topic_{name}"
        self.process = graph.python(
            FAULTY_PUBLISHER, f"__name:={name}", f"_topic:={self.topic}", f"_period:={PERIOD_S}"
        )
        self.command = FaultHandle(self.name)

    def kill(self) -> None:
        self.process.kill()

    def stop(self) -> None:
        self.process.send_signal(signal.SIGSTOP)

    def shut_down(self) -> None:
        shut_down(self.name)

    def unadvertise(self) -> None:
        self.command.fault("unadvertise")

    def leave_range(self) -> None:
        self.command.fault("value 1000")

    def say_nan(self) -> None:
        self.command.fault("value nan")


FAULTS: Dict[str, Callable[[Target], None]] = {
    "kill -9": Target.kill,
    "rosnode kill": Target.shut_down,
    "unadvertise": Target.unadvertise,
    "SIGSTOP": Target.stop,
    "out of range": Target.leave_range,
    "not a number": Target.say_nan,
}


class Witness:
    """The messages of the monitor."""

    def __init__(self) -> None:
        self.healthy: Dict[str, bool] = {}
        self.failures: Dict[str, Tuple[float, Failure]] = {}
        rospy.Subscriber("/shsa/failures", Failure, self._failure, tcp_nodelay=True)
        rospy.Subscriber("/shsa/health", Health, self._health, tcp_nodelay=True)

    def _failure(self, failure: Failure) -> None:
        self.failures.setdefault(failure.topic, (time.monotonic(), failure))

    def _health(self, table: Health) -> None:
        for row in table.publishers:
            self.healthy[row.topic] = row.state == "healthy"


def measure(
    graph: Graph, witness: Witness, fault: str, number: int
) -> List[Tuple[str, str, float, float]]:
    """One fault in NODES_AT_ONCE nodes, one after the other; the rows of figures."""
    word = "".join(letter for letter in fault if letter.isalnum())
    targets = [Target(graph, f"{word}_{number}_{i}") for i in range(NODES_AT_ONCE)]
    value = {"range": [-5.0, 60.0]}
    services = [service(target.topic, target.name, PERIOD_S, value) for target in targets]
    som = write_som(graph.folder / "som.yaml", services)
    monitor = graph.python(MONITOR, "--som", str(som), f"_minimum_deadline:={SILENCE_S}")
    rows = []
    for target in targets:
        healthy = lambda: witness.healthy.get(target.topic, False)
        wait_until(healthy, PATIENCE_S, f"{target.name} is healthy")
        rospy.rostime.wallsleep(0.1 + PERIOD_S * np.random.random())
        caused = time.monotonic()
        FAULTS[fault](target)
        wait_until(lambda: target.topic in witness.failures, 10.0, f"{fault} is seen")
        heard, failure = witness.failures[target.topic]
        after = (failure.header.stamp - failure.last_good).to_sec()
        rows.append((fault, failure.kind, 1e3 * (heard - caused), 1e3 * after))
    ask_to_leave(monitor)
    for target in targets:
        target.process.kill()
    return rows


def main() -> None:
    """Measure, print a table, write the CSV file."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--count", type=int, default=50, help="injections of each fault")
    parser.add_argument("--results", type=Path, default=Path("results/bench"))
    options = parser.parse_args()
    options.results.mkdir(parents=True, exist_ok=True)
    columns = ("fault", "kind", "n", "median", "p95", "max", "median after last good")
    table: List[Tuple[str, ...]] = []
    with Graph() as graph, open(options.results / "detection_latency.csv", "w", newline="") as file:
        writer = csv.writer(file)
        writer.writerow(COLUMNS)
        witness = Witness()
        for fault in FAULTS:
            rows: List[Tuple[str, str, float, float]] = []
            for number in range(-(-options.count // NODES_AT_ONCE)):
                rows += measure(graph, witness, fault, number)
            writer.writerows(rows)
            heard = [row[2] for row in rows]
            figures = (np.median(heard), np.percentile(heard, 95), max(heard))
            after = np.median([row[3] for row in rows])
            words = [f"{figure:.1f}" for figure in (*figures, after)]
            table.append((fault, rows[0][1], str(len(rows)), *words))
    print_table("From the fault to the failure message, ms", columns, table)


if __name__ == "__main__":
    main()
