"""A robot of four nodes that is healed, two consumers, and what a trial asks of them.

`/first` publishes /a (hot), `/second` /b (warm); `/third` and `/fourth` publish /c and /d, from
each of which both follow.
"""
import os
import signal
import subprocess
import time
from contextlib import contextmanager
from pathlib import Path
from typing import Dict, Iterator, List, Optional, Sequence, Tuple

import psutil
import rospy
from shsa_msgs.msg import Incident

from graph import FAULTY_PUBLISHER, PATIENCE_S, Graph, ask_to_leave, service, write_som
from robot import HOLD_OFF_S, Consumers, Heard, talker
from shsa_testing.graph import is_connected, kill_hard
from shsa_testing.waiting import wait_until

PERIOD_S = 0.02
DEADLINE_S = 0.25
NODES = {"/first": "/a", "/second": "/b", "/third": "/c", "/fourth": "/d"}
LIMIT = 10.0
ONTOLOGY = """
properties: {a: {unit: m}, b: {unit: m}, c: {unit: m}, d: {unit: m}}
relations:
  a_of_c: {a: {function: 0.5 * c, quality: 0.9}}
  a_of_d: {a: {function: 0.25 * d, quality: 0.8}}
  b_of_d: {b: {function: 0.5 * d, quality: 0.9}}
  b_of_c: {b: {function: c, quality: 0.8}}
"""
VALUES = {"/first": 1.0, "/second": 2.0, "/third": 2.0, "/fourth": 4.0}
FRAME = "base_link"
STRANGER = "/stranger_"


class Rig:
    """`with Rig(graph, switches=0) as rig:` has the robot up and well; `settings` are arguments."""

    def __init__(self, graph: Graph, **settings: object) -> None:
        self.graph = graph
        self.healing = graph.healing
        self.nodes: Dict[str, "subprocess.Popen[str]"] = {}
        self._settings = settings
        self.both_heard = 0.0
        """The longest time that two publishers of one topic were heard in the last trial, in ms."""

    def __enter__(self) -> "Rig":
        self.consumers = Consumers(self.graph, "/a", "/b")
        for node in NODES:
            self.start(node)
        self.ontology, self.som = write_model(self.graph.folder)
        self.log = self.graph.folder / "incidents.jsonl"
        self.launch = self.graph.start(*self.launch_command())
        self.await_well()
        return self

    def __exit__(self, *_: object) -> None:
        ask_to_leave(self.launch, 30.0)
        for process in self.nodes.values():
            process.kill()
            process.wait()
        self.consumers.end()
        self.healing.incidents.clear()

    def launch_command(self) -> Sequence[str]:
        """Return the launch of healing."""
        return (
            *("roslaunch", "shsa_core", "shsa.launch"),
            *(f"ontology:={self.ontology}", f"som:={self.som}", f"hold_off:={HOLD_OFF_S}"),
            *(f"minimum_deadline:={DEADLINE_S}", f"incident_log:={self.log}"),
            "operator:=true",  # it lets back who is kept out
            *(f"{name}:={value}" for name, value in self._settings.items()),
        )

    # The robot's nodes

    def start(self, node: str) -> None:
        """Start a node, in the place of the one that was."""
        arguments = talker(node, NODES[node], VALUES[node], PERIOD_S)
        self.nodes[node] = self.graph.python(FAULTY_PUBLISHER, *arguments, f"_frame:={FRAME}")

    def kill(self, node: str) -> float:
        """`kill -9`; when that was, monotonic, in s."""
        now = time.monotonic()
        self.nodes[node].kill()
        self.nodes[node].wait()
        return now

    def kill_node(self, node: str) -> float:
        """`kill -9` whatever process has a name on the graph; when that was."""
        now = time.monotonic()
        kill_hard(node)
        return now

    def hang(self, node: str) -> float:
        """SIGSTOP; when that was."""
        now = time.monotonic()
        self.nodes[node].send_signal(signal.SIGSTOP)
        return now

    def bring_back(self, node: str) -> None:
        """Start a node again, and wait until all is well."""
        self.nodes[node].kill()
        self.nodes[node].wait()
        self.start(node)
        self.await_well()

    def returns_well(self, topic: str, node: str) -> float:
        """Start a node that has ended again; return the longest pause at its return, in ms."""
        begun = time.monotonic()
        self.start(node)
        wait_until(lambda: self._heard(topic, node, begun), PATIENCE_S, f"{node} is heard")
        wait_until(lambda: not self.open(), PATIENCE_S, "no incident is open")
        over = time.monotonic()
        wait_until(lambda: len(self.messages(topic, over)) > 10, PATIENCE_S, "it goes on")
        pause = self.outage(topic, begun)
        self.await_well()
        return pause

    # What is seen

    def await_well(self) -> None:
        """Wait until every original is heard, no incident is open, and what stands by is ready."""
        self.healing.await_available(*NODES.values(), seconds=PATIENCE_S)
        wait_until(lambda: not self.open(), PATIENCE_S, "no incident is open")
        for node in ("/first", "/second"):
            self.consumers.await_node(node, time.monotonic())
        wait_until(self._standby_ready, PATIENCE_S, "what stands by is connected")
        self.both_heard = max(self.overlap(topic, 0.0) for topic in ("/a", "/b"))
        for consumer in self.consumers:
            heard = list(consumer.messages)
            consumer.forget()
            _look_at(heard, consumer.node)

    def open(self) -> List[Incident]:
        """Return the incidents that have not ended."""
        return [each for each in list(self.healing.incidents.values()) if each.state != "ended"]

    def _standby_ready(self) -> bool:
        hot = [row.node for row in self.healing.substitutions if row.service == "a"]
        idle = [row.node for row in self.healing.substitutions if not row.service]
        wanted = [("/a", node) for node in hot] + [("/b", node) for node in idle]
        return bool(hot) and len(idle) >= 2 and all(map(self._connected, *zip(*wanted)))

    def _connected(self, topic: str, node: str) -> bool:
        return all(is_connected(each.node, topic, node) for each in self.consumers)

    def await_healed(self, topic: str, since: float, seconds: float = PATIENCE_S) -> Incident:
        """Wait until a topic is healed and its substitute is heard by both consumers."""

        def found() -> Optional[Incident]:
            incident = self.healing.latest(topic)
            if incident is None or incident.state != "healed":
                return None
            return incident if self._heard(topic, incident.substitute, since) else None

        return wait_until(found, seconds, f"{topic} is healed")

    def _heard(self, topic: str, node: str, since: float) -> bool:
        return all(
            any(each.node == node for each in self.messages(topic, since, number)[-20:])
            for number in (0, 1)
        )

    def messages(self, topic: str, since: float, consumer: int = 0) -> List[Heard]:
        """Return what the rospy (0) or roscpp consumer (1) heard on a topic since a moment."""
        listener = tuple(self.consumers)[consumer]
        return [each for each in listener.since(since) if each.topic == topic]

    def outage(self, topic: str, failed_at: float) -> float:
        """Return the longest pause between good messages at any consumer since then, in ms."""
        pauses = []
        for number in (0, 1):
            at = [m.at for m in self.messages(topic, failed_at - 1.0, number) if m.good]
            pauses.append(max(b - a for a, b in zip(at, at[1:]) if b > failed_at))
        return 1e3 * max(pauses)

    def overlap(self, topic: str, since: float) -> float:
        """Return the longest time that two publishers were heard beside each other, in ms.

        That is from the first message of the second one to the last one of the first, at the rospy
        consumer. A stream that paused for three periods had ended before.
        """
        longest, begun = 0.0, None
        last: Dict[str, float] = {}
        heard = self.messages(topic, since)
        for before, message in zip(heard, heard[1:]):
            last[before.node] = before.at
            own = last.get(message.node, -1.0)
            if before.node == message.node:
                begun = None
            elif message.at - own < 3 * PERIOD_S:
                begun = before.at if begun is None else begun
                longest = max(longest, message.at - begun)
        return 1e3 * longest

    def returns(self, node: str, since: float) -> int:
        """Count how often the rospy consumer heard an original again after another publisher."""
        nodes = [each.node for each in self.messages(NODES[node], since)]
        return sum(a != b == node for a, b in zip(nodes, nodes[1:]))

    def one_publisher(self, topic: str, seconds: float = 2.0) -> None:
        """Assert that one node is heard on a topic, and goes on being it."""

        def one() -> bool:
            since = time.monotonic() - 10 * PERIOD_S
            return len({each.node for each in self.messages(topic, since)}) == 1

        wait_until(one, seconds, f"one publisher of {topic}")


def _look_at(heard: Sequence[Heard], consumer: str) -> None:
    """Assert that a consumer got neither a message without its frame nor a stale one.

    Stale is what is older than what was heard before: a consumer on a busy computer hears all late.
    What a stranger says is the fault that is tried.
    """
    heard = [each for each in heard if not each.node.startswith(STRANGER)]
    unframed = [each for each in heard if each.frame != FRAME]
    newest: Dict[str, float] = {}
    stale = []
    for each in heard:
        newest[each.topic] = max(each.stamp, newest.get(each.topic, each.stamp))
        if each.stamp < newest[each.topic] - DEADLINE_S:
            stale.append(each)
    if rospy.get_param("/use_sim_time", False):
        stale.clear()  # that clock is set back
    assert not unframed, f"{consumer} heard {len(unframed)} without a frame, one is {unframed[0]}"
    assert not stale, f"{consumer} heard {len(stale)} stale ones, one is {stale[0]}"


@contextmanager
def stopped(*pids: int) -> Iterator[None]:
    """Processes that stand still, and go on afterwards."""
    try:
        for pid in pids:
            os.kill(pid, signal.SIGSTOP)
        yield
    finally:
        for pid in pids:
            if psutil.pid_exists(pid):
                os.kill(pid, signal.SIGCONT)


def write_model(folder: Path) -> Tuple[Path, Path]:
    """Return the robot's ontology and SOM, as files."""
    ontology, som = folder / "ontology.yaml", folder / "som.yaml"
    ontology.write_text(ONTOLOGY)
    needed: Dict[str, Dict[str, object]] = {
        "/a": {"needed": True, "standby": "hot", "contain": "node"},
        "/b": {"needed": True, "standby": "warm"},
    }
    limit = {"range": [-LIMIT, LIMIT]}
    rows = [
        service(topic, node, PERIOD_S, limit, **needed.get(topic, {}))
        for node, topic in NODES.items()
    ]
    return ontology, write_som(som, rows)
