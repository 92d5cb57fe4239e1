"""Large robots: what healing takes of them at rest, and how soon it heals one of their topics.

A live robot of 10, 100 and 300 topics, all needed, each computable from another, with warm or hot
substitutes, and of 1,000 with warm ones; at 20 Hz, or where that were more, so that they are 2,000
messages a second. The node of one topic, at 20 Hz, is killed with `kill -9`, again and again; the
outage is that at two consumers. At rest: the share of a core that monitor, reconfigurator and
substitutes take, by the kernel's count, and the memory of an idle process, or of a hot topic (PSS:
what several share is divided among them). Nothing else may be killed, and no other incident be
opened. Writes results/bench/large_robots.csv.
"""
import json
import os
import signal
import subprocess
import sys
import time
from concurrent.futures import ProcessPoolExecutor
from itertools import product
from pathlib import Path
from typing import Dict, List, NamedTuple, Tuple

import numpy as np
import psutil
import rospy

from graph import Graph, ask_to_leave, service, write_som
from report import Goals, arguments, in_words, print_table, write_table
from robot import HOLD_OFF_S, POOL, TIRELESS, Consumers
from shsa_testing.graph import is_connected, node_pid
from shsa_testing.waiting import wait_until
from start_of_robots import MANY_TOPICS, PERIOD_S, pace, up
from takeover import NEVER, measured

SIZES = (10, 100, 300)
MODES = ("warm", "hot")
ROBOTS = (*product(SIZES, MODES), (1000, "warm"))
A_NODE = 20
TOPIC, NODE = "/stream_0", "/many_0"
PATIENCE_S = 120.0
SETTLING_TIME_S, REST_S, SHORT_REST_S = 3.0, 5.0, 1.0
ESTABLISHED, CALLS = " 01 ", 0.02  # such a share of them comes and goes: calls of the master
GOAL_GROWTH, GOAL_PSS_MB = 1.5, 10.0
COLUMNS = (
    *("topics", "standby", "failure", "rospy_outage_ms", "roscpp_outage_ms"),
    *("ready_s", "monitor_percent", "reconfigurator_percent", "substitutes_percent"),
    *("substitutes", "forked", "pss_mb", "prepared_pss_mb", "other_incidents", "killed", "load"),
)


class Rest(NamedTuple):
    """Healing while nothing fails: shares of a core in %, memory in MB.

    `number` of processes, of which so many were `forked`; `pss`: of an idle one, or a hot topic.
    """

    monitor: float
    reconfigurator: float
    substitutes: float
    number: int
    forked: int
    pss: float
    prepared_pss: float


class Found(NamedTuple):
    """The results of one robot.

    `outages` at the rospy consumer and the roscpp one, in ms. `ready`: until all was up that stands
    by, in s. `others`: incidents that nobody caused; `killed`: nodes that nobody asked to be.
    """

    outages: List[Tuple[float, float]]
    ready: float
    rest: Rest
    others: int
    killed: int
    load: float


class LargeRobot:
    """A node of one topic, which fails, beside nodes of many; then healing beside them."""

    def __init__(self, graph: Graph, count: int, standby: str) -> None:
        self._graph, self._standby = graph, standby
        most = a_node(count)
        firsts = range(1, count, most)
        self._failing = self._node(0, 1, PERIOD_S)
        self._others = [self._node(n, min(most, count - n), pace(count)) for n in firsts]
        topics = {f"/stream_{number}" for number in range(count)}
        there = lambda: {topic for topic, _ in rospy.get_published_topics()} >= topics
        wait_until(there, PATIENCE_S, "the robot is up")
        self._consumers = Consumers(graph, TOPIC)
        self._consumers.await_node(NODE, time.monotonic())
        self.healing = graph.healing
        ontology, som = write_model(graph, count, standby)
        begun = time.monotonic()
        self._launch = graph.start(
            *("roslaunch", "shsa_core", "shsa.launch", f"ontology:={ontology}", f"som:={som}"),
            *(f"hold_off:={HOLD_OFF_S}", f"pool:={POOL}", TIRELESS),
            f"incident_log:={graph.folder / 'incidents.jsonl'}",
        )
        self._stands_by = POOL if standby == "warm" else count
        wait_until(self._ready, PATIENCE_S, f"{self._stands_by} substitutes are up")
        self.ready = time.monotonic() - begun
        self._await_well()

    def _node(self, first: int, count: int, period: float) -> "subprocess.Popen[str]":
        return self._graph.start(*MANY_TOPICS, str(first), str(count), str(period))

    def _ready(self) -> bool:
        time.sleep(0.1)  # the master has others to answer
        return up(self.healing, self._standby) >= self._stands_by

    def _await_well(self) -> None:
        """Wait until nothing is open, and what stands by is ready for the next failure."""
        healing = self.healing
        is_over = lambda: all(each.state == "ended" for each in list(healing.incidents.values()))
        wait_until(is_over, PATIENCE_S, "the incident's end")
        healing.await_available(TOPIC, seconds=PATIENCE_S)
        self._consumers.await_node(NODE, time.monotonic())
        wait_until(self._ready, PATIENCE_S, "what stands by is as it should be")
        wait_until(self._served, PATIENCE_S, "what stands by is connected")
        await_connections()

    def _served(self) -> bool:
        """Return whether both consumers are connected to all that may publish next."""
        time.sleep(0.1)
        service = TOPIC[1:] if self._standby == "hot" else ""
        nodes = [row.node for row in self.healing.substitutions if row.service == service]
        return bool(nodes) and all(
            is_connected(each.node, TOPIC, node) for each in self._consumers for node in nodes
        )

    def fail(self) -> Tuple[float, float]:
        """Fail once, and come back: the outages at the two consumers, in ms."""
        known = len(self.healing.incidents)
        for each in self._consumers:
            each.forget()
        time.sleep(np.random.uniform(10.0, 11.0) * PERIOD_S)  # at any moment of a period
        failed_at = time.monotonic()
        os.kill(self._failing.pid, signal.SIGKILL)
        look = lambda: measured(self._consumers, failed_at, time.monotonic(), PERIOD_S)
        wait_until(lambda: len(self.healing.incidents) > known, PATIENCE_S, "an incident")
        wait_until(lambda: look().over_ms != NEVER, PATIENCE_S, "the topic is as it was")
        outage = look()
        self._failing.wait()
        self._failing = self._node(0, 1, PERIOD_S)
        self._await_well()
        return outage.rospy_ms, outage.roscpp_ms

    def rest(self, seconds: float) -> Rest:
        """Return what healing takes while nothing fails."""
        processes = self._graph.processes()
        prepared = [each for each in processes if "--prepared" in each.cmdline()]
        substitutes = [each for each in processes if is_substitute(each)]
        groups = [[psutil.Process(node_pid(name))] for name in ("/monitor", "/reconfigurator")]
        groups.append(substitutes)
        before, begun = [sum(map(cpu_time, group)) for group in groups], time.monotonic()
        time.sleep(seconds)
        spent = [sum(map(cpu_time, group)) - b for group, b in zip(groups, before)]
        shares = [100.0 * each / (time.monotonic() - begun) for each in spent]
        forked = sum(each.ppid() in {p.pid for p in prepared} for each in substitutes)
        sizes = [[pss(each.pid) for each in group] for group in (substitutes, prepared)]
        number = self._stands_by if self._standby == "hot" else len(substitutes)
        memory = [sum(sizes[0]) / number, float(np.mean(sizes[1] or [0.0]))]
        monitor, reconfigurator, spent_by_all = shares
        return Rest(monitor, reconfigurator, spent_by_all, len(substitutes), forked, *memory)

    @property
    def killed(self) -> int:
        """Count the nodes that have ended."""
        return sum(each.poll() is not None for each in (self._failing, *self._others))

    def end(self) -> None:
        """Stop healing; the rest ends with the graph."""
        ask_to_leave(self._launch, 30.0)


def write_model(graph: Graph, count: int, standby: str) -> Tuple[Path, Path]:
    """Ontology and SOM: each topic can be computed from the one half the robot away."""
    services = []
    for n in range(count):
        period = pace(count) if n else PERIOD_S
        whose = owner(n, a_node(count))
        services.append(service(f"/stream_{n}", whose, period, needed=True, standby=standby))
    laws = {f"r_{n}": {f"stream_{n}": f"2*stream_{(n + count // 2) % count}"} for n in range(count)}
    properties: Dict[str, object] = {f"stream_{number}": {} for number in range(count)}
    ontology = graph.folder / "ontology.yaml"
    ontology.write_text(json.dumps({"properties": properties, "relations": laws}))
    return ontology, write_som(graph.folder / "som.yaml", services)


def a_node(count: int) -> int:
    """The topics of a node: no more than leave a topic and what it is computed from to two."""
    return min(A_NODE, count // 2)


def owner(number: int, most: int) -> str:
    """Return the node of a topic."""
    return NODE if number == 0 else f"/many_{(number - 1) // most * most + 1}"


def await_connections() -> None:
    """Wait until hardly any are made or ended: that goes on for long after all is up."""
    known, settled = 0, time.monotonic()

    def is_settled() -> bool:
        nonlocal known, settled
        time.sleep(0.5)
        now = Path("/proc/net/tcp").read_text().count(ESTABLISHED)
        if abs(now - known) > CALLS * now:
            known, settled = now, time.monotonic()
        return time.monotonic() - settled > SETTLING_TIME_S

    wait_until(is_settled, PATIENCE_S, "what stands by has its connections")


def is_substitute(process: psutil.Process) -> bool:
    """Return whether a process is one, by its command line."""
    return any(word.startswith("__name:=substitute_") for word in process.cmdline())


def cpu_time(process: psutil.Process) -> float:
    """Return the CPU time of all of its threads, of those that have ended as well, in s."""
    return sum(process.cpu_times()[:2])


def pss(pid: int) -> float:
    """Return the memory of a process in MB, what it shares divided among those who share it."""
    for line in Path(f"/proc/{pid}/smaps_rollup").read_text().splitlines():
        if line.startswith("Pss:"):
            return int(line.split()[1]) / 1024.0
    raise ValueError(f"/proc/{pid}/smaps_rollup has no line Pss:")


def measure(count: int, standby: str, failures: int, seconds: float) -> Found:
    """One robot. Raises AssertionError if a failure is not healed."""
    with Graph() as graph:
        try:
            robot = LargeRobot(graph, count, standby)
            rest = robot.rest(seconds)
            load = os.getloadavg()[0]
            outages = [robot.fail() for _ in range(failures)]
        except AssertionError:
            print(graph.last_words(), file=sys.stderr, flush=True)
            raise
        others = len(robot.healing.incidents) - failures
        found = Found(outages, robot.ready, rest, others, robot.killed, load)
        robot.end()
        return found


def main() -> int:
    """Measure, print and judge; 1 if a robot was not healed, or healing did any harm."""
    options = arguments(
        str(__doc__),
        *("failures", 20),
        short="10 topics, warm, one failure",
    )
    rows = [
        (count, standby)
        for count, standby in (ROBOTS[:1] if options.short else ROBOTS)
        if any(part in f"{count} {standby}" for part in options.only)
    ]
    failures, seconds = (1, SHORT_REST_S) if options.short else (options.failures, REST_S)
    found: Dict[Tuple[int, str], Found] = {}
    misses = 0
    for count, standby in rows:
        with ProcessPoolExecutor(1) as once:  # a ROS node cannot start twice in one process
            try:
                robot = once.submit(measure, count, standby, failures, seconds).result()
            except AssertionError as error:
                print(f"{count} {standby}: missed: {error}", flush=True)
                misses += 1
                continue
        found[count, standby] = robot
        write_table(options.results / "large_robots.csv", COLUMNS, table(found))
        show(found)
    judge(found).show(options.results / "large_robots_goals.csv")
    harmed = any(each.others or each.killed for each in found.values())
    return 1 if misses or harmed else 0


def table(found: Dict[Tuple[int, str], Found]) -> List[Tuple[object, ...]]:
    """Return a row for each failure."""
    return [
        (
            *(count, standby, number, *(f"{each:.1f}" for each in outage), f"{robot.ready:.2f}"),
            *(f"{each:.2f}" if isinstance(each, float) else each for each in robot.rest),
            *(robot.others, robot.killed, f"{robot.load:.1f}"),
        )
        for (count, standby), robot in found.items()
        for number, outage in enumerate(robot.outages, 1)
    ]


def show(found: Dict[Tuple[int, str], Found]) -> None:
    """Print the outages and what healing takes."""
    lines = []
    for (count, standby), robot in found.items():
        rest = robot.rest
        outages = [in_words(each) for each in zip(*robot.outages)]
        shares = [f"{each:.1f}" for each in rest[:3]]
        memory = [f"{rest.forked} of {rest.number}", f"{rest.pss:.1f}"]
        harm = f"{robot.others}, {robot.killed}"
        ready, load = f"{robot.ready:.1f}", f"{robot.load:.1f}"
        lines.append((f"{count} {standby}", *outages, ready, *shares, *memory, harm, load))
    columns = (
        *("topics", "rospy, ms", "roscpp, ms", "ready, s", "monitor, %", "reconfigurator, %"),
        *("substitutes, %", "forked", "PSS, MB", "incidents, kills", "load"),
    )
    print_table("Large robots; outages: median / p95 / max", columns, lines)


def judge(found: Dict[Tuple[int, str], Found]) -> Goals:
    """Return the goals of what was measured."""
    goals = Goals()
    small, large = SIZES[0], SIZES[-1]
    for standby in MODES:
        if (small, standby) in found and (large, standby) in found:
            pairs = [zip(*found[count, standby].outages) for count in (small, large)]
            for consumer, few, many in zip(("rospy", "roscpp"), *pairs):
                growth = float(np.median(many) / np.median(few))
                goal = f"{standby}: p50 at {large} over that at {small}"
                goals.at_most(goal, consumer, GOAL_GROWTH, growth, "")
    if (100, "hot") in found:
        size = found[100, "hot"].rest.pss
        goals.at_most("100 hot: PSS of each", "", GOAL_PSS_MB, size, "MB")
    for (count, standby), robot in found.items():
        name = f"{count} {standby}: incidents and kills unasked"
        goals.at_most(name, "", 0, robot.others + robot.killed, "")
    return goals


if __name__ == "__main__":
    sys.exit(main())
