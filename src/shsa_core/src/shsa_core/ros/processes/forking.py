"""Substitutes forked from a prepared process, which is kept at hand; without one there are none."""
import array
import json
import os
import select
import socket
import subprocess
import threading
import time
from typing import Callable, Dict, List, Mapping, Optional, Sequence

import psutil
import rospy

from shsa_core.ros.processes.children import Status
from shsa_core.ros.processes.heartbeats import SPACE, sender
from shsa_core.ros.processes.kernel import descriptor, gone, stopped
from shsa_core.ros.processes.prepared import GO, LARGEST_ORDER_B, READY, VARIABLES, arguments
from shsa_core.substitution import signals

ANSWER_TIMEOUT_S = 1.0
"""A fork takes 10 ms; who orders one waits no longer, and starts a process by rosrun.

Where the machine is so busy that a fork takes as long, a process by rosrun takes many times that.
"""
MISSES = 2
"""So many orders in a row go unanswered in time before the prepared process is taken to hang."""
PAUSES_S = (1.0, 2.0, 4.0, 8.0, 16.0, 32.0, 60.0)
"""Before the prepared process is started again; the first one if it has lived for the last."""
UNTOLD_S = 0.1
"""So long after a fork has ended its exit status may come."""
UNKNOWN = "unknown"
OWN_VARIABLES = frozenset((signals.VARIABLE, signals.JOURNAL))
"""Of a fork's environment; what else there is was read when the prepared process was made."""


class Forked:
    """A process that was forked; as a subprocess.Popen."""

    def __init__(self, pid: int, told: Dict[int, int]) -> None:
        self.pid = pid
        self._process = psutil.Process(pid)
        self._told = told
        told.pop(pid, None)  # of another one, which had this number
        self._over = 0.0
        self._status: Optional[Status] = None
        self._descriptor = descriptor(pid)

    def poll(self) -> Optional[Status]:
        """The exit status; UNKNOWN if who has forked it cannot tell; None as long as it runs."""
        if self._status is not None or not self._ended():
            return self._status
        self._over = self._over or time.monotonic()
        self._status = self._told.pop(self.pid, None)
        if self._status is None and time.monotonic() > self._over + UNTOLD_S:
            self._status = UNKNOWN
        return self._status

    def wait(self, timeout: Optional[float] = None) -> None:
        """Wait until it has ended. Raises subprocess.TimeoutExpired."""
        deadline = time.monotonic() + (timeout if timeout is not None else float("inf"))
        while not self._ended():
            if time.monotonic() > deadline:
                raise subprocess.TimeoutExpired(str(self.pid), timeout or 0.0)
            time.sleep(0.002)

    def _ended(self) -> bool:
        if self._over:
            return True
        if self._descriptor is None:
            return gone(self._process)
        poller = select.poll()  # several threads may ask, and each needs its own
        poller.register(self._descriptor, select.POLLIN)
        return bool(poller.poll(0))

    def __del__(self) -> None:
        if self._descriptor is not None:
            os.close(self._descriptor)


class Forking:
    """Keeps a prepared process, in a thread of its own.

    `words`: its command; `variables`: its environment, which every fork has; `types`: the message
    types that it is to load; `told` is called whenever it is ready.
    """

    def __init__(
        self,
        words: Sequence[str],
        variables: Mapping[str, str],
        types: Sequence[str] = (),
        told: Callable[[], object] = lambda: None,
    ) -> None:
        self._words = [*words, *arguments()]
        self._variables = {**variables, **VARIABLES}
        self._types = list(types)
        self._is_ready = told
        self._told: Dict[int, int] = {}
        self._lock = threading.Lock()
        self._process: Optional[psutil.Process] = None
        self._line: Optional[socket.socket] = None
        self._misses = 0
        self.ready = threading.Event()
        self._closed = threading.Event()
        self._thread = threading.Thread(target=self._keep, name="prepared process", daemon=True)
        self._thread.start()

    @property
    def pid(self) -> int:
        """The prepared process; 0: there is none now."""
        process = self._process
        return process.pid if process is not None and self.ready.is_set() else 0

    def close(self) -> None:
        """End the prepared process; what it has forked goes on."""
        self._closed.set()
        with self._lock:
            if self._line is not None:
                self._line.shutdown(socket.SHUT_RDWR)
        self._thread.join()

    def start(self, words: List[str], variables: Mapping[str, str]) -> Optional[Forked]:
        """Fork a process that has these words as its command line; None: that cannot be done now.

        `variables`: its environment beside the one that all have.
        """
        with self._lock:
            line, process = self._line, self._process
            if line is None or process is None or not self.ready.is_set():
                return None
            added = {k: v for k, v in variables.items() if self._variables.get(k) != v}
            if not OWN_VARIABLES.issuperset(added):
                return None
            if stopped(process):
                self._give_up(process)
                return None
            order = json.dumps({"words": words, "variables": added}).encode()
            if len(order) > LARGEST_ORDER_B:
                return None
            ours, its = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
            with ours:
                ours.setsockopt(socket.SOL_SOCKET, socket.SO_PASSCRED, 1)
                ours.settimeout(ANSWER_TIMEOUT_S)
                try:
                    with its:
                        rights = array.array("i", [its.fileno()])
                        ancillary = [(socket.SOL_SOCKET, socket.SCM_RIGHTS, rights)]
                        line.sendmsg([order], ancillary, socket.MSG_DONTWAIT)
                    forked = self._await(ours)
                    self._misses = 0
                    return forked
                except socket.timeout:
                    self._misses += 1
                    if self._misses >= MISSES:
                        self._give_up(process)
                except (OSError, psutil.Error) as error:
                    rospy.logwarn("%s could not be forked: %r", words[-1], error)
        return None

    def _await(self, connection: socket.socket) -> Optional[Forked]:
        """Let the fork begin, once it says that it is there; the kernel says which one it is."""
        answer, extra, _, _ = connection.recvmsg(len(READY), SPACE)
        pid = sender(extra)
        if answer != READY or not pid:
            return None
        forked = Forked(pid, self._told)
        connection.send(GO)
        return forked

    def _give_up(self, process: psutil.Process) -> None:
        """End a prepared process that hangs, so that another one is started."""
        self.ready.clear()
        self._misses = 0
        try:
            process.kill()
        except psutil.NoSuchProcess:
            pass  # it was quicker

    def _keep(self) -> None:
        tries = 0
        while not self._over():
            began = time.monotonic()
            try:
                self._serve()
                why = "it has ended"
            except (OSError, ValueError, psutil.Error) as error:
                why = str(error)
            tries = 0 if time.monotonic() > began + PAUSES_S[-1] else tries
            pause = PAUSES_S[min(tries, len(PAUSES_S) - 1)]
            tries += 1
            if not self._over():
                text = "No prepared process: %s. Substitutes are started by rosrun; again in %g s."
                rospy.logwarn(text, why, pause)
                self._closed.wait(pause)

    def _over(self) -> bool:
        return self._closed.is_set() or rospy.is_shutdown()

    def _serve(self) -> None:
        """Start a prepared process and hear what it says until it has ended. Raises OSError."""
        ours, its = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
        ours.settimeout(None)  # rospy gives every socket a minute
        with ours:
            with its:
                process = subprocess.Popen(
                    self._words, env=self._variables, stdin=its.fileno(), start_new_session=True
                )
            try:
                with self._lock:
                    self._process, self._line = psutil.Process(process.pid), ours
                while not self._over():
                    data = ours.recv(4096)
                    if not data:
                        return
                    told = json.loads(data)
                    if "ready" in told:
                        if self._types:
                            ours.send(json.dumps({"types": self._types}).encode())
                        self.ready.set()
                        self._is_ready()
                    else:
                        self._told[told["pid"]] = told["status"]
            finally:
                with self._lock:
                    self.ready.clear()
                    self._line = self._process = None
                process.kill()
                process.wait()
