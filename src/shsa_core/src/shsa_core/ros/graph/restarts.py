"""Starts a failed node again, with the command that it was started with."""
import os
import subprocess
import threading
from dataclasses import dataclass
from typing import Dict, List, Optional, Tuple

import psutil
import rospy

from shsa_core.errors import ShsaError
from shsa_core.ros.graph.fence import gone
from shsa_core.ros.graph.processes import end

POLL = 1.0  # s between two looks whether the process that started the node first is still there


@dataclass(frozen=True)
class _Start:
    words: List[str]
    folder: str
    environment: Dict[str, str]
    starter: Optional[psutil.Process]


class Restarts:
    """Learns from the process of each healthy node how it was started.

    A node that was started again lives no longer than whoever started it first: roslaunch, or a terminal.
    """

    def __init__(self) -> None:
        self._starts: Dict[str, _Start] = {}
        self._running: Dict[str, Tuple["subprocess.Popen[bytes]", _Start]] = {}
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
            if ours is not None and ours[0].pid == process.pid:
                return  # we started it: whoever did first is known
            self._starts[node] = start

    def start(self, node: str) -> None:
        """Start a node again. Raises ShsaError if its start was never seen, OSError if it cannot be made."""
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
            self._running[node] = (process, start)
        threading.Thread(target=self._wait, args=(node, process, start), daemon=True).start()

    def stop(self) -> None:
        """End the nodes whose first starter has ended, or is about to end us as well."""
        ours = os.getppid()
        with self._lock:
            running = list(self._running.values())
        for process, start in running:
            starter = start.starter
            if starter is not None and (starter.pid == ours or gone(starter)):
                end(process)

    def _wait(self, node: str, process: "subprocess.Popen[bytes]", start: _Start) -> None:
        while True:
            try:
                process.wait(POLL)
                break
            except subprocess.TimeoutExpired:
                if start.starter is not None and gone(start.starter):
                    end(process)
        with self._lock:
            if self._running.get(node) == (process, start):
                del self._running[node]
