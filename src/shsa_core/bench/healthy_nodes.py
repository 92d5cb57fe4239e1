"""Healthy life of three robots on real nodes: is anybody killed, replaced or blamed for it?

    python3 healthy_nodes.py [--minutes M] [--seed N] [--short] [--results DIR]

A base, an arm and a drone live side by side for M minutes, each with a master and healing of its
own: they reverse, stand still and saturate; nodes crash, leave and are started again, are held up,
or wait for busy processes; subscribers come and go. Rosbags that were recorded meanwhile are then
played at other rates in place of the nodes. A silence that the stamps of a node's own messages show
too, as it had no processor for as long, is told, and is no false alarm. Writes healthy_nodes.csv
and healthy_nodes_goals.csv; ends with status 1 if anything was done to a healthy node.
"""
import argparse
import json
import os
import signal
import struct
import subprocess
import sys
import tempfile
import time
from math import inf
from pathlib import Path
from random import Random
from typing import Callable, Dict, List, NamedTuple, Optional, Set, Tuple

import rospy
from roslib.message import get_message_class

from graph import Graph, ask_to_leave, shut_down
from healthy_robots import DONE, verdict
from probe import STARTUP_S
from shsa_core.files.som_file import load_som
from shsa_core.model.service import Deadlines, Service
from shsa_testing.healing import HealedRobot
from shsa_testing.healthy_robots import LIVES, ROBOTS
from shsa_testing.waiting import wait_until

FILES = Path(__file__).resolve().parent.parent / "test" / "data"
MOST_BUSY, BUSY_S = 4, 4.0
HELD_S = (0.02, 0.18)
APART_S = (3.0, 15.0)
DOWN_S = (0.3, 1.0, 5.0)
SETTLED_S = 3.0
"""After a node is available again: until then its absence may still be told."""
LOOK_S, ENDING_S = 0.05, 0.5
AFTER_S = 1.0
"""So long after a silence something may still be told of it."""


class Row(NamedTuple):
    """What happened to a robot; `rate`: of the rosbag that is played, 1 of a robot that lives.

    `failures`: incidents that told of nodes that were gone; `silent`: of silences that were true;
    the last three are to be 0.
    """

    robot: str
    rate: float
    clock: bool
    minutes: float
    messages: int
    restarts: int
    failures: int
    silent: int
    killed: int
    replaced: int
    blamed: int


class Told(NamedTuple):
    """Something that was done to a node that does well; `time`: in s, monotonic and since 1970.

    `silent`: because of a silence, maybe, of its `topic`.
    """

    time: Tuple[float, float]
    text: str
    topic: str
    silent: bool


class Life:
    """A robot whose nodes run, in sight of healing; `told`: all that was done to healthy ones."""

    def __init__(self, graph: Graph, name: str, seed: int, bag: Optional[Path]) -> None:
        self.random = Random(f"{name} {seed}")
        self.graph, self.name = graph, name
        self.path = FILES / f"healthy_{name}_som.yaml"
        self.som, errors = load_som(str(self.path))
        assert not errors
        self.began, self.restarts, self.messages = time.time(), 0, 0
        self.told: Dict[str, List[Told]] = {each: [] for each in DONE}
        self.silences: Set[Tuple[str, float, float]] = set()
        self.bag = bag
        self._heard = 0.0
        self._newest: Dict[str, float] = {}
        self._gone: Dict[str, float] = {}
        self._seen: Set[object] = set()
        self._processes: Dict[str, "subprocess.Popen[str]"] = {}
        self._consumers: Dict[str, rospy.Subscriber] = {}
        self.robot = HealedRobot()
        for each in self.som:
            rospy.Subscriber(each.topic, rospy.AnyMsg, self._count, each)

    def _count(self, message: rospy.AnyMsg, service: Service) -> None:
        self.messages += 1
        self._heard = time.monotonic()
        if message._connection_header["callerid"] != service.node:
            return
        allowed = Deadlines().of(service)
        if allowed is None or not get_message_class(service.type)._has_header:
            return
        seconds, nanoseconds = struct.unpack_from("<II", message._buff, 4)
        stamp = seconds + 1e-9 * nanoseconds
        before = self._newest.get(service.name, stamp)
        if stamp - before >= allowed:
            self.silences.add((service.topic, before, stamp))
        self._newest[service.name] = stamp

    def excuse(self) -> int:
        """Forget what was told of true silences; return how many silences these were."""
        found: Set[object] = set()
        for what, told in self.told.items():
            for each in list(told):
                now = each.time[1]
                why = {
                    (t, a, b)
                    for t, a, b in self.silences
                    if t == each.topic and a < now < b + AFTER_S
                }
                if each.silent and why:
                    found |= why
                    told.remove(each)
        return len(found)

    @property
    def nodes(self) -> List[str]:
        """Return the nodes of the robot."""
        return sorted({each.node for each in self.som})

    def start(self, node: str) -> None:
        """Start a node."""
        namespace = node.rsplit("/", 1)[0]
        given = (self.name, str(self.path), self.name, str(self.began), node)
        module = (sys.executable, "-m", "shsa_testing.healthy_nodes", *given)
        self._processes[node] = self.graph.start(*module, f"__ns:={namespace or '/'}")

    def play(self, rate: float, clock: bool) -> "subprocess.Popen[str]":
        """Play the rosbag in place of the nodes; return the player."""
        assert self.bag is not None
        words = ["rosbag", "play", "--quiet", "--rate", f"{rate}", *(["--clock"] if clock else [])]
        self._processes["/play"] = player = self.graph.start(*words, str(self.bag), "__name:=play")
        return player

    def heal(self) -> "subprocess.Popen[str]":
        """Start healing."""
        words = f"ontology:={FILES}/healthy_{self.name}.yaml", f"som:={self.path}"
        log = f"incident_log:={self.graph.folder / 'incidents.jsonl'}"
        return self.graph.start("roslaunch", "shsa_core", "shsa.launch", *words, log)

    def available(self, node: str) -> bool:
        """Tell that all that a node publishes is available."""
        rows = [row for row in self.robot.services if row.node == node]
        own = sum(each.node == node for each in self.som)
        return len(rows) == own and all(row.available for row in rows)

    def look(self) -> None:
        """Note what healing has done to nodes that do well."""
        now = time.monotonic()
        at = f"{time.time() - self.began:.1f} s"
        well = lambda node: node in self._processes and now > self._gone.get(node, 0.0)
        for node, process in self._processes.items():
            if well(node) and process.poll() is not None:
                self._note("killed", (node, process.pid), f"{at}: {node}", "")
        for incident in list(self.robot.incidents.values()):
            if incident.id not in self._seen:
                self._seen.add(incident.id)
                if well(incident.faulty_node):
                    told = f"{incident.faulty_node} on {incident.topic}: {incident.kind}"
                    text, silent = f"{at}: {told}: {incident.evidence}", incident.kind == "silent"
                    self._note("blamed", None, text, incident.topic, silent)
        for row in self.robot.substitutions:
            node = self.som.services[row.service].node if row.service else ""
            if row.publishing and well(node):
                text, topic = f"{at}: {row.node} for {node}", self.som.services[row.service].topic
                self._note("replaced", (row.node, row.service), text, topic, True)

    def _note(self, what: str, key: object, text: str, topic: str, silent: bool = False) -> None:
        if key is None or key not in self._seen:
            self._seen.add(key)
            self.told[what].append(Told((time.monotonic(), time.time()), text, topic, silent))

    def ended(self) -> None:
        """Forget what was told since the last message of a rosbag: its player had gone."""
        for what, told in self.told.items():
            self.told[what] = [each for each in told if each.time[0] < self._heard - ENDING_S]

    def wait(self, seconds: float, until: Callable[[], bool] = lambda: False) -> None:
        """Look until something is so, or some time is over."""
        end = time.monotonic() + seconds
        while time.monotonic() < end and not until():
            self.look()
            rospy.rostime.wallsleep(LOOK_S)

    # What happens to it

    def event(self) -> None:
        """Let something happen as it does to a healthy robot."""
        happens = [self._restart, self._hold, self._subscribers, self._busy]
        self.random.choice(happens)()
        self.wait(self.random.uniform(*APART_S))

    def _restart(self) -> None:
        node = self.random.choice(self.nodes)
        self._gone[node] = inf
        if self.random.random() < 0.5:
            self._processes[node].kill()
        else:
            shut_down(node)
            self.wait(5.0, lambda: self._processes[node].poll() is not None)
        self._processes[node].kill()
        self._processes[node].wait()
        self.wait(self.random.choice(DOWN_S))
        self.start(node)
        self.restarts += 1
        process = self._processes[node]
        self.wait(STARTUP_S, lambda: process.poll() is not None or self.available(node))
        if process.poll() is not None:
            self._note("killed", (node, process.pid), f"{node} as it came back", "")
        self._gone[node] = time.monotonic() + SETTLED_S

    def _hold(self) -> None:
        process = self._processes[self.random.choice(self.nodes)]
        process.send_signal(signal.SIGSTOP)
        rospy.rostime.wallsleep(self.random.uniform(*HELD_S))
        process.send_signal(signal.SIGCONT)

    def _busy(self) -> None:
        count = self.random.randint(1, MOST_BUSY)
        busy = self.graph.start_busy(count)
        self.wait(BUSY_S)
        for process in busy:
            process.kill()
            process.wait()

    def _subscribers(self) -> None:
        for each in self.som:
            consumer = self._consumers.pop(each.topic, None)
            if consumer is not None:
                consumer.unregister()
            elif self.random.random() < 0.5:
                self._consumers[each.topic] = rospy.Subscriber(each.topic, rospy.AnyMsg)

    def record(self, seconds: float) -> None:
        """Record a rosbag of all that the SOM names."""
        assert self.bag is not None
        topics = [each.topic for each in self.som]
        words = ("rosbag", "record", "--quiet", "-O", str(self.bag), *topics)
        recorder = self.graph.start(*words, "__name:=record")
        self.wait(seconds)
        recorder.send_signal(signal.SIGINT)
        recorder.wait(20.0)


def live(options: argparse.Namespace) -> Row:
    """Let one robot live, or play its rosbag; in a process of its own."""
    name, rate, clock = options.robot, options.rate, options.clock
    with Graph() as graph:
        rospy.set_param("/use_sim_time", bool(rate and clock))
        life = Life(graph, name, options.seed, options.bag)
        begin = time.monotonic()
        if rate:
            healing = life.heal()
            wait_until(lambda: life.robot.services, STARTUP_S, "healing is up")
            player = life.play(rate, clock)
            life.wait(600.0, lambda: player.poll() is not None)
            life.ended()
        else:
            for node in life.nodes:
                life.start(node)
            healing = life.heal()
            up = lambda: all(map(life.available, life.nodes))
            life.wait(STARTUP_S, up)
            assert up(), f"{name} is up: {graph.last_words()}"
            life.record(options.recorded)
            while time.monotonic() < begin + 60.0 * options.minutes:
                life.event()
        for told in life.told.values():
            for each in told:
                print(f"{name}, {rate or 1:g}: {each.text}", file=sys.stderr, flush=True)
        failures = len(life.robot.incidents) - len(life.told["blamed"])
        silent = 0 if rate else life.excuse()
        minutes = round((time.monotonic() - begin) / 60.0, 1)
        counts = [len(life.told[what]) for what in DONE]
        ask_to_leave(healing, 30.0)
        seen = life.messages, life.restarts, failures, silent
    return Row(name, rate or 1.0, clock, minutes, *seen, *counts)


def side_by_side(lives: List[List[str]]) -> List[Row]:
    """Run some lives, each in a process, and return what happened."""
    script = [sys.executable, os.path.abspath(__file__)]
    running = [
        subprocess.Popen([*script, *words], stdout=subprocess.PIPE, universal_newlines=True)
        for words in lives
    ]
    said = [process.communicate()[0] for process in running]
    return [Row(*json.loads(each.splitlines()[-1])) for each in said]


def main() -> int:
    """Measure, print the verdict, write the CSV files."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--minutes", type=float, default=60.0, help="of each robot's life")
    parser.add_argument("--recorded", type=float, default=60.0, help="s of each rosbag")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--short", action="store_true", help="for some seconds, as a check")
    parser.add_argument("--results", type=Path, default=Path("results/bench"))
    for flag, kind in (("robot", str), ("bag", Path), ("rate", float)):
        parser.add_argument(f"--{flag}", type=kind, help=argparse.SUPPRESS)
    parser.add_argument("--clock", action="store_true", help=argparse.SUPPRESS)
    options = parser.parse_args()
    if options.robot:
        print(json.dumps(live(options)))
        return 0
    options.results.mkdir(parents=True, exist_ok=True)
    minutes, recorded = (0.3, 5.0) if options.short else (options.minutes, options.recorded)
    plays = [(rate, clock) for rate, clock in LIVES if rate]
    rows: List[Row] = []
    with tempfile.TemporaryDirectory(prefix="shsa_bags_") as folder:
        of = lambda name: ["--robot", name, "--bag", f"{folder}/{name}.bag"]
        given = [f"--minutes={minutes}", f"--recorded={recorded}", f"--seed={options.seed}"]
        rows += side_by_side([[*of(name), *given] for name in ROBOTS])
        for rate, clock in plays[:1] if options.short else plays:
            more = [f"--rate={rate}", *(["--clock"] if clock else [])]
            rows += side_by_side([[*of(name), *more] for name in ROBOTS])
    return verdict("healthy_nodes", rows, options.results)


if __name__ == "__main__":
    sys.exit(main())
