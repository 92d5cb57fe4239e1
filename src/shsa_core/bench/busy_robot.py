"""Healthy nodes on a computer that is busy: is anybody ended, or substituted beside a living node?

Nine rospy nodes publish at 4 to 100 Hz, each healed by a substitute of its own, beside as many busy
processes as there are to be and a topic of 20 MB/s. Writes busy_robot.csv and busy_robot_goals.csv;
ends with status 1 if anything was done to a healthy node.
"""
import argparse
import os
import sys
import time
from pathlib import Path
from typing import Dict, List, NamedTuple, Tuple

import yaml  # type: ignore[import]

from graph import BENCH, FAULTY_PUBLISHER, PATIENCE_S, Graph
from report import Goals, print_table, write_table
from shsa_core.healing.incident import State
from shsa_core.ros.processes.kernel import waited_in_all

RATES = (4.0, 5.0, 10.0, 20.0, 25.0, 30.0, 50.0, 50.0, 100.0)  # Hz
STANDBYS = ("warm", "warm", "hot")
IMAGE_B, IMAGE_PERIOD_S = 1_000_000, 0.05
PRESSURE = "/proc/pressure/cpu"


class Row(NamedTuple):
    """What was done to healthy nodes; `waited`: share of the time in which something waited."""

    busy: int
    seconds: float
    waited: float
    blamed: int
    substituted: int
    ended: int


def models(folder: Path) -> Tuple[Path, Path]:
    """Write the ontology and the SOM of the robot: each value can be computed from the next."""
    names = [f"s{number}" for number in range(len(RATES))]
    properties = {name: {"unit": ""} for name in names}
    relations = {f"r_{a}": {a: f"1 * {b}"} for a, b in zip(names, names[1:] + names[:1])}
    services: Dict[str, object] = {}
    for number, (name, rate) in enumerate(zip(names, RATES)):
        services[name] = {
            "topic": f"/{name}",
            "type": "shsa_msgs/Float64Stamped",
            "node": f"/node_{name}",
            "period": 1.0 / rate,
            "needed": True,
            "standby": STANDBYS[number % len(STANDBYS)],
            "provides": {name: {"field": "data", "range": [-100.0, 100.0]}},
        }
    files = folder / "ontology.yaml", folder / "som.yaml"
    files[0].write_text(yaml.safe_dump({"properties": properties, "relations": relations}))
    files[1].write_text(yaml.safe_dump({"act": True, "services": services}))
    return files


def measure(busy: int, seconds: float) -> Row:
    """Run the robot for a while beside `busy` processes."""
    with Graph() as graph:
        for number, rate in enumerate(RATES):
            node, topic = f"__name:=node_s{number}", f"_topic:=/s{number}"
            graph.python(FAULTY_PUBLISHER, node, topic, f"_period:={1.0 / rate}", "_noise:=0.01")
        ontology, som = models(graph.folder)
        graph.start("roslaunch", "shsa_core", "shsa.launch", f"ontology:={ontology}", f"som:={som}")
        topics = [f"/s{number}" for number in range(len(RATES))]
        graph.healing.await_available(*topics, seconds=2 * PATIENCE_S)
        large = str(IMAGE_B), str(IMAGE_PERIOD_S)
        graph.python(BENCH / "large_source.py", "/camera", *large, "__name:=camera")
        graph.start("rostopic", "bw", "/camera")
        graph.start_busy(busy)
        return _watched(graph, busy, seconds)


def _watched(graph: Graph, busy: int, seconds: float) -> Row:
    nodes = {
        word.partition(":=")[2]: process
        for process in graph.processes()
        for word in process.cmdline()
        if word.startswith("__name:=node_")
    }
    begun, before = time.monotonic(), dict(waited_in_all(PRESSURE)).get("", 0.0)
    told = set(graph.healing.incidents)
    substituted: Dict[Tuple[str, int], str] = {}
    while time.monotonic() < begun + seconds:
        time.sleep(0.1)
        for incident in list(graph.healing.incidents.values()):
            if incident.id not in told and incident.state == State.HEALED:
                substituted[incident.topic, incident.id] = incident.substitute
    found = [each for each in graph.healing.incidents.values() if each.id not in told]
    for each in found:
        what = f"{each.topic}: {each.faulty_node}: {each.kind}: {each.evidence}; {each.decision}"
        print(what)
    ended = [name for name, process in nodes.items() if not process.is_running()]
    for name in ended:
        print(f"{name} was ended")
    passed = time.monotonic() - begun
    waited = (dict(waited_in_all(PRESSURE)).get("", 0.0) - before) / passed
    return Row(busy, passed, waited, len(found), len(substituted), len(ended))


def main() -> int:
    """Measure, print the verdict, write the CSV files."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--seconds", type=float, default=180.0, help="of each row")
    parser.add_argument("--busy", type=int, nargs="+", default=[0, 4, 8], help="processes")
    parser.add_argument("--short", action="store_true", help="20 s beside 8, as a check")
    parser.add_argument("--results", type=Path, default=Path("results/bench"))
    options = parser.parse_args()
    options.results.mkdir(parents=True, exist_ok=True)
    seconds, counts = (20.0, [8]) if options.short else (options.seconds, options.busy)
    rows: List[Row] = [measure(busy, seconds) for busy in counts]
    table = [[str(r.busy), f"{r.seconds:.0f}", f"{r.waited:.2f}", *map(str, r[3:])] for r in rows]
    title = f"Nine healthy nodes on {os.cpu_count()} cores"
    print_table(title, Row._fields, table)
    write_table(options.results / "busy_robot.csv", Row._fields, rows)
    goals = Goals()
    for row in rows:
        for what in ("substituted", "ended"):
            goals.at_most(f"{row.busy} busy: {what}", "rospy", 0, getattr(row, what), "")
    goals.show(options.results / "busy_robot_goals.csv")
    return int(any(row.substituted or row.ended for row in rows))


if __name__ == "__main__":
    sys.exit(main())
