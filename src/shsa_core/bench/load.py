"""Faults on a computer that is not quiet: what consumers hear, beside roslaunch's `respawn="true"`.

Nodes of two robots fail, one of nine rospy nodes in a namespace and the rover, while nothing else
runs, beside busy processes, and beside a topic of 20 MB/s. A rospy and a roscpp consumer hear every
topic that fails. A node is started again once its substitute is heard, so that each trial has a
return as well. Writes load.csv (a row a trial) and load_goals.csv.

outage: the longest pause between good messages, from the last one before the fault on. hole: the
longest pause around the return, in periods. beside: messages of one publisher less than half a
period after one of another. unframed: messages without the frame that the original has. old:
messages that were stamped before one that came earlier. ended: other nodes that were gone after it.
"""
import math
import os
import random
import signal
import subprocess
import sys
import time
from contextlib import suppress
from typing import Callable, Dict, Iterator, List, NamedTuple, Sequence, Tuple

from tqdm import tqdm

from faults import Patient
from graph import BENCH, PATIENCE_S, Graph, ask_to_leave
from load_robots import CAUSES, ENDED, FRAME, LIMIT, RESPAWN, STANDBY, NineNodes, Robot, Rover
from load_robots import Target
from report import Goals, arguments, in_words, print_table, summary, write_table
from robot import HOLD_OFF_S, Consumer, Consumers, Heard
from shsa_core.ros.master.node_api import FAILURES
from shsa_testing.faulty_publisher import FaultHandle
from shsa_testing.graph import is_connected, node_pid, registered_nodes
from shsa_testing.waiting import wait_until
from takeover import NEVER, watched

PERIOD_S = 0.02
IMAGE = ("/image", "1000000", "0.05")
LOADS = {"quiet": 0, "4 busy": 4, "8 busy": 8, "20 MB/s": 0}
AROUND_S = 1.0
HEALED_S = 20.0
SETTINGS = (f"hold_off:={HOLD_OFF_S}", "minimum_deadline:=0.1", "switches:=0")
GOALS = {
    "quiet": {"hot": (28.0, 60.0), "warm": (35.0, 110.0)},
    "8 busy": {"hot": (60.0, 120.0), "warm": (200.0, 250.0)},
}
"""The 95th percentile of an outage in ms at most: of a crash, and of every other fault."""


class Trial(NamedTuple):
    """A fault and its end; times in ms. The counts are those of both consumers."""

    robot: str
    load: str
    standby: str
    fault: str
    rospy: float
    roscpp: float
    detected: float = math.nan
    kind: str = ""
    hole: float = math.nan
    beside: int = 0
    unframed: int = 0
    old: int = 0
    ended: int = 0

    @property
    def key(self) -> Tuple[str, str, str, str]:
        """Return what it is a trial of."""
        return self.robot, self.load, self.standby, self.fault


def judged(heard: Sequence[Heard], framed: bool) -> Dict[str, int]:
    """Count what no consumer should hear."""
    pairs = list(zip(heard, heard[1:]))
    near = [(a, b) for a, b in pairs if a.node != b.node and b.at - a.at < PERIOD_S / 2.0]
    newest, old = 0.0, 0
    for each in heard:
        old += each.stamp < newest
        newest = max(newest, each.stamp)
    unframed = sum(each.frame != FRAME for each in heard) if framed else 0
    return {"beside": len(near), "unframed": unframed, "old": old}


def hole(heard: Sequence[Heard], node: str) -> float:
    """Return the longest pause around the first message of a node, in periods."""
    first = next(each.at for each in heard if each.node == node)
    near = [each.at for each in heard if abs(each.at - first) < AROUND_S]
    return max(b - a for a, b in zip(near, near[1:])) / PERIOD_S


class Bench:
    """A robot with consumers, beside a `load`."""

    def __init__(self, graph: Graph, robot: Robot) -> None:
        self.load = ""
        self._robot = robot
        self._healing = graph.healing
        name = f"consumer_{random.randrange(10**6)}"
        self._consumers = Consumers(graph, *(each.topic for each in robot.targets), name=name)

    def _heard(self, consumer: Consumer, topic: str, since: float) -> List[Heard]:
        return [each for each in consumer.since(since) if each.topic == topic]

    def await_well(self, target: Target) -> None:
        """Wait until a target publishes, and what stands by for all of them is ready."""
        for each in self._robot.targets:
            self._await(each.topic, each.node, time.monotonic())
            if each.healed:
                wait_until(lambda: not self._open(each.topic), PATIENCE_S, "no incident is open")
                self._healing.await_available(each.topic, seconds=PATIENCE_S)
        if target.standby in ("hot", "warm"):
            wait_until(lambda: self._ready(target), PATIENCE_S, "what stands by is connected")
        for consumer in self._consumers:
            consumer.forget()

    def _await(self, topic: str, node: str, since: float, seconds: float = PATIENCE_S) -> None:
        for consumer in self._consumers:
            heard = lambda: any(m.node == node for m in self._heard(consumer, topic, since))
            wait_until(heard, seconds, f"{consumer.node} hears {node}")

    def _open(self, topic: str) -> bool:
        incident = self._healing.latest(topic)
        return incident is not None and incident.state != "ended"

    def _ready(self, target: Target) -> bool:
        wanted = target.service if target.standby == "hot" else ""
        nodes = [row.node for row in self._healing.substitutions if row.service == wanted]
        connected = lambda node, consumer: is_connected(consumer.node, target.topic, node)
        return bool(nodes) and all(
            connected(node, consumer) for node in nodes for consumer in self._consumers
        )

    def _pids(self, but: str) -> Dict[str, int]:
        """Return the processes of the robot's nodes that do not fail."""
        found: Dict[str, int] = {}
        own = ("/substitute", "/rospy_", "/roscpp_", "/rosout", "/bench", "/image")
        for node in registered_nodes():
            if node != but and not node.startswith(own) and not node.endswith("/respawned"):
                with suppress(*FAILURES):
                    found[node] = node_pid(node)
        return found

    def trial(self, target: Target, fault: str) -> Trial:
        """Fail once, and come back. Raises AssertionError if the node does not come back."""
        self.await_well(target)
        before = self._pids(target.node)
        incident = self._healing.latest(target.topic)
        number = 0 if incident is None else incident.id
        patient = Patient(target.node, node_pid(target.node), PERIOD_S, FaultHandle(target.node))
        time.sleep(random.random() * PERIOD_S)
        failed_at = time.monotonic()
        CAUSES[fault](patient)
        healed = self._await_over(target, number, failed_at)
        until = time.monotonic()
        heard = [[m for m in c.messages if m.topic == target.topic] for c in self._consumers]
        rospy, roscpp = [
            1e3 * watched([m.at for m in each if self._good(m)], failed_at, until, PERIOD_S).outage
            for each in heard
        ]
        found = Trial(self._robot.name, self.load, target.standby, fault, rospy, roscpp)
        incident = self._healing.latest(target.topic)
        if healed and incident is not None and target.healed:
            moment = incident.detected.to_sec() - time.time() + time.monotonic()
            found = found._replace(detected=1e3 * (moment - failed_at), kind=incident.kind)
        if target.healed:
            found = found._replace(hole=self._return(target, patient))
        for consumer in self._consumers:
            since = self._heard(consumer, target.topic, failed_at)
            counts = judged(since, target.topic.startswith("/bot/"))
            found = found._replace(**{k: getattr(found, k) + n for k, n in counts.items()})
        after = self._pids(target.node)
        return found._replace(ended=sum(after.get(node) != pid for node, pid in before.items()))

    def _return(self, target: Target, patient: Patient) -> float:
        """Start a node again; return the longest pause around its return, in periods."""
        since = time.monotonic()
        with suppress(ProcessLookupError):
            os.kill(patient.pid, signal.SIGKILL)
        self._robot.start(target)
        self._await(target.topic, target.node, since)
        wait_until(lambda: not self._open(target.topic), PATIENCE_S, "the return")
        calm = time.monotonic() + AROUND_S
        wait_until(lambda: time.monotonic() > calm, 2 * PATIENCE_S, "a second")
        heard = (self._heard(each, target.topic, since) for each in self._consumers)
        return max(hole(each, target.node) for each in heard)

    def _good(self, message: Heard) -> bool:
        return not message.topic.startswith("/bot/") or abs(message.value) <= LIMIT

    def _await_over(self, target: Target, number: int, failed_at: float) -> bool:
        """Wait until the fault is healed and its outage is over; False: not in time."""

        def over() -> bool:
            incident = self._healing.latest(target.topic)
            if target.healed and (
                incident is None or incident.id <= number or incident.state != "healed"
            ):
                return False
            now = time.monotonic()
            return all(
                watched(
                    [m.at for m in list(c.messages) if m.topic == target.topic and self._good(m)],
                    failed_at,
                    now,
                    PERIOD_S,
                ).over
                != NEVER
                for c in self._consumers
            )

        try:
            wait_until(over, HEALED_S, "it is healed")
        except AssertionError:
            return False
        return True

    def end(self) -> None:
        """End the consumers."""
        self._consumers.end()


def robots(graph: Graph, short: bool) -> Iterator[Callable[[], Robot]]:
    """Yield what makes each robot that is asked for."""
    yield lambda: NineNodes(graph, *SETTINGS)
    for standby in () if short else STANDBY:
        yield lambda: Rover(graph, standby, *SETTINGS)


def beside(graph: Graph, load: str) -> List["subprocess.Popen[str]"]:
    """Start what keeps the computer busy."""
    busy = graph.start_busy(LOADS[load])
    if load == "20 MB/s":
        busy.append(graph.python(BENCH / "large_source.py", *IMAGE))
        busy.append(graph.start("rostopic", "hz", IMAGE[0]))
    return busy


def show(trials: Sequence[Trial]) -> None:
    """Print a row for each kind of trial."""
    table: Dict[Tuple[str, str, str, str], List[Trial]] = {}
    for each in trials:
        table.setdefault(each.key, []).append(each)
    rows = []
    for key, found in table.items():
        of = lambda name: [getattr(each, name) for each in found]
        known = [each for each in of("hole") if not math.isnan(each)]
        figures = (in_words(of("rospy"), 0), in_words(of("roscpp"), 0), in_words(known, 1))
        counts = [str(sum(of(name))) for name in ("beside", "unframed", "old", "ended")]
        kinds = " ".join(sorted({*of("kind")}))
        rows.append((", ".join(key), str(len(found)), *figures, *counts, kinds))
    columns = ("", "n", "rospy", "roscpp", "hole", "beside", "unframed", "old", "ended", "kinds")
    print_table("Outage in ms, hole in periods: median / p95 / max", columns, rows)


def judge(trials: Sequence[Trial]) -> Goals:
    """Return the goals."""
    goals = Goals()

    def outages(load: str, standby: str, crash: bool) -> List[float]:
        return [
            max(each.rospy, each.roscpp)
            for each in trials
            if (each.load, each.standby) == (load, standby)
            and (each.fault in ENDED) is crash
            and each.fault != "babbling"
        ]

    for load in LOADS:
        respawned = summary(outages(load, RESPAWN, True))[0]
        for standby in STANDBY:
            crash = outages(load, standby, True)
            if crash and not math.isnan(respawned):
                goal = f"{standby}, {load}: median of a crash / respawn's"
                goals.at_most(
                    goal,
                    "both",
                    1.2 if standby == "cold" else 0.33,
                    summary(crash)[0] / respawned,
                    "",
                )
            limits = GOALS.get(load, {}).get(standby, ())
            for limit, is_crash, words in zip(limits, (True, False), ("crash", "other faults")):
                found = outages(load, standby, is_crash)
                if found:
                    goals.at_most(
                        f"{standby}, {load}: p95, {words}", "both", limit, summary(found)[1], "ms"
                    )
    for name in ("beside", "unframed", "old", "ended"):
        goals.at_most(name, "both", 0, sum(getattr(each, name) for each in trials), "")
    return goals


def main() -> int:
    """Measure; 1 if a trial could not be made."""
    options = arguments(str(__doc__), *("trials", 20), short="a crash of each of the nine nodes")
    wanted = lambda *words: any(part in ", ".join(words) for part in options.only)
    loads = ["quiet"] if options.short else list(LOADS)
    count = 1 if options.short else options.trials
    trials: List[Trial] = []
    misses = 0
    path = options.results / "load.csv"
    with Graph() as graph:
        for make in robots(graph, options.short):
            robot = make()
            bench = Bench(graph, robot)
            for load in loads:
                bench.load = load
                kinds = [
                    (target, fault)
                    for target in robot.targets
                    for fault in (ENDED[:1] if options.short else robot.faults)
                    if wanted(robot.name, load, target.standby, fault)
                    and (target.healed or fault in ENDED)
                ]
                if not kinds:
                    continue
                bench.await_well(robot.targets[0])
                busy = beside(graph, load)
                for number in tqdm(
                    range(count * len(kinds)), f"{robot.name}, {load}", disable=None
                ):
                    try:
                        trials.append(bench.trial(*kinds[number % len(kinds)]))
                    except AssertionError as error:
                        misses += 1
                        print(f"missed: {kinds[number % len(kinds)]}: {error}", flush=True)
                    write_table(path, Trial._fields, trials)
                for process in busy:
                    ask_to_leave(process)
            bench.end()
            robot.end()
            graph.healing.forget()
    show(trials)
    judge(trials).show(options.results / "load_goals.csv")
    return 1 if misses else 0


if __name__ == "__main__":
    sys.exit(main())
