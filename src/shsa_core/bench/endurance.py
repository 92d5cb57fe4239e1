"""Many incidents, one after the other: do monitor and reconfigurator grow?

    python3 endurance.py [--incidents N] [--short] [--results DIR]

Nodes are killed with `kill -9`, healed, and started again, several at a time. After each round it
is noted what monitor and reconfigurator hold: memory, threads, descriptors. Writes endurance.csv.
Exit status 1 if anything has grown from the first half to the second.
"""
import argparse
import csv
import json
import subprocess
import sys
import time
from pathlib import Path
from statistics import median
from typing import Dict, Iterable, List, NamedTuple

import rospy
from shsa_msgs.msg import Incident

from graph import Graph, service, write_som
from report import print_table
from shsa_testing.graph import node_process, registered_nodes
from shsa_testing.waiting import wait_until

PERIOD_S = 0.02
AT_ONCE = 8
COLD = 1
"""Of those so many have no substitute beforehand: a process is made for each of their incidents."""
PATIENCE_S = 60.0
NODES = ("/monitor", "/reconfigurator")
WARM_UP = 5
"""Rounds: memory that Python and rospy take once and keep."""
ALLOWED = {"rss_kb": 1024.0, "threads": 2.0, "descriptors": 4.0}
"""Growth that is allowed from the first half to the second, by medians: a trend."""
TIRELESS = "hold_off:=0.3", "switches:=0"


class Held(NamedTuple):
    """The resources that a node holds after so many incidents."""

    incidents: int
    node: str
    rss_kb: float
    threads: float
    descriptors: float


def held(incidents: int, node: str) -> Held:
    """Return the resources that a node holds now. Raises AssertionError if it is not up."""
    process = node_process(node)
    assert process is not None, f"{node} is not up"
    rss = process.memory_info().rss / 1024.0
    return Held(incidents, node, rss, process.num_threads(), process.num_fds())


class Robot:
    """A steady node, those that fail, and healing."""

    def __init__(self, graph: Graph) -> None:
        self._graph = graph
        self.topics = [f"/lost_{number}" for number in range(AT_ONCE)]
        self.ended: Dict[int, str] = {}
        rospy.Subscriber("/shsa/incidents", Incident, self._incident, queue_size=1000)
        graph.cpp("talker", "/steady", str(PERIOD_S), "__name:=steady")
        self._nodes = {topic: self._start(topic) for topic in self.topics}
        services = [service("/steady", "/steady", PERIOD_S)]
        for number, topic in enumerate(self.topics):
            standby = "cold" if number < COLD else "hot"
            node = topic + "_node"
            services.append(service(topic, node, PERIOD_S, needed=True, standby=standby))
        names = ["steady", *(topic[1:] for topic in self.topics)]
        model = {
            "properties": {name: {"unit": "m"} for name in names},
            "relations": {f"r_{name}": {name: "steady"} for name in names[1:]},
        }
        ontology = graph.folder / "ontology.yaml"
        ontology.write_text(json.dumps(model))
        som = write_som(graph.folder / "som.yaml", services)
        files = f"ontology:={ontology}", f"som:={som}"
        graph.start("roslaunch", "shsa_core", "shsa.launch", *files, *TIRELESS)
        self.await_well()

    def _incident(self, incident: Incident) -> None:
        if incident.state == "ended":
            self.ended[incident.id] = incident.topic

    def _start(self, topic: str) -> "subprocess.Popen[str]":
        name = f"__name:={topic[1:]}_node"
        return self._graph.cpp("talker", topic, str(PERIOD_S), name)

    def await_well(self) -> None:
        """Wait until all is well, and the hot substitutes are there."""
        healing = self._graph.healing
        healing.await_available("/steady", *self.topics, seconds=PATIENCE_S)
        hot = AT_ONCE - COLD

        def ready() -> bool:
            rows = {row.node for row in healing.substitutions if row.service}
            return len(rows) == hot and rows <= {*registered_nodes()}

        wait_until(ready, PATIENCE_S, "the hot substitutes")

    def fail_once(self) -> None:
        """Every node fails, is healed and comes back."""
        healing, ended = self._graph.healing, len(self.ended)
        for process in self._nodes.values():
            process.kill()
            process.wait()
        for topic in self.topics:
            healing.await_state(topic, "healed", PATIENCE_S)
        self._nodes = {topic: self._start(topic) for topic in self.topics}
        done = lambda: len(self.ended) >= ended + AT_ONCE
        wait_until(done, PATIENCE_S, "the incidents have ended")
        self.await_well()


def grown(rows: Iterable[Held]) -> List[List[str]]:
    """Print what each node held in the two halves, and the verdict."""
    table = []
    for node in NODES:
        of_node = [row for row in rows if row.node == node][WARM_UP:]
        half = len(of_node) // 2
        for name, allowed in ALLOWED.items():
            first, second = (
                median(getattr(row, name) for row in part)
                for part in (of_node[:half], of_node[half:])
            )
            verdict = "flat" if second - first <= allowed else "GROWS"
            table.append([node, name, f"{first:.0f}", f"{second:.0f}", verdict])
    return table


def main() -> int:
    """Measure, write and show."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--incidents", type=int, default=10_000)
    parser.add_argument("--short", action="store_true", help="160 incidents")
    parser.add_argument("--results", default="results/bench")
    arguments = parser.parse_args()
    wanted = 160 if arguments.short else arguments.incidents
    folder = Path(arguments.results)
    folder.mkdir(parents=True, exist_ok=True)
    rows: List[Held] = []
    begun = time.monotonic()
    with Graph() as graph, open(folder / "endurance.csv", "w", newline="") as file:
        writer = csv.writer(file)
        writer.writerow(Held._fields)
        robot, count = Robot(graph), 0
        while count < wanted:
            robot.fail_once()
            count += AT_ONCE
            new = [held(count, node) for node in NODES]
            rows += new
            writer.writerows(new)
            file.flush()
            if count % (10 * AT_ONCE) == 0:
                print(f"{count} incidents in {time.monotonic() - begun:.0f} s", flush=True)
    table = grown(rows)
    columns = ("node", "what", "first half", "second half", "verdict")
    print_table(f"{count} incidents", columns, table)
    return int(any(row[-1] != "flat" for row in table))


if __name__ == "__main__":
    sys.exit(main())
