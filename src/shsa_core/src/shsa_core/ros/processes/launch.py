"""Launches: which one has started a node, and that one is ending.

While one is ending nodes stop on purpose, and nothing is to be healed. roslaunch signals its nodes
ten at a time, seconds apart. Before that it writes to its log, which is open in the parent process
of its nodes, that it shuts down. Where it cannot be read, our own signal is the first sign.

Two nodes of one name would end each other for ever: the master shuts the older one down, and its
launch starts it again. So it is looked before anything is registered.
"""
import os
import re
import sys
import threading
import time
from contextlib import suppress
from typing import BinaryIO, Callable, Dict, List, Optional, Set, Tuple

import rosgraph
import rosgraph.names
import rospy

from shsa_core.ros import settings
from shsa_core.ros.master.node_api import FAILURES, pid as pid_of, resolved, uri_of
from shsa_core.ros.processes import kernel
from shsa_core.ros.trust.owners import is_local, listener, open_files
from shsa_core.ros.workers import Workers

SHUTDOWN = re.compile(rb"\[roslaunch\.pmon\].*ProcessMonitor\.(_post_run|shutdown) ")


class _LaunchLog:
    """The log of a roslaunch, from now on: what is older is of a launch that went on."""

    def __init__(self, path: str) -> None:
        self._file: BinaryIO = open(path, "rb")
        self._file.seek(0, os.SEEK_END)
        self._begun = b""  # a line that has not ended

    def tells(self) -> bool:
        """Return whether roslaunch has written since the last look that it shuts down."""
        try:
            *lines, self._begun = (self._begun + self._file.read()).split(b"\n")
        except OSError:  # its disk fails, or is away
            return False
        return any(map(SHUTDOWN.search, lines))


class Launch:
    """The roslaunch that started this node, if one did."""

    def __init__(self) -> None:
        self._log = _find_log(os.getpid())
        self._ends = False

    def ending(self) -> bool:
        """Return, once, that it or this node is shutting down. Costs a microsecond."""
        if self._ends:
            return False
        tells = self._log is not None and self._log[1].tells()
        self._ends = bool(rospy.core.is_shutdown_requested()) or tells
        return self._ends


class Launches:
    """The processes of nodes that run on this computer as our user, and their roslaunches."""

    def __init__(self) -> None:
        self._worker = Workers("launches")
        self._lock = threading.Lock()
        self._unknown: Set[str] = set()
        # Each node's process and its roslaunch, 0: none; whose turn it is comes first.
        self._known: Dict[str, Tuple[int, int]] = {}
        self._logs: Dict[int, _LaunchLog] = {}

    def learn(self, node: str) -> None:
        """Find out who started a node, soon; returns at once."""
        with self._lock:
            if not self._unknown:
                self._worker.put(self._look)
            self._unknown.add(node)

    def ending(self) -> Tuple[str, ...]:
        """Return the nodes whose launch has begun to end since the last look."""
        with self._lock:
            ended = {launch for launch, log in self._logs.items() if log.tells()}
            for launch in ended:
                del self._logs[launch]
            nodes = (n for n, (_, launch) in self._known.items() if launch in ended)
            return tuple(sorted(nodes)) if ended else ()

    def waited(self) -> kernel.Waits:
        """Return for how long in all nodes have waited for a processor, in s: each in its turn."""
        if not kernel.crowded():  # to look at each takes 0.1 ms
            return ()
        with self._lock:
            turn = list(self._known.items())[: settings.LOOKED_AT]
            for node, _ in turn:
                self._known[node] = self._known.pop(node)
        return tuple((node, kernel.waited(pid)) for node, (pid, _) in turn)

    def _look(self) -> None:
        time.sleep(settings.CALL_S)
        with self._lock:
            nodes, self._unknown = self._unknown, set()
        try:
            for running in (each for each in kernel.robot_processes() if each.node in nodes):
                launch, log = _find_log(running.process.pid) or (0, None)
                with self._lock:
                    self._known[running.node] = running.process.pid, launch
                    if log is not None:
                        self._logs.setdefault(launch, log)
                    launches = {launch for _, launch in self._known.values()}
                    self._logs = {pid: log for pid, log in self._logs.items() if pid in launches}
        except OSError:  # we lack the means to look now
            for node in nodes:
                self.learn(node)
            raise


def _find_log(pid: int) -> Optional[Tuple[int, _LaunchLog]]:
    for ancestor in (each.pid for each in kernel.ancestors(pid)):
        for file in open_files(ancestor):
            if re.search(rf"/[^/]*-{ancestor}\.log$", file):
                with suppress(OSError):  # it cannot be opened
                    return ancestor, _LaunchLog(file)
    return None


GONE_LOOKS = 5
"""So often nobody must be found: a launch starts its healer again within 2 s."""
ASKED_BY_API = "external shutdown request"
"""The beginning of rospy's reason then."""


def await_turn(name: str) -> None:
    """Return at once if no other node `name` of this namespace answers on the master.

    Else say so and leave, with exit status 1. What a launch would start again and again waits,
    registered nowhere, until the other one has gone for good.
    """
    mappings = rosgraph.names.load_mappings(sys.argv)
    full = str(rosgraph.names.make_caller_id(mappings.get("__name", name))).rstrip("/")
    other = find_other(full)
    if other is None:
        return
    text = f"Healing runs on this ROS master already: {full} is {other}. This one leaves."
    if not kernel.started_by_launch(os.getpid()):
        sys.exit(text)
    print(f"{text} It takes its place once that has ended: rosnode kill {full}", file=sys.stderr)
    gone = 0
    with suppress(KeyboardInterrupt):
        while gone < GONE_LOOKS:
            time.sleep(settings.LOOK_S)
            gone = gone + 1 if find_other(full) is None else 0
        return
    sys.exit(0)


def find_other(node: str) -> Optional[str]:
    """Return in words which process a node is that is registered and answers; None: none.

    One of another user of this computer is none: anybody can register our name.
    """
    try:
        uri = uri_of(node)
        number = pid_of(uri)
    except FAILURES:
        return None
    process = listener(resolved(uri), number) if is_local(uri) else None
    if is_local(uri) and (process is None or not kernel.is_ours(process)):
        whose = kernel.user(process)
        text = f"{node} is a process of {whose}, and no healer of ours: it is replaced."
        print(text, file=sys.stderr)
        return None
    return f"process {number} at {uri}"


def hear_successor() -> Callable[[], bool]:
    """Return, before `init_node`, what tells at the end that our launch starts another one."""
    reasons: List[str] = []  # anybody may ask it to end by its API, as soon as it has registered
    rospy.core.add_preshutdown_hook(reasons.append)
    asked = lambda: any(each.startswith(ASKED_BY_API) for each in reasons)
    return lambda: asked() and kernel.started_by_launch(os.getpid())
