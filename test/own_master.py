"""A robot with a master of its own, for tests in which that is killed, or its nodes are limited."""
import os
import shutil
import signal
import socket
import subprocess
import sys
import tempfile
import threading
import time
from contextlib import closing, contextmanager
from pathlib import Path
from typing import Dict, Iterator, List

import rosgraph
import rospy
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from shsa_msgs.msg import Float64Stamped

from shsa_testing.graph import is_connected, registered_nodes
from shsa_testing.healing import HealedRobot, TopicRecord
from shsa_testing.processes import end_process, own_address, program
from shsa_testing.waiting import wait_until

DATA = Path(__file__).resolve().parent.parent / "src" / "shsa_core" / "test" / "data"
PERIOD_S = 0.05
SHOWN_S = 1.5  # how old a row may be
OUTAGE_S = 0.5  # of a crash, on a busy machine
NODES = {
    "/source_node": ("/source", 1.0),
    "/spare_node": ("/spare", 1.0),
    "/hot_node": ("/hot", 10.0),
    "/warm_node": ("/warm", 10.0),
    "/cold_node": ("/cold", 10.0),
}
NOBODY = 65534
ORDINARY = ["setpriv", f"--reuid={NOBODY}", "--clear-groups"] if os.geteuid() == 0 else []
"""Words that run a program as a user whose processes are limited; those of root are not."""
MAY_BE_LIMITED = os.geteuid() != 0 or shutil.which("setpriv") is not None


class Robot:
    """The nodes, healing, and what a consumer hears that was there before."""

    def __init__(self, port: int, folder: str, before: List[str]) -> None:
        self.port, self._before = port, before
        self.processes: "List[subprocess.Popen[bytes]]" = []
        self.nodes: "Dict[str, subprocess.Popen[bytes]]" = {}
        homes = {name: folder for name in ("ROS_LOG_DIR", "ROS_HOME", "HOME")}
        self.environment = {**os.environ, **homes}
        reader, self._errors = os.pipe()
        self._said: List[bytes] = []
        threading.Thread(target=self._listen, args=(reader,), daemon=True).start()
        self.start_master()
        rospy.init_node("old_consumer", disable_signals=True)
        self.healing = HealedRobot()
        self.rows: Dict[str, DiagnosticStatus] = {}
        rospy.Subscriber("/diagnostics", DiagnosticArray, self._diagnostics)
        self.records = {name: TopicRecord(name, Float64Stamped) for name, _ in NODES.values()}
        for node in NODES:
            self.start(node)
        self.som = os.path.join(folder, "som.yaml")
        som = (DATA / "takeover_som.yaml").read_text("utf-8")
        Path(self.som).write_text(som.replace("period: 0.02", f"period: {PERIOD_S}"), "utf-8")
        rospy.set_param("/reconfigurator/hold_off", 0.5)
        self.start_reconfigurator()
        self.run(*before, program("shsa_core", "monitor"), "--som", self.som)
        self.settle()

    def _diagnostics(self, array: DiagnosticArray) -> None:
        self.rows.update({row.name: row for row in array.status})

    def run(self, *words: str) -> "subprocess.Popen[bytes]":
        process = subprocess.Popen(words, env=self.environment, stderr=self._errors)
        self.processes.append(process)
        return process

    def errors(self) -> str:
        """Return what all processes have said on stderr."""
        return b"".join(self._said).decode("utf-8", "replace")

    def _listen(self, reader: int) -> None:
        while True:
            said = os.read(reader, 65536)
            if not said:
                return
            self._said.append(said)
            sys.stderr.write(said.decode("utf-8", "replace"))

    def start_master(self) -> None:
        self.master = self.run("rosmaster", "--core", "-p", str(self.port))
        wait_until(rosgraph.is_master_online, 10.0, "the master answers")

    def start_reconfigurator(self) -> None:
        files = ("--ontology", str(DATA / "takeover.yaml"), "--som", self.som)
        words = *self._before, program("shsa_core", "reconfigurator"), *files
        self.reconfigurator = self.run(*words)

    def start(self, node: str) -> None:
        topic, value = NODES[node]
        words = [sys.executable, "-m", "shsa_testing.faulty_publisher", f"__name:={node[1:]}"]
        words += [f"_topic:={topic}", f"_value:={value}", f"_period:={PERIOD_S}"]
        self.nodes[node] = self.run(*self._before, *words)

    def settle(self) -> None:
        """Wait until all is well and known, and substitutes are ready and connected."""
        self.healing.await_available(*self.records, seconds=40.0)
        self.healing.await_verified(*NODES)
        wait_until(lambda: self.ready("hot") and len(self.ready("")) == 2, 30.0, "all stand by")

    def ready(self, service: str) -> List[str]:
        """Return the substitutes, or idle ones, of a service that need no master to take over."""
        rows, of = self.healing.substitutions, service or "warm"
        reads = {each.topic for row in rows if row.service == of for each in row.inputs}
        sources = [(topic, node) for node, (topic, _) in NODES.items() if topic in reads]
        nodes = {row.node for row in rows if row.service == service} & set(registered_nodes())
        return [
            node
            for node in nodes
            if all(is_connected(each, f"/{of}", node) for each in ("/old_consumer", "/monitor"))
            and all(is_connected(node, topic, source) for topic, source in sources)
        ]

    def told(self, key: str) -> List[str]:
        """Return what the reconfigurator shows of the master."""
        row = self.rows.get("reconfigurator: ROS master")
        return [each.value for each in row.values if each.key == key] if row else []

    def await_kept(self) -> None:
        """Wait until the reconfigurator has looked what the master knows now."""
        self.rows.clear()
        begun = time.monotonic()

        def kept() -> bool:
            ages = [float(text.split()[-3]) for text in self.told("kept")]
            return bool(ages) and begun < time.monotonic() - ages[0] - SHOWN_S

        wait_until(kept, 20.0, "it is seen what the master knows")

    def outage(self, topic: str, since: float) -> float:
        """Return the longest silence on a topic from shortly before a moment until now, in s."""
        heard = [at for at, _ in list(self.records[topic].heard) if at >= since - 0.2]
        return max(later - at for at, later in zip(heard, heard[1:]))

    def taken_over(self, topic: str, node: str) -> float:
        """Return the outage when a node dies and a substitute publishes, without the master."""
        since = time.monotonic()
        end_process(self.nodes[node])
        wait_until(
            lambda: len(self.records[topic].others(node, since)) > 8, 15.0, f"{topic} goes on"
        )
        return self.outage(topic, since)

    def heard_once(self, topic: str, node: str, since: float) -> bool:
        """Return whether a consumer hears each message once: no connection was made twice."""
        times = [at for at in self.records[topic].times(node) if at >= since]
        return len(times) < 1.2 * (times[-1] - times[0]) / PERIOD_S + 5

    def returned(self, topic: str, node: str) -> None:
        """Start a node again, and wait until the old consumer hears it alone."""
        self.start(node)
        self.healing.await_state(topic, "ended", 30.0)
        since = time.monotonic()
        self.records[topic].await_node(node)
        wait_until(lambda: len(self.records[topic].times(node)) > 10, 10.0, "half a second")
        assert self.heard_once(topic, node, since)

    def end(self) -> None:
        """End every process."""
        for process in self.processes[::-1]:
            process.send_signal(signal.SIGCONT)
            process.send_signal(signal.SIGINT)
        for process in self.processes:
            try:
                process.wait(8.0)
            except subprocess.TimeoutExpired:
                end_process(process)
        os.close(self._errors)


@contextmanager
def running(before: List[str]) -> Iterator[Robot]:
    """Yield a robot whose nodes, and healing, are run by `before`; rospy is one of its nodes."""
    address = own_address()
    with closing(socket.socket()) as free:
        free.bind((address, 0))
        port = free.getsockname()[1]
    folder = tempfile.mkdtemp(prefix="shsa_")  # pytest's own is closed to other users
    if before:
        os.chown(folder, NOBODY, -1)
    environment = dict(os.environ)
    os.environ.pop("ROS_HOSTNAME", None)
    os.environ["ROS_IP"] = address
    os.environ["ROS_MASTER_URI"] = f"http://{address}:{port}"
    made = Robot(port, folder, before)
    try:
        yield made
    finally:
        rospy.signal_shutdown("the tests are over")
        made.end()
        os.environ.clear()
        os.environ.update(environment)
        shutil.rmtree(folder, ignore_errors=True)
