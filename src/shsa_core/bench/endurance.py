"""Many incidents, one after the other: does healing grow?

    python3 endurance.py [--incidents N] [--short] [--results DIR]

Nodes are killed with `kill -9`, healed, and started again, several at a time: most have a hot
substitute. After each round it is noted what monitor, reconfigurator, the hot substitutes and the
process that forks others hold: memory, threads, descriptors. Writes endurance.csv. Exit status 1 if
anything has grown from the first half to the second.
"""
import argparse
import csv
import json
import subprocess
import sys
import time
from pathlib import Path
from statistics import median
from typing import Dict, Iterator, List, NamedTuple, Sequence, Tuple

import psutil
import rospy
from shsa_msgs.msg import Incident

from graph import Graph, service, write_som
from report import print_table
from shsa_testing.graph import node_process, registered_nodes
from shsa_testing.waiting import wait_until

PERIOD_S = 0.02
AT_ONCE = 8
STANDBY = ("cold", "warm", *("hot",) * 6)
"""Of the nodes that fail: a process is made for each incident of the first."""
PATIENCE_S = 60.0
NODES = ("/monitor", "/reconfigurator")
PREPARED = "prepared"
WARM_UP = 5
"""Rounds: memory that Python and rospy take once and keep."""
ALLOWED = {"rss_kb": 1024.0, "threads": 2.0, "descriptors": 4.0}
"""Growth that is allowed from the first half to the second, by medians: a trend."""
TIRELESS = "hold_off:=0.3", "switches:=0"


class Held(NamedTuple):
    """The resources that a process holds after so many incidents; a substitute by its service."""

    process: str
    incidents: int
    rss_kb: float
    threads: float
    descriptors: float


def held(name: str, process: psutil.Process, incidents: int) -> Held:
    """Return the resources that a process holds now."""
    rss = process.memory_info().rss / 1024.0
    return Held(name, incidents, rss, process.num_threads(), process.num_fds())


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
            node, standby = topic + "_node", STANDBY[number]
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

        def ready() -> bool:
            hot = self._hot()
            return len(hot) == STANDBY.count("hot") and {*hot.values()} <= {*registered_nodes()}

        wait_until(ready, PATIENCE_S, "the hot substitutes")

    def _hot(self) -> Dict[str, str]:
        """Return the hot substitutes by their services."""
        hot = {topic[1:] for topic, how in zip(self.topics, STANDBY) if how == "hot"}
        rows = self._graph.healing.substitutions
        return {row.service: row.node for row in rows if row.service in hot}

    def processes(self) -> Iterator[Tuple[str, psutil.Process]]:
        """Yield what goes on from incident to incident. Raises AssertionError if it is not up."""
        for name, node in (*zip(NODES, NODES), *sorted(self._hot().items())):
            process = node_process(node)
            assert process is not None, f"{node} is not up"
            yield name, process
        for process in self._graph.processes():
            if "--prepared" in process.cmdline():
                yield PREPARED, process

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


def grown(rows: Sequence[Held]) -> List[List[str]]:
    """Return what each process held in the two halves, and the verdict."""
    table = []
    for name in dict.fromkeys(row.process for row in rows):
        later = [row for row in rows if row.process == name][WARM_UP:]
        half = len(later) // 2
        for what, allowed in ALLOWED.items():
            first, second = (
                median(getattr(row, what) for row in part) for part in (later[:half], later[half:])
            )
            verdict = "flat" if second - first <= allowed else "GROWS"
            table.append([name, what, f"{first:.0f}", f"{second:.0f}", verdict])
    return table


def main() -> int:
    """Measure, write and show."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--incidents", type=int, default=10_000)
    parser.add_argument("--short", action="store_true", help="96 incidents")
    parser.add_argument("--results", default="results/bench")
    arguments = parser.parse_args()
    wanted = 96 if arguments.short else arguments.incidents
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
            new = [held(*each, count) for each in robot.processes()]
            rows += new
            writer.writerows(new)
            file.flush()
            if count % (10 * AT_ONCE) == 0:
                print(f"{count} incidents in {time.monotonic() - begun:.0f} s", flush=True)
    table = grown(rows)
    columns = ("process", "what", "first half", "second half", "verdict")
    print_table(f"{count} incidents", columns, table)
    return int(any(row[-1] != "flat" for row in table))


if __name__ == "__main__":
    sys.exit(main())
