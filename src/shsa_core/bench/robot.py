"""A small robot to measure healing on: two nodes, healing, and two consumers."""
import subprocess
import threading
import time
from pathlib import Path
from typing import Dict, Iterator, List, NamedTuple, Sequence, Tuple

import psutil
import rosgraph
import rospy
from shsa_msgs.msg import Substitution

from graph import (
    BENCH,
    FAULTY_PUBLISHER,
    GATE_PROGRAM,
    PATIENCE_S,
    Graph,
    ask_to_leave,
    service,
    write_som,
)
from shsa_testing.faulty_publisher import FaultHandle
from shsa_testing.graph import is_connected, node_pid, registered_nodes
from shsa_testing.waiting import wait_until

TOPIC, NODE = "/lost", "/failing"
RAW_TOPIC, GATE = "/lost/raw", "/lost_gate"
"""Behind a gate, the node publishes there, and the gate is heard."""
KEPT_TOPIC, KEPT_NODE = "/kept", "/steady"
LIMIT = 10.0  # of the good values of TOPIC
SILENCE_S = 0.1  # the monitor's deadline for a topic at 50 Hz: five periods
HOLD_OFF_S = 1.0  # until then a substitute has handed over all consumers
POOL = 2
# The same node fails again and again here: that is not to be taken for a node that flaps.
TIRELESS = "switches:=0"

ONTOLOGY = """
properties:
  lost: {unit: m}
  kept: {unit: m}
relations:
  half:
    lost: 0.5 * kept
"""


class Applications:
    """Application nodes, as many as wanted; `rate` in Hz at which each publishes."""

    def __init__(self, graph: Graph, rate: float) -> None:
        self._graph = graph
        self._rate = rate
        self._processes: List["subprocess.Popen[str]"] = []

    def grow(self, count: int) -> None:
        """Start nodes until there are `count`, and wait until all have registered."""
        for number in range(len(self._processes), count):
            name = f"__name:=application_{number}"
            self._processes.append(
                self._graph.cpp("application", str(number), str(self._rate), name)
            )
        wait_until(lambda: _applications() >= count, PATIENCE_S, f"{count} application nodes")


def _applications() -> int:
    try:
        publishers = rosgraph.Master(rospy.get_name()).getSystemState()[0]
    except OSError:
        return 0  # the master is too busy to answer now
    return sum(topic.startswith("/application_") for topic, _ in publishers)


class Heard(NamedTuple):
    """A message as a consumer heard it; `at` is monotonic, in s."""

    at: float
    topic: str
    node: str
    value: float
    stamp: float = 0.0
    frame: str = ""

    @property
    def good(self) -> bool:
        """True if the value is in range."""
        return abs(self.value) <= LIMIT


class Consumer:
    """A consumer's process, and what it heard."""

    def __init__(self, process: "subprocess.Popen[str]", node: str) -> None:
        self.node = node
        self.messages: List[Heard] = []
        self.contacts: Dict[str, float] = {}  # when it learned of the publisher at a URI
        self._process = process
        threading.Thread(target=self._read, daemon=True).start()

    def forget(self) -> None:
        """Forget what was heard before the last second or so."""
        del self.messages[:-100]

    def since(self, moment: float) -> List[Heard]:
        """Return what came after a moment."""
        return [each for each in list(self.messages) if each.at > moment]

    def until(self, moment: float) -> Heard:
        """Return the last good message up to a moment. Raises AssertionError if there is none."""
        good = [each for each in list(self.messages) if each.at <= moment and each.good]
        assert good, f"{self.node} heard nothing good before the failure"
        return good[-1]

    def end(self) -> None:
        """End the process."""
        ask_to_leave(self._process)

    def _read(self) -> None:
        assert self._process.stdout is not None
        for line in self._process.stdout:
            word, at, topic, node, *rest = line.split()
            if word == "message":
                value, stamp, *frame = rest
                heard = Heard(float(at), topic, node, float(value), float(stamp), "".join(frame))
                self.messages.append(heard)
            else:
                self.contacts[node.rstrip("/")] = float(at)


class Consumers:
    """Two consumers of the same topics, side by side: one in rospy, one in roscpp."""

    def __init__(self, graph: Graph, *topics: str, name: str = "consumer") -> None:
        names = (f"rospy_{name}", f"roscpp_{name}")
        python = graph.python(BENCH / "consumer.py", *topics, f"__name:={names[0]}", heard=True)
        cpp = graph.cpp("consumer", *topics, f"__name:={names[1]}", heard=True)
        self.rospy = Consumer(python, "/" + names[0])
        self.roscpp = Consumer(cpp, "/" + names[1])

    def __iter__(self) -> Iterator[Consumer]:
        return iter((self.rospy, self.roscpp))

    def end(self) -> None:
        """End both."""
        for consumer in self:
            consumer.end()

    def await_node(self, node: str, since: float) -> None:
        """Wait until both hear `node` after a moment."""
        for consumer in self:
            wait_until(
                lambda: any(each.node == node for each in consumer.since(since)[-20:]),
                PATIENCE_S,
                f"{consumer.node} hears {node}",
            )


class HealthyRobot:
    """`/failing` publishes `/lost`, `/steady` publishes `/kept`, and healing watches over both.

    `more`: what the SOM says of `/lost` besides; with a `gate`, `/lost_gate` stands before
    consumers. `topic` is where the node publishes, and `heard` who is heard.
    """

    def __init__(
        self, graph: Graph, consumers: Consumers, standby: str, period: float, **more: object
    ) -> None:
        self.topic = str(more.get("gate", TOPIC))
        self.heard = GATE if self.topic != TOPIC else NODE
        self.standby = standby
        self.period = period
        self.healing = graph.healing
        self.fault = FaultHandle(NODE)
        self._graph = graph
        self._consumers = consumers
        self._steady = self._talker(KEPT_NODE, KEPT_TOPIC, 2.0)
        self.failing = self._talker(NODE, self.topic, 1.0)
        paths = write_model(graph.folder, standby, period, **more)
        self._launch = graph.start(
            *("roslaunch", "shsa_core", "shsa.launch"),
            *(f"ontology:={paths[0]}", f"som:={paths[1]}", f"hold_off:={HOLD_OFF_S}"),
            *(f"minimum_deadline:={SILENCE_S}", TIRELESS),
            *(f"pool:={POOL}", f"incident_log:={graph.folder / 'incidents.jsonl'}"),
        )
        words = (TOPIC[1:], "--som", str(paths[1]), f"__name:={GATE[1:]}")
        gated = self.topic != TOPIC
        self._gates = [graph.python(GATE_PROGRAM, *words)] if gated else []

    def await_well(self) -> None:
        """Wait until no incident is open, the original is heard, and what stands by is ready."""
        consumers, healing = self._consumers, self.healing
        wait_until(lambda: not self._open(), PATIENCE_S, "the incident's end")
        healing.await_available(self.topic, KEPT_TOPIC, seconds=PATIENCE_S)
        consumers.await_node(self.heard, time.monotonic())
        hot = self.standby == "hot"
        rows = lambda: [r for r in healing.substitutions if r.service == TOPIC.strip("/")]
        wait_until(lambda: len(rows()) == hot, PATIENCE_S, "what stands by is as it should be")
        if hot:
            served = lambda: any(self._served_by(row.node) for row in rows())
            wait_until(served, PATIENCE_S, "all are connected")
            ready = lambda: any(self._fills_in(row) for row in rows())
            wait_until(ready, PATIENCE_S, "the substitute hears whom it fills in for")
        if self.standby == "warm":
            wait_until(self._pool_ready, PATIENCE_S, "the pool is full")
        for each in consumers:
            each.forget()

    def _served_by(self, node: str) -> bool:
        """Return whether every consumer, or the gate before them, is connected to a node."""
        gated = self.topic != TOPIC
        of = [GATE] if gated else [each.node for each in self._consumers]
        return all(is_connected(each, self.topic, node) for each in of)

    def _fills_in(self, row: Substitution) -> bool:
        """Return whether a substitute hears the node, if it fills in for late messages."""
        bridge = getattr(row, "bridge", 0.0)
        return not bridge or is_connected(row.node, self.topic, NODE)

    def _open(self) -> bool:
        incident = self.healing.latest(self.topic)
        return incident is not None and incident.state != "ended"

    def _pool_ready(self) -> bool:
        """Return whether the pool's processes are up, connected, and have nothing to do."""
        idle = [name for name in registered_nodes() if name.startswith("/substitute_standby")]
        if len(idle) != POOL or not all(self._served_by(name) for name in idle):
            return False
        busy = []
        for name in idle:
            try:
                busy.append(psutil.Process(node_pid(name)).cpu_percent(0.2))
            except (OSError, rosgraph.MasterException, psutil.NoSuchProcess):
                return False
        return max(busy) < 20.0

    def bring_back(self) -> None:
        """Start the node that failed again, as somebody would."""
        self.failing.kill()
        self.failing.wait()
        self.failing = self._talker(NODE, self.topic, 1.0)

    def end(self) -> None:
        """Stop healing, then the nodes."""
        ask_to_leave(self._launch, 30.0)
        for process in (self.failing, self._steady, *self._gates):
            ask_to_leave(process)
        self.healing.incidents.clear()

    def _talker(self, node: str, topic: str, value: float) -> "subprocess.Popen[str]":
        return self._graph.python(FAULTY_PUBLISHER, *talker(node, topic, value, self.period))


def talker(node: str, topic: str, value: float, period: float) -> Sequence[str]:
    """Return the arguments of the rospy node that can fail on command."""
    name = f"__name:={node[1:]}"
    return (f"_topic:={topic}", f"_value:={value}", f"_period:={period}", name)


def write_model(folder: Path, standby: str, period: float, **more: object) -> Tuple[Path, Path]:
    """The small robot's ontology and SOM, as files; `more`: what is said of `/lost` besides."""
    ontology, som = folder / "ontology.yaml", folder / "som.yaml"
    ontology.write_text(ONTOLOGY)
    lost = {"range": [-LIMIT, LIMIT]}
    services = (
        service(TOPIC, NODE, period, lost, needed=True, standby=standby, **more),
        service(KEPT_TOPIC, KEPT_NODE, period),
    )
    return ontology, write_som(som, services)
