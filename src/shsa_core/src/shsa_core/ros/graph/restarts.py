"""Starts a failed node again, with the command that it was started with."""
import os
import subprocess
import threading
from dataclasses import dataclass
from typing import Callable, Dict, List, Optional

import psutil
import rospy

from shsa_core.errors import ShsaError
from shsa_core.ros.graph.fence import gone
from shsa_core.ros.graph.processes import end

POLL_S = 1.0  # between two looks whether the process that started the node first is still there


@dataclass(frozen=True)
class _Start:
    words: List[str]
    folder: str
    environment: Dict[str, str]
    starter: Optional[psutil.Process]


class Restarts:
    """Learns from the process of each healthy node how it was started.

    `starter_ended(node)` is called, in a thread of its own, once whoever started a node first has
    ended, while the node that was started again still runs.
    """

    def __init__(self, starter_ended: Callable[[str], None]) -> None:
        self._starter_ended = starter_ended
        self._starts: Dict[str, _Start] = {}
        self._running: Dict[str, "subprocess.Popen[bytes]"] = {}
        self._lock = threading.Lock()

    def learn(self, node: str, process: psutil.Process) -> None:
        """Remember how the process of a healthy node was started."""
        try:
            starter = process.parent()
            if starter is not None and starter.pid == 1:
                starter = None  # nobody waits for it
            start = _Start(process.cmdline(), process.cwd(), process.environ(), starter)
        except psutil.NoSuchProcess:
            return
        except (psutil.Error, OSError) as error:
            rospy.logwarn("%s could not be started again: %s", node, error)
            return
        with self._lock:
            ours = self._running.get(node)
            if ours is not None and ours.pid == process.pid:
                return  # we started it: whoever did first is known
            self._starts[node] = start

    def start(self, node: str) -> bool:
        """Start a node again; whether whoever started it first has started us too.

        Raises ShsaError if its start was never seen, OSError if it cannot be made.
        """
        with self._lock:
            start = self._starts.get(node)
        if start is None:
            raise ShsaError("it was never seen healthy on this computer")
        process = subprocess.Popen(
            start.words,
            cwd=start.folder,
            env=start.environment,
            stdin=subprocess.DEVNULL,
            start_new_session=True,
        )
        with self._lock:
            self._running[node] = process
        threading.Thread(target=self._wait, args=(node, process, start), daemon=True).start()
        return start.starter is not None and start.starter.pid == os.getppid()

    def left_alone(self) -> List[str]:
        """The nodes that were started again and still run, and whose first starter has ended."""
        with self._lock:
            running = list(self._running)
            starters = {node: self._starts[node].starter for node in running}
        return [node for node, starter in starters.items() if starter and gone(starter)]

    def stop(self, node: str) -> None:
        """End a node that was started again, and wait until it is gone."""
        with self._lock:
            process = self._running.get(node)
        if process is not None:
            end(process)

    def _wait(self, node: str, process: "subprocess.Popen[bytes]", start: _Start) -> None:
        told = start.starter is None
        while True:
            try:
                process.wait(POLL_S)
                break
            except subprocess.TimeoutExpired:
                if not told and start.starter is not None and gone(start.starter):
                    told = True
                    self._starter_ended(node)
        with self._lock:
            if self._running.get(node) is process:
                del self._running[node]
