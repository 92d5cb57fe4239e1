"""Starts a failed node again with the command that it was started with, and sees it come up."""
import json
import os
import time
from contextlib import suppress
from pathlib import Path
from typing import Callable, Dict, Iterator, List, NamedTuple, Optional, Sequence, Set

import psutil
import rospy

from shsa_core.errors import ShsaError
from shsa_core.ros import settings
from shsa_core.ros.processes.children import Children, Started
from shsa_core.ros.processes.kernel import NOBODY, Identity, ended, gone, identity
from shsa_core.ros.processes.kernel import is_ours, robot_processes, started_by_launch
from shsa_core.ros.workers import guarded, repeating

TICKS_HZ = os.sysconf("SC_CLK_TCK")  # of the kernel, in which it tells a start
MARK = "SHSA_RESTARTED"
"""The environment variable of a node that healing restarted: whose it is, its name, its starter."""
OF_A_START = {MARK, "INVOCATION_ID", "JOURNAL_STREAM", "SYSTEMD_EXEC_PID"}
"""Environment variables that differ at each start: ours, and those of systemd."""


def _children(pid: int) -> Iterator[int]:
    with suppress(OSError):
        for file in Path(f"/proc/{pid}/task").glob("*/children"):
            yield from map(int, file.read_text().split())


class _Start(NamedTuple):
    words: List[str]
    folder: str
    environment: Dict[str, str]
    process: Identity


class Restarts:
    """Learns from the process of each healthy node how it was started, and starts it again.

    Tells, in a thread: `starter_ended(node)` while a restarted node still runs, and the process
    that started it first has ended; `came(node, process)` once that has started an awaited node
    again. `host`: the name of the agent that we are.
    """

    def __init__(
        self,
        children: Children,
        starter_ended: Callable[[str], None],
        came: Callable[[str, psutil.Process], None],
        host: str = "",
    ) -> None:
        self._awaited: Sequence[str] = ()
        self._children, self._starter_ended, self._came = children, starter_ended, came
        self._owner = f"{rospy.get_namespace()} {host}"
        self._starts: Dict[str, _Start] = {}
        self._starters: Dict[str, Identity] = {}  # who started each first; NOBODY: nobody waits
        self._others: Dict[str, Set[int]] = {}  # by node: children of its starter that it is not
        self._told: Dict[str, psutil.Process] = {}  # those that came
        repeating("restarts", settings.TICK_S, self._work).start()

    def watch(self, nodes: Sequence[str]) -> None:
        """Await these nodes from now on, and no others."""
        self._awaited = nodes

    def learn(self, node: str, process: psutil.Process) -> None:
        """Remember how the process of a healthy node was started, which is of our own user."""
        try:
            parent = process.ppid()
            # The first process may be whose parent has ended, or a roslaunch, as in a container.
            has_starter = parent > 1 or started_by_launch(process.pid)
            starter = identity(parent) if has_starter else NOBODY
            words, folder, variables = process.cmdline(), process.cwd(), process.environ()
            start = _Start(words, folder, variables, identity(process.pid))
        except (psutil.Error, OSError) as error:
            if not isinstance(error, psutil.NoSuchProcess):
                rospy.logwarn("%s could not be started again: %s", node, error)
            return
        if gone(process) or not is_ours(process) or not words:
            return  # another one has its number by now
        if self._children.process(node) != process:  # else we started it
            self._starters[node] = starter
        self._starts[node] = start

    def knows(self, node: str) -> bool:
        """Return whether a node could be started again."""
        return node in self._starts

    def _started_again(self, node: str) -> Optional[psutil.Process]:
        start, starter = self._starts.get(node), self._starters.get(node, NOBODY)
        if start is None or ended(starter):
            return None
        children, before = set(_children(starter[0])), self._others.get(node, set())
        others = self._others[node] = before & children
        for pid in children - others:
            with suppress(psutil.Error, OSError):  # without descriptors the next look is soon
                process = psutil.Process(pid)
                if self._is_next(node, start, process):
                    return process
                age = time.clock_gettime(time.CLOCK_BOOTTIME) - identity(pid)[1] / TICKS_HZ
                if age > settings.LOOK_S:  # it is no fork of late
                    others.add(pid)
        return None

    def _is_next(self, node: str, start: _Start, process: psutil.Process) -> bool:
        """Return whether a process is a later one of a node: a sibling may have its words, too."""
        if process.cmdline() != start.words or process.cwd() != start.folder:
            return False
        known, others = identity(process.pid), list(self._starts.items())
        if known[1] <= start.process[1] or known in [s.process for n, s in others if n != node]:
            return False
        lasting = lambda variables: {k: v for k, v in variables.items() if k not in OF_A_START}
        return lasting(process.environ()) == lasting(start.environment) and is_ours(process)

    def take_up(self) -> List[str]:
        """Make ours what a former reconfigurator or agent has started again; return the nodes."""
        taken = []
        for process, _, variables in robot_processes():
            try:
                owner, node, number, since = json.loads(variables.get(MARK, "[0, 0, 0, 0]"))
                first = int(number), float(since)
                # What the node itself has started has the mark as well.
                is_node = owner == self._owner and os.getsid(process.pid) == process.pid
            except Exception:  # anybody may have written the mark, and whatever it is
                continue
            if is_node and isinstance(node, str) and not gone(process):
                self._starters[node] = first
                self._children.keep(node, process)
                taken.append(node)
        return taken

    def start(self, node: str) -> psutil.Process:
        """Start a node again. Raises ShsaError if its start was never seen, OSError."""
        start = self._starts.get(node)
        if start is None:
            raise ShsaError("it was never seen healthy on this computer")
        mark = {MARK: json.dumps([self._owner, node, *self._starters[node]])}
        process = Started(start.words, env={**start.environment, **mark}, cwd=start.folder or None)
        self._children.keep(node, process)
        return process

    def abandoned(self, ending: bool = False) -> List[str]:
        """Return restarted nodes that run and whose starter ends; ours is, if we are `ending`."""
        running = filter(self._starters.__contains__, self._children.running())
        starters = {node: self._starters[node] for node in running}
        ours = identity(os.getppid()) if ending else NOBODY
        over = lambda first: ended(first) or first == ours
        return [node for node, first in starters.items() if first != NOBODY and over(first)]

    def _work(self) -> None:
        for node in self._awaited:
            guarded(f"The look for {node}", self._look, node)
        for node in self.abandoned():
            self._starters[node] = NOBODY  # it is told once
            guarded(f"The end of the starter of {node}", self._starter_ended, node)

    def _look(self, node: str) -> None:
        process = self._started_again(node)
        if process is not None and process != self._told.get(node):
            self._came(node, process)
            self._told[node] = process
