"""Cost of healing on real masters, monitors and links: figures that `scale.py` goes on from.

Costs are processor times, so that they hold beside other work; latencies are of this machine as it
is. What the model is checked against is measured here as well.
"""
import json
import os
import re
import signal
import subprocess
import time
from contextlib import contextmanager
from pathlib import Path
from threading import Thread
from typing import Any, Dict, Iterator, List, NamedTuple, Sequence, Set, Tuple
from xmlrpc.server import SimpleXMLRPCServer

import numpy as np
import psutil
import rosgraph
import rospy
from diagnostic_msgs.msg import DiagnosticArray
from scipy.optimize import nnls
from shsa_msgs.msg import Failure, Health, Incident

from graph import BENCH, MONITOR, Graph, ask_to_leave, write_som
from report import summary
from scale_model import Flow, message_bytes, turns_per_s
from shsa_testing.computers import Computer, Computers
from shsa_testing.waiting import wait_until

STARTUP_S = 120.0
SETTLING_S = 3.0
VICTIMS, OF_VICTIM = 4, 5
SOURCES = 2

FITTED = (
    Flow(30, 5.0, 8),
    Flow(30, 50.0, 8),
    Flow(100, 50.0, 8),
    Flow(300, 2.0, 8),
    Flow(100, 10.0, 1000),
)
"""Figures from which the monitor's costs are computed."""
CHECKED = (
    Flow(30, 20.0, 8),
    Flow(300, 10.0, 8),
    Flow(200, 50.0, 8),
    Flow(50, 40.0, 1000),
)
"""Figures that the model must tell without having seen them."""


class Seen(NamedTuple):
    """A monitor's work: messages/s that it handled, its share of a core, and its detection.

    `waited`: its threads were ready and had no processor for this share of the time. `after`: s
    from the death of a node to the monitor's decision, for each topic.
    """

    flow: Flow
    handled: float
    share: float
    waited: float
    after: List[float]


class Started(NamedTuple):
    """A start: s until all topics were healthy, and processor times of monitor and master in s."""

    topics: int
    seconds: float
    monitor: float
    master: float
    descriptors: int


class Ear:
    """The messages of monitors."""

    def __init__(self) -> None:
        self.failed: Dict[str, float] = {}
        self.healthy: Dict[str, bool] = {}
        self.rate = self.first = self.last = 0.0
        rospy.Subscriber("/shsa/failures", Failure, self._failure, tcp_nodelay=True)
        rospy.Subscriber("/shsa/health", Health, self._health, tcp_nodelay=True)
        rospy.Subscriber("/diagnostics", DiagnosticArray, self._diagnostics)

    def _failure(self, failure: Failure) -> None:
        self.failed.setdefault(failure.topic, failure.header.stamp.to_sec())

    def _health(self, table: Health) -> None:
        if table.publishers:
            self.last = time.monotonic()
            self.first = self.first or self.last
        self.healthy.update({row.topic: row.state == "healthy" for row in table.publishers})

    def _diagnostics(self, shown: DiagnosticArray) -> None:
        told = " ".join(each.value for row in shown.status for each in row.values)
        self.rate = sum(map(float, re.findall(r"([0-9.]+) Hz", told)))


def service(number: int, node: str, period: float, checked: bool) -> Dict[str, object]:
    """Return a service of a source as in a SOM file; `checked`: its values are read."""
    value = {"field": "data[0]", "checks": {"not_a_number": checked}}
    topic = f"/scale_{number}"
    return {
        "topic": topic,
        "type": "std_msgs/Float64MultiArray",
        "node": node,
        "period": period,
        "provides": {topic[1:]: value},
    }


def _cpu(pid: int) -> float:
    used = psutil.Process(pid).cpu_times()
    return float(used.user + used.system)


def _waited(pid: int) -> float:
    """For how long in s the threads of a process were ready to run and did not."""
    files = Path(f"/proc/{pid}/task").glob("*/schedstat")
    return sum(1e-9 * int(each.read_text().split()[1]) for each in files)


class Robot:
    """Sources, victims that can be killed, and a monitor."""

    def __init__(
        self, graph: Graph, flow: Flow, victims: Sequence[int] = (OF_VICTIM,) * VICTIMS
    ) -> None:
        self.ear = Ear()
        self._graph = graph
        each = (flow.topics - sum(victims)) // SOURCES
        sizes = {f"source_{number}": each for number in range(SOURCES)}
        sizes.update({f"victim_{number}": topics for number, topics in enumerate(victims)})
        first, period = 0, 1.0 / flow.rate
        services: List[Dict[str, object]] = []
        self.nodes: Dict[str, "subprocess.Popen[str]"] = {}
        self.topics: Dict[str, List[str]] = {}
        for name, topics in sizes.items():
            words = map(str, (first, topics, period, flow.numbers))
            self.nodes[name] = graph.python(BENCH / "scale_source.py", *words, f"__name:={name}")
            owned = range(first, first + topics)
            first += topics
            services += [service(n, "/" + name, period, flow.checked) for n in owned]
            self.topics[name] = [f"/scale_{n}" for n in owned]
        there = lambda: len(rospy.get_published_topics("/")) >= first
        wait_until(there, STARTUP_S, "the sources are up")
        som = write_som(graph.folder / "som.yaml", services)
        before, begun = _cpu(graph.master.pid), time.monotonic()
        self.monitor = graph.python(MONITOR, "--som", str(som))
        well = lambda: sum(self.ear.healthy.values()) >= first
        wait_until(well, STARTUP_S, f"{first} topics are well")
        took, pid = time.monotonic() - begun, self.monitor.pid
        master = _cpu(graph.master.pid) - before
        descriptors = psutil.Process(pid).num_fds()
        self.started = Started(first, took, _cpu(pid), master, descriptors)

    def share(self, seconds: float) -> Tuple[float, float]:
        """The monitor's share of a core, and the share of time in which it waited for one."""
        pid, begun = self.monitor.pid, time.monotonic()
        before = _cpu(pid), _waited(pid)
        rospy.rostime.wallsleep(seconds)
        after, took = (_cpu(pid), _waited(pid)), time.monotonic() - begun
        return (after[0] - before[0]) / took, (after[1] - before[1]) / took

    def kill(self, name: str) -> List[float]:
        """Kill a node; s until the monitor has found each of its topics to fail."""
        topics = self.topics[name]
        killed = rospy.get_time()
        self.nodes[name].kill()
        told = lambda: all(topic in self.ear.failed for topic in topics)
        wait_until(told, STARTUP_S, f"all topics of {name} are told")
        return sorted(self.ear.failed[topic] - killed for topic in topics)

    def end(self) -> None:
        """End all."""
        for process in (self.monitor, *self.nodes.values()):
            if process.poll() is None:
                ask_to_leave(process)


@contextmanager
def robot(flow: Flow, victims: Sequence[int] = (OF_VICTIM,) * VICTIMS) -> Iterator[Robot]:
    """Yield a robot with a master of its own; only once in a process."""
    with Graph() as graph:
        yield Robot(graph, flow, victims)


def monitor_at(flow: Flow, seconds: float) -> Seen:
    """Measure the monitor's cost of a flow of messages, and its detection of deaths then."""
    with robot(flow) as running:
        rospy.rostime.wallsleep(SETTLING_S)
        share, waited = running.share(seconds)
        handled = running.ear.rate
        after: List[float] = []
        for number in range(VICTIMS):
            after += running.kill(f"victim_{number}")
            rospy.rostime.wallsleep(0.1 + 0.01 * number)
        return Seen(flow, handled, share, waited, after)


def deaths(sizes: Sequence[int]) -> Dict[int, List[float]]:
    """By the number of its topics: s until each topic of a killed node was found to have failed."""
    with robot(Flow(10 + sum(sizes), 20.0, 8), sizes) as running:
        rospy.rostime.wallsleep(SETTLING_S)
        return {size: running.kill(f"victim_{k}") for k, size in enumerate(sizes)}


def start_of(topics: int) -> Started:
    """Return the start of a monitor on a robot of so many topics."""
    with robot(Flow(topics, 2.0, 8), ()) as running:
        return running.started


def storm(topics: int) -> Tuple[float, float]:
    """Register all topics of a robot beside a monitor that waits for them.

    s from the first one that the monitor hears of until all are well, and the master's processor
    time.
    """
    with Graph() as graph:
        ear = Ear()
        services = [service(n, "/source", 0.2, False) for n in range(topics)]
        som = write_som(graph.folder / "som.yaml", services)
        graph.python(MONITOR, "--som", str(som))
        wait_until(lambda: len(_subscribed()) >= topics, STARTUP_S, "the monitor listens")
        before = _cpu(graph.master.pid)
        words = map(str, (0, topics, 0.2, 8))
        graph.python(BENCH / "scale_source.py", *words, "__name:=source")
        # What is published is asked of the monitor alone: to ask the master would be a load.
        wait_until(lambda: bool(ear.first), STARTUP_S, "the first topic is heard")
        well = lambda: sum(ear.healthy.values()) >= topics
        wait_until(well, STARTUP_S, "all topics are well")
        return ear.last - ear.first, _cpu(graph.master.pid) - before


def _subscribed() -> Set[str]:
    state = rosgraph.Master(rospy.get_name()).getSystemState()[1]
    return {topic for topic, _ in state if topic.startswith("/scale_")}


def master_costs(count: int) -> Dict[str, float]:
    """Processor s of the master for a call, a notification, and a row of its whole state."""
    with Graph() as graph:
        heard: List[float] = []
        server = SimpleXMLRPCServer(("localhost", 0), logRequests=False)

        def update(*_: object) -> Tuple[int, str, int]:
            heard.append(time.monotonic())
            return 1, "", 0

        server.register_function(update, "publisherUpdate")
        Thread(target=server.serve_forever, daemon=True).start()
        api = f"http://localhost:{server.server_address[1]}/"
        master, pid = rosgraph.Master("/scale").handle, graph.master.pid
        found: Dict[str, float] = {}

        def cost(name: str, call: Any) -> float:
            before, begun = _cpu(pid), time.monotonic()
            for number in range(count):
                call(number)
            found[name] = (_cpu(pid) - before) / count
            return time.monotonic() - begun

        kind = "std_msgs/Float64"
        cost("call", lambda n: master.registerPublisher(f"/p_{n}", f"/alone_{n}", kind, api))
        cost("look_up", lambda n: master.lookupNode("/scale", f"/p_{n}"))
        for number in range(count):
            master.registerSubscriber("/hears", f"/heard_{number}", kind, api)
        before, begun = _cpu(pid), time.monotonic()
        heard.clear()
        for number in range(count):
            master.registerPublisher(f"/q_{number}", f"/heard_{number}", kind, api)
        wait_until(lambda: len(heard) >= count, STARTUP_S, "the subscriber hears of all")
        found["notification"] = (_cpu(pid) - before) / count - found["call"]
        found["notification_wall"] = (max(heard) - begun) / count
        rows = 3 * count
        looks = 20
        before = _cpu(pid)
        for _ in range(looks):
            master.getSystemState("/scale")
        found["state_row"] = (_cpu(pid) - before) / looks / rows
        server.shutdown()
        return found


def link_bytes(flow: Flow, seconds: float) -> Tuple[float, float]:
    """Bytes on a link for each message from another computer: there, and back."""
    with Computers("far") as network:
        far = network["far"]
        os.environ["ROS_IP"] = network.here
        with Graph() as graph:
            port = os.environ["ROS_MASTER_URI"].rsplit(":", 1)[1]
            os.environ["ROS_MASTER_URI"] = f"http://{network.here}:{port}"
            ear = Ear()
            script = str(BENCH / "scale_source.py")
            words = (0, flow.topics, 1.0 / flow.rate, flow.numbers)
            graph.start(*far.words("/usr/bin/python3", script, *map(str, words), "__name:=source"))
            services = [
                service(n, "/source", 1.0 / flow.rate, flow.checked) for n in range(flow.topics)
            ]
            som = write_som(graph.folder / "som.yaml", services)
            graph.python(MONITOR, "--som", str(som))
            well = lambda: sum(ear.healthy.values()) >= flow.topics
            wait_until(well, STARTUP_S, "the topics are well")
            rospy.rostime.wallsleep(SETTLING_S)
            before = _counters(far)
            rospy.rostime.wallsleep(seconds)
            there, back = (after - b for after, b in zip(_counters(far), before))
            messages = ear.rate * seconds
            return there / messages, back / messages


def _counters(computer: Computer) -> Tuple[int, int]:
    """Return the bytes that a computer has sent and received."""
    lines = computer.run("cat", "/proc/net/dev").splitlines()
    words = next(line for line in lines if "eth0:" in line).split(":")[1].split()
    return int(words[8]), int(words[0])


class Healed(NamedTuple):
    """Of each incident, s from its detection to its decision, and to its first message."""

    decided: List[float]
    published: List[float]


def takeovers(topics: int) -> Healed:
    """Kill a node of so many hot topics; all are taken over at once."""
    with Graph() as graph:
        many = ("python3", "-m", "shsa_testing.many_topics")
        nodes = [graph.start(*many, str(k * topics), str(topics), "0.02") for k in range(2)]
        services, relations = [], {}
        for number in range(2 * topics):
            needed = number < topics
            services.append(
                {
                    "topic": f"/stream_{number}",
                    "type": "shsa_msgs/Float64Stamped",
                    "node": f"/many_{number // topics * topics}",
                    "period": 0.02,
                    "needed": needed,
                    "standby": "hot",
                    "provides": {f"stream_{number}": {"field": "data"}},
                }
            )
            if needed:
                relations[f"r_{number}"] = {f"stream_{number}": f"2*stream_{number + topics}"}
        properties: Dict[str, object] = {f"stream_{number}": {} for number in range(2 * topics)}
        ontology = graph.folder / "ontology.yaml"
        ontology.write_text(json.dumps({"properties": properties, "relations": relations}))
        som = write_som(graph.folder / "som.yaml", services)
        healing = graph.healing
        launch = graph.start(
            *("roslaunch", "shsa_core", "shsa.launch", f"ontology:={ontology}", f"som:={som}"),
            f"incident_log:={graph.folder / 'incidents.jsonl'}",
        )
        hot = lambda: sum(bool(row.service) for row in healing.substitutions) >= topics
        wait_until(hot, STARTUP_S, "all substitutes stand by")
        rospy.rostime.wallsleep(2.0 * SETTLING_S)
        nodes[0].send_signal(signal.SIGKILL)
        lost = [f"/stream_{number}" for number in range(topics)]
        found = [healing.await_state(topic, "healed", STARTUP_S) for topic in lost]
        ask_to_leave(launch, 30.0)
        return Healed(_steps(found, "found"), _steps(found, "first_message"))


def _steps(incidents: Sequence[Incident], name: str) -> List[float]:
    return [(getattr(each, name) - each.detected).to_sec() for each in incidents]


def fit(seen: Sequence[Seen]) -> Dict[str, float]:
    """The monitor's costs in s, at least 0: of a turn, a message, a byte, a topic each second.

    By least squares of relative errors.
    """
    rows, shares = [], []
    for each in seen:
        total, size = each.handled, message_bytes(each.flow.numbers)
        row = (turns_per_s(total), total, size * total, each.flow.topics)
        rows.append([figure / each.share for figure in row])
        shares.append(1.0)
    found, _ = nnls(np.array(rows), np.array(shares))
    return dict(zip(("turn", "message", "byte", "topic"), map(float, found)))


def slope(by_size: Dict[int, List[float]]) -> Tuple[float, float]:
    """Of the deaths of nodes: s until the first topic is told, and from one topic to the next."""
    first = summary([times[0] for times in by_size.values()])[0]
    large = by_size[max(by_size)]
    return first, (large[-1] - large[0]) / (len(large) - 1)
