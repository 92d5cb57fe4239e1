"""A ROS graph of its own for a measurement: a master on a free port, and nodes that end with it."""
import os
import socket
import subprocess
import sys
import time
from pathlib import Path
from types import TracebackType
from typing import Callable, Dict, List, Optional, Sequence, Type

import rosgraph

PACKAGE = Path(__file__).resolve().parent.parent
BENCH = PACKAGE / "bench"
FAULTY_PUBLISHER = PACKAGE / "test" / "rostest" / "faulty_publisher"
MONITOR = PACKAGE / "nodes" / "monitor"


class Graph:
    """`with Graph() as graph:` has a master; the environment of this process points at it."""

    def __init__(self) -> None:
        self._processes: List[subprocess.Popen] = []

    def __enter__(self) -> "Graph":
        with socket.socket() as free:
            free.bind(("localhost", 0))
            port = free.getsockname()[1]
        os.environ["ROS_MASTER_URI"] = f"http://localhost:{port}"
        self.start(["rosmaster", "--core", "-p", str(port)])
        if not wait_until(lambda: rosgraph.is_master_online(), 20.0):
            raise RuntimeError("the master does not come up")
        return self

    def __exit__(
        self,
        kind: Optional[Type[BaseException]],
        error: Optional[BaseException],
        trace: Optional[TracebackType],
    ) -> None:
        for process in reversed(self._processes):
            self.end(process)

    def python(self, script: Path, *arguments: str) -> subprocess.Popen:
        """Start a Python node."""
        return self.start([sys.executable, str(script), *arguments])

    def end(self, process: subprocess.Popen) -> None:
        """End a process for certain."""
        if process.poll() is None:
            process.terminate()
            try:
                process.wait(3.0)
            except subprocess.TimeoutExpired:
                process.kill()
                process.wait()

    def start(self, command: Sequence[str]) -> subprocess.Popen:
        """Start a process; its output is dropped."""
        process = subprocess.Popen(
            list(command), stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL
        )
        self._processes.append(process)
        return process


def service(topic: str, node: str, period: float, **more: object) -> Dict[str, object]:
    """A service on a topic of shsa_msgs/Float64Stamped, as it lies on the parameter server."""
    entry: Dict[str, object] = {"topic": topic, "node": node, "period": period, "field": "data"}
    entry["type"] = "shsa_msgs/Float64Stamped"
    entry.update(more)
    return entry


def wait_until(condition: Callable[[], bool], seconds: float) -> bool:
    """Wait for a condition; whether it came true in time."""
    end = time.monotonic() + seconds
    while time.monotonic() < end:
        if condition():
            return True
        time.sleep(0.002)
    return condition()
