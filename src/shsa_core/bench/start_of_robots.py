"""The start of healing on robots of many warm or hot topics: does it blame or kill what is healthy?

    python3 start_of_robots.py [--topics N ...] [--standby warm|hot ...] [--starts N]
                               [--seconds S] [--results DIR]

The robot runs, at 20 Hz or, where that were more, with 2,000 messages a second, and is well; then
healing starts beside it, and both are looked at until all is up, and for a while longer. An
independent consumer in plain sockets notes each pause of the robot's topics, so that a failure that
is told can be held against what really happened. Writes start_of_robots.json.
"""
import argparse
import json
import sys
import time
from concurrent.futures import ProcessPoolExecutor
from itertools import product
from pathlib import Path
from typing import Any, Dict, List, NamedTuple, Tuple

import rospy
from shsa_msgs.msg import Failure

from graph import Graph, ask_to_leave, service, write_som
from probe import STARTUP_S, Probe
from report import print_table
from shsa_testing.graph import registered_nodes
from shsa_testing.healing import HealedRobot
from shsa_testing.waiting import wait_until

MANY_TOPICS = (sys.executable, "-m", "shsa_testing.many_topics")
PERIOD_S, MOST_HZ = 0.05, 2000.0
LEAST_PERIODS = 2.0
DEADLINE_S = 0.25


class Start(NamedTuple):
    """The events of one start; times in s.

    `real`: failures by silence for which the consumer saw the same pause. `ready`: until all the
    processes were registered that wait for a failure; `longest`: the longest pause before and
    after healing was started, of more than two periods.
    """

    topics: int
    standby: str
    failures: int
    real: int
    killed: int
    incidents: int
    ready: float
    before: float
    longest: float
    pauses: int
    told: List[str]


def saw(probe: Probe, topic: str, at: float) -> bool:
    """Return whether a topic paused for the deadline around a moment."""
    return any(
        t == topic and b - 0.1 <= at <= e + 0.1 and e - b > 0.9 * DEADLINE_S
        for t, b, e in list(probe.pauses)
    )


def write_models(
    graph: Graph, count: int, a_node: int, period: float, standby: str
) -> Tuple[Path, Path]:
    """Let each topic be computed from the one of the same place in the next node."""
    services, relations = [], {}
    for number in range(count):
        topic, node = f"/stream_{number}", f"/many_{number // a_node * a_node}"
        services.append(service(topic, node, period, needed=True, standby=standby))
        other = f"stream_{(number + a_node) % count}"
        relations[f"r_{number}"] = {f"stream_{number}": f"2*{other}"}
    properties = {f"stream_{number}": {"unit": "m"} for number in range(count)}
    ontology = graph.folder / "ontology.yaml"
    ontology.write_text(json.dumps({"properties": properties, "relations": relations}))
    return ontology, write_som(graph.folder / "som.yaml", services)


def start(count: int, standby: str, a_node: int, seconds: float) -> Start:
    """One robot, and one start of healing beside it."""
    a_node = min(a_node, max(1, count // 2))  # a topic is computed from another node's
    period = pace(count)
    with Graph() as graph:
        nodes = [
            graph.start(*MANY_TOPICS, str(first), str(a_node), str(period))
            for first in range(0, count, a_node)
        ]
        topics = [f"/stream_{number}" for number in range(count)]
        there = lambda: {topic for topic, _ in rospy.get_published_topics()} >= set(topics)
        wait_until(there, STARTUP_S, "the robot is up")
        probe = Probe(graph, topics, LEAST_PERIODS * period)
        healing = graph.healing
        failures: List[Tuple[float, Failure]] = []
        rospy.Subscriber(
            "/shsa/failures", Failure, lambda each: failures.append((time.monotonic(), each))
        )
        time.sleep(5.0)
        begun = time.monotonic()
        ontology, som = write_models(graph, count, a_node, period, standby)
        launch = graph.start(
            *("roslaunch", "shsa_core", "shsa.launch"),
            *(f"ontology:={ontology}", f"som:={som}"),
            f"incident_log:={graph.folder / 'incidents.jsonl'}",
        )
        wanted = 2 if standby == "warm" else count

        def is_up() -> bool:
            time.sleep(0.5)  # the master has others to answer
            return up(healing, standby) >= wanted

        wait_until(is_up, STARTUP_S, f"{wanted} substitutes are up")
        ready = time.monotonic() - begun
        time.sleep(seconds)
        end = time.monotonic()
        killed = sum(process.poll() is not None for process in nodes)
        told = [
            f"{at - begun:.2f} s: {each.publisher} on {each.topic}: {each.kind}: {each.detail}"
            for at, each in failures
        ]
        silent = [(at, each) for at, each in failures if each.kind == "silent"]
        found = Start(
            count,
            standby,
            len(failures),
            sum(saw(probe, each.topic, at) for at, each in silent),
            killed,
            len(healing.incidents),
            ready,
            probe.longest(0.0, begun),
            probe.longest(begun, end),
            sum(e - b > DEADLINE_S for _, b, e in probe.pauses),
            told,
        )
        for line in told[:5]:
            print("   ", line, flush=True)
        for topic, b, e in sorted(probe.pauses, key=lambda each: each[1] - each[2])[:5]:
            print(f"    pause of {topic}: {b - begun:.2f} to {e - begun:.2f} s", flush=True)
        worst = max((e - b for b, e in probe.late), default=0.0)
        print(f"    the consumer itself was late by {worst:.3f} s at most", flush=True)
        ask_to_leave(launch, 30.0)
        return found


def pace(count: int) -> float:
    """Return the period of the topics of a robot in s."""
    return max(PERIOD_S, count / MOST_HZ)


def up(healing: HealedRobot, standby: str) -> int:
    """Count registered substitutes, or topics that have theirs; some share a process."""
    names = set(registered_nodes())
    if standby == "warm":
        return sum(name.startswith("/substitute_") for name in names)
    nodes = {row.service: row.node for row in healing.substitutions if row.service}
    return sum(node in names for node in nodes.values())


def main() -> int:
    """Start robots; 1 if anything healthy was killed."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--topics", type=int, nargs="+", default=[10, 100, 300])
    modes = ["warm", "hot"]
    parser.add_argument("--standby", nargs="+", choices=modes, default=modes)
    parser.add_argument("--a-node", type=int, default=10, help="topics a node")
    parser.add_argument("--starts", type=int, default=20, help="starts of each robot")
    parser.add_argument(
        "--seconds", type=float, default=10.0, help="so long it is looked at once it is up"
    )
    parser.add_argument("--results", type=Path, default=Path("results/bench"))
    options = parser.parse_args()
    options.results.mkdir(parents=True, exist_ok=True)
    rows: List[Start] = []
    robots = product(options.topics, options.standby, range(options.starts))
    for count, standby, _ in robots:
        # A ROS node cannot start twice in one process.
        with ProcessPoolExecutor(1) as once:
            what = (count, standby, options.a_node, options.seconds)
            rows.append(once.submit(start, *what).result())
        show = [[str(getattr(row, name)) for name in COLUMNS] for row in rows]
        print_table("Starts of healing", COLUMNS, show)
        document: List[Dict[str, Any]] = [row._asdict() for row in rows]
        path = options.results / "start_of_robots.json"
        path.write_text(json.dumps(document, indent=1) + "\n")
    return 1 if any(row.killed or row.incidents for row in rows) else 0


COLUMNS = tuple(name for name in Start._fields if name != "told")

if __name__ == "__main__":
    sys.exit(main())
