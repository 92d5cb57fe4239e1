"""A ROS graph of its own for a measurement: a master on a free port, and nodes.

All of them are ended afterwards.
"""
import json
import os
import shutil
import signal
import socket
import subprocess
import sys
import tempfile
import uuid
from contextlib import suppress
from functools import cached_property
from pathlib import Path
from types import TracebackType
from typing import Any, Dict, Iterable, Iterator, List, Mapping, Optional, Type

import psutil
import rosgraph
import rospy
from roslib.packages import find_node

from shsa_core.files.som_file import PARAMETER
from shsa_core.ros.master.node_api import node_api
from shsa_testing.healing import HealedRobot
from shsa_testing.processes import marked
from shsa_testing.waiting import wait_until

PACKAGE = Path(__file__).resolve().parent.parent
BENCH = PACKAGE / "bench"
FAULTY_PUBLISHER = PACKAGE.parent / "shsa_testing" / "nodes" / "faulty_publisher"
MONITOR = PACKAGE / "nodes" / "monitor"
GATE_PROGRAM = PACKAGE.parent / "shsa_gate" / "nodes" / "gate"
MARK = "SHSA_BENCH"
PATIENCE_S = 30.0  # with hundreds of nodes up, everything takes longer


class Graph:
    """`with Graph() as graph:` has a master on a free port; this process is a node of it.

    Whatever was started inside has ended after it, however it ends: every process that inherits the
    mark.
    """

    def __init__(self) -> None:
        self.folder = Path(tempfile.mkdtemp(prefix="shsa_bench_"))
        self._mark = uuid.uuid4().hex
        self._output = self.folder / "output"

    def __enter__(self) -> "Graph":
        signal.signal(signal.SIGTERM, _leave)
        with socket.socket() as free:
            free.bind(("", 0))
            port = free.getsockname()[1]
        os.environ.update(
            {
                "ROS_MASTER_URI": f"http://localhost:{port}",
                "ROS_LOG_DIR": str(self.folder),
                MARK: self._mark,
            }
        )
        self._port = port
        self.start_master()
        rospy.init_node("bench", disable_signals=True)
        return self

    def __exit__(
        self,
        kind: Optional[Type[BaseException]],
        error: Optional[BaseException],
        trace: Optional[TracebackType],
    ) -> None:
        for impatience in (signal.SIGINT, signal.SIGTERM):
            signal.signal(impatience, signal.SIG_IGN)
        for process in self._started():
            try:
                process.kill()
            except psutil.NoSuchProcess:
                continue
        shutil.rmtree(str(self.folder), ignore_errors=True)

    def start_master(self) -> None:
        """Start the master, and wait until it answers."""
        self.master = self.start("rosmaster", "--core", "-p", str(self._port))
        wait_until(rosgraph.is_master_online, PATIENCE_S, "the master")

    def processes(self) -> List[psutil.Process]:
        """Return everything that runs of this graph, save this process."""
        return [each for each in marked(MARK, self._mark) if each.pid != os.getpid()]

    @cached_property
    def healing(self) -> HealedRobot:
        """Return the messages of healing in this graph."""
        return HealedRobot()

    def start(self, *command: str, heard: bool = False) -> "subprocess.Popen[str]":
        """Start a process; its output goes to a file, or is read by whoever wants it `heard`."""
        with open(self._output, "a") as output:
            return subprocess.Popen(
                command,
                stdin=subprocess.DEVNULL,
                stdout=subprocess.PIPE if heard else output,
                stderr=output,
                start_new_session=True,
                universal_newlines=True,
            )

    def start_busy(self, count: int) -> "List[subprocess.Popen[str]]":
        """Start processes that compute all the time."""
        return [self.start(sys.executable, "-c", "while True: pass") for _ in range(count)]

    def last_words(self, count: int = 15) -> str:
        """Return the last lines of what the processes said."""
        return "".join(self._output.read_text(errors="replace").splitlines(True)[-count:])

    def python(self, script: Path, *arguments: str, heard: bool = False) -> "subprocess.Popen[str]":
        """Start a Python node."""
        return self.start(sys.executable, str(script), *arguments, heard=heard)

    def cpp(self, name: str, *arguments: str, heard: bool = False) -> "subprocess.Popen[str]":
        """Start a C++ node of this folder."""
        found = find_node("shsa_core", f"bench_{name}")
        if not found:
            raise RuntimeError(f"bench_{name} is not built; run make build")
        return self.start(found[0], *arguments, heard=heard)

    def _started(self) -> Iterator[psutil.Process]:
        """Yield every process with our mark, until there is none."""
        while True:
            ours = self.processes()
            if not ours:
                return
            yield from ours
            psutil.wait_procs(ours, timeout=1.0)


def _leave(number: int, frame: Any) -> None:
    raise SystemExit(f"ended by signal {number}")


def ask_to_leave(process: "subprocess.Popen[str]", seconds: float = 10.0) -> None:
    """Interrupt a process; kill it if it does not leave."""
    process.send_signal(signal.SIGINT)
    try:
        process.wait(seconds)
    except subprocess.TimeoutExpired:
        process.kill()
        process.wait()


def uri_of(node: str) -> str:
    """Return the URI of a node; empty if the master does not know it."""
    try:
        uri: str = rosgraph.Master(rospy.get_name()).lookupNode(node)
    except rosgraph.MasterException:
        return ""
    return uri.rstrip("/")


def shut_down(node: str) -> None:
    """Do as `rosnode kill`, without the start of a command."""
    with suppress(OSError):  # it may be gone before it can answer
        node_api(uri_of(node)).shutdown(rospy.get_name(), "the benchmark says so")


def service(
    topic: str,
    node: str,
    period: float,
    value: Optional[Mapping[str, object]] = None,
    **more: object,
) -> Dict[str, object]:
    """Return a service on a topic of shsa_msgs/Float64Stamped as in a SOM file.

    It provides a property of the topic's name.

    `value` is what else is said of its value, and `more` what else is said of it.
    """
    provided: Dict[str, object] = {"field": "data", **(value or {})}
    return {
        "topic": topic,
        "type": "shsa_msgs/Float64Stamped",
        "node": node,
        "period": period,
        "needed": False,
        "provides": {topic.strip("/"): provided},
        **more,
    }


def write_som(path: Path, services: Iterable[Mapping[str, object]]) -> Path:
    """Write a SOM file of services, each with the name of its topic.

    No older one is left as parameters.
    """
    if rospy.has_param(PARAMETER):
        rospy.delete_param(PARAMETER)
    named = {str(each["topic"]).strip("/"): each for each in services}
    path.write_text(json.dumps({"act": True, "services": named}, indent=1))  # JSON is YAML as well
    return path
