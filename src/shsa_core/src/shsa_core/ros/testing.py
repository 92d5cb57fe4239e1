"""What tests of a healed robot need: who spoke when, and how each incident went."""
import atexit
import os
import signal
import subprocess
import threading
import time
from typing import Any, Callable, Dict, List, Optional, Tuple

import psutil
import rosgraph
import rospy
from shsa_msgs.msg import Incident, SomState, Substitutions

from shsa_core.ros.graph.announce import of_topic
from shsa_core.ros.graph.node_api import node_api

POLL = 0.005


def wait_until(condition: Callable[[], object], seconds: float, what: str) -> None:
    """Wait for a condition; AssertionError if it does not come true in time."""
    end = time.monotonic() + seconds
    while not condition():
        if time.monotonic() > end:
            raise AssertionError(f"waited {seconds:g} s in vain: {what}")
        time.sleep(POLL)


class Voices:
    """Who published on a topic, and when (monotonic, s); `last` is the newest message."""

    def __init__(self, topic: str, message_class: type = rospy.AnyMsg) -> None:
        self.heard: List[Tuple[float, str]] = []
        self.last: Any = None
        self._subscriber = rospy.Subscriber(topic, message_class, self._received, tcp_nodelay=True)

    def _received(self, message: Any) -> None:
        self.last = message
        self.heard.append((time.monotonic(), message._connection_header["callerid"]))

    def times(self, node: str) -> List[float]:
        """When `node` spoke."""
        return [at for at, who in list(self.heard) if who == node]

    def others(self, node: str, since: float) -> List[Tuple[float, str]]:
        """Who else spoke since a moment."""
        return [(at, who) for at, who in list(self.heard) if who != node and at >= since]

    def await_node(self, node: str, seconds: float = 20.0) -> None:
        """Wait until `node` speaks from now on."""
        now = time.monotonic()
        heard = self.heard
        wait_until(
            lambda: any(who == node and at > now for at, who in reversed(heard[-50:])),
            seconds,
            f"{node} speaks",
        )


class HealedRobot:
    """The state of healing, as it is published: incidents, substitutions, services."""

    def __init__(self) -> None:
        self.incidents: Dict[int, Incident] = {}
        self.substitutions = Substitutions()
        self.som = SomState()
        self._lock = threading.Lock()
        rospy.Subscriber("/shsa/incidents", Incident, self._incident)
        rospy.Subscriber("/shsa/substitutions", Substitutions, self._table)
        rospy.Subscriber("/shsa/som_state", SomState, self._som)

    def _incident(self, incident: Incident) -> None:
        with self._lock:
            self.incidents[incident.id] = incident

    def _table(self, table: Substitutions) -> None:
        self.substitutions = table

    def _som(self, som: SomState) -> None:
        self.som = som

    def latest(self, topic: str) -> Optional[Incident]:
        """The newest incident of a topic."""
        with self._lock:
            known = [i for i in self.incidents.values() if i.topic == topic]
        return max(known, key=lambda each: int(each.id)) if known else None

    def publishers(self, topic: str) -> List[str]:
        """The nodes registered as publishers of a topic, save the pool's idle processes."""
        idle = {row.node for row in self.substitutions.substitutions if row.topic == ""}
        return [node for node in publishers(topic) if node not in idle]

    def await_state(self, topic: str, state: str, seconds: float = 20.0) -> Incident:
        """Wait until the newest incident of a topic is in a state."""

        def reached() -> bool:
            incident = self.latest(topic)
            return incident is not None and incident.state == state

        wait_until(reached, seconds, f"the incident of {topic} is {state}")
        incident = self.latest(topic)
        assert incident is not None
        return incident

    def await_available(self, *topics: str, seconds: float = 30.0) -> None:
        """Wait until all services of the topics are available."""

        def available() -> bool:
            states = {s.topic: s.available for s in self.som.services}
            return all(states.get(topic) for topic in topics)

        wait_until(available, seconds, f"{', '.join(topics)} available")


def node_pid(node: str) -> int:
    """The process of a running node."""
    uri = rosgraph.Master(rospy.get_name()).lookupNode(node)
    return int(node_api(uri).getPid(rospy.get_name())[2])  # type: ignore[index,arg-type]


def publishers(topic: str) -> List[str]:
    """The nodes registered as publishers of a topic."""
    return of_topic(rosgraph.Master(rospy.get_name()).getSystemState()[0], topic)


def subscribers(topic: str) -> List[str]:
    """The nodes registered as subscribers of a topic."""
    return of_topic(rosgraph.Master(rospy.get_name()).getSystemState()[1], topic)


def is_connected(node: str, topic: str, publisher: str) -> bool:
    """Whether a node is connected to a publisher of a topic; one that is not registered is not."""
    master = rosgraph.Master(rospy.get_name())
    try:
        uri, wanted = master.lookupNode(node), master.lookupNode(publisher)
    except rosgraph.MasterException:
        return False
    rows: Any = node_api(uri).getBusInfo(rospy.get_name())[2]  # type: ignore[index]
    links = {row[1].rstrip("/") for row in rows if row[2] == "i" and row[4] == topic}
    return wanted.rstrip("/") in links


def registered_nodes() -> List[str]:
    """Every node that the master knows."""
    state = rosgraph.Master(rospy.get_name()).getSystemState()
    return sorted({node for part in state for _, nodes in part for node in nodes})


def node_process(node: str) -> Optional[psutil.Process]:
    """The running process of a node; None if it is not up."""
    try:
        process = psutil.Process(node_pid(node))
    except (rosgraph.MasterException, OSError, psutil.NoSuchProcess):
        return None
    return process if running(process) else None


def running(process: psutil.Process) -> bool:
    """Whether a process is there and not a zombie."""
    try:
        return process.is_running() and process.status() != psutil.STATUS_ZOMBIE
    except psutil.NoSuchProcess:
        return False


def kill_hard(node: str) -> None:
    """`kill -9` a node."""
    os.kill(node_pid(node), signal.SIGKILL)


def rosrun(package: str, executable: str, *arguments: str) -> "subprocess.Popen[bytes]":
    """Start a node as a person would; it ends with this process."""
    process = subprocess.Popen(["rosrun", package, executable, *arguments])
    atexit.register(end, process)
    return process


def end(process: "subprocess.Popen[bytes]") -> None:
    """End a process that a test started."""
    process.kill()
    process.wait()
