"""Starts a failed node again, with the command that it was started with."""
import os
import subprocess
import threading
from dataclasses import dataclass, replace
from typing import Callable, Dict, List, Optional, Set, Tuple

import psutil
import rospy

from shsa_core.errors import ShsaError
from shsa_core.ros.processes.children import Children
from shsa_core.ros.processes.kernel import NOBODY, Identity, gone, identity, is_ours, same_process
from shsa_core.ros.processes.starting import AnyProcess, FormerProcess, end

POLL_S = 1.0  # between two looks whether the process that started the node first is still there


def may_restart(as_root: bool) -> bool:
    """Whether nodes are started again by our user; `as_root`: also if that is root."""
    return as_root or os.geteuid() != 0


def _children(pid: int) -> List[int]:
    """The processes that a process has started; empty where the kernel does not tell."""
    tasks = f"/proc/{pid}/task"
    found: List[int] = []
    try:
        for task in os.listdir(tasks):
            with open(f"{tasks}/{task}/children") as file:
                found += map(int, file.read().split())
    except OSError:
        return found
    return found


@dataclass(frozen=True)
class _Start:
    words: List[str]
    folder: str
    environment: Dict[str, str]
    starter: Optional[psutil.Process]


class Restarts:
    """Learns from the process of each healthy node how it was started.

    `starter_ended(node)` is called once whoever started a node first has ended, while the node that
    was started again still runs.
    """

    def __init__(self, starter_ended: Callable[[str], None]) -> None:
        self._starter_ended = starter_ended
        self._starts: Dict[str, _Start] = {}
        self._running: Dict[str, AnyProcess] = {}
        self._told: Set[str] = set()
        self._lock = threading.Lock()
        self._children = Children()
        threading.Thread(target=self._watch_starters, name="starters", daemon=True).start()

    def learn(self, node: str, process: psutil.Process) -> None:
        """Remember how the process of a healthy node was started, which is of our own user."""
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
        if gone(process) or not is_ours(process):
            return  # another one has its number by now
        with self._lock:
            ours = self._running.get(node)
            if ours is not None and ours.pid == process.pid:
                start = replace(start, starter=self._starts[node].starter)  # we started it
            self._starts[node] = start

    def started_again(self, node: str) -> Optional[psutil.Process]:
        """The process of ours that whoever started a node has started with the same command.

        None: there is none, or that cannot be told.
        """
        with self._lock:
            start = self._starts.get(node)
        if start is None or start.starter is None:
            return None
        for pid in _children(start.starter.pid):
            try:
                process = psutil.Process(pid)
                if process.cmdline() == start.words and is_ours(process):
                    return process
            except psutil.Error:
                continue
        return None

    def take_up(self, node: str, process: psutil.Process, starter: Identity) -> None:
        """A node that a former reconfigurator has started again is ours now.

        How it is started is not told, and learned while it is healthy; its process keeps who
        started it first.
        """
        first = same_process(starter)
        gone_already = starter != NOBODY and first is None
        if gone_already:
            self._starter_ended(node)
        start = _Start([], "", {}, first)
        former = FormerProcess(process)
        with self._lock:
            self._starts[node], self._running[node] = start, former
            self._told.discard(node)
        self._children.watch(former, lambda _: self._over(node, former))

    def identities(self, node: str) -> Tuple[Identity, Identity]:
        """The process of a node that was started again, and that of who started it first."""
        with self._lock:
            process, start = self._running.get(node), self._starts.get(node)
        starter = start.starter if start else None
        return identity(process.pid if process else 0), identity(starter.pid if starter else 0)

    def start(self, node: str) -> Tuple[psutil.Process, bool]:
        """Start a node again: its process, and whether whoever started it first started us too.

        Raises ShsaError if its start was never seen, OSError if it cannot be made.
        """
        with self._lock:
            start = self._starts.get(node)
        if start is None or not start.words:
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
            self._told.discard(node)
        started = psutil.Process(process.pid)
        self._children.watch(process, lambda _: self._over(node, process))
        return started, start.starter is not None and start.starter.pid == os.getppid()

    def running(self) -> List[str]:
        """The nodes that were started again, and run."""
        with self._lock:
            return sorted(self._running)

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

    def _watch_starters(self) -> None:
        while not rospy.is_shutdown():
            rospy.rostime.wallsleep(POLL_S)
            for node in self.left_alone():
                with self._lock:
                    if node in self._told or node not in self._running:
                        continue
                    self._told.add(node)
                self._starter_ended(node)

    def _over(self, node: str, process: AnyProcess) -> None:
        with self._lock:
            if self._running.get(node) is process:
                del self._running[node]
