"""Substitutes forked from a prepared process, which is kept at hand; without one there are none."""
import array
import json
import socket
import subprocess
import threading
import time
from typing import Callable, Dict, List, Mapping, Optional, Sequence

import psutil
import rospy

from shsa_core.ros import settings
from shsa_core.ros.processes import kernel
from shsa_core.ros.processes.children import Foreign
from shsa_core.ros.processes.heartbeats import SPACE, sender
from shsa_core.ros.processes.prepared import GO, LARGEST_ORDER_B, READY, VARIABLES, arguments
from shsa_core.substitution import signals

OWN_VARIABLES = frozenset((signals.VARIABLE, signals.JOURNAL))
"""Of a fork's environment; what else there is was read when the prepared process was made."""


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
        self.ready = threading.Event()
        self._closed = threading.Event()
        self._thread = threading.Thread(target=self._keep, name="prepared process", daemon=True)
        self._thread.start()

    @property
    def pid(self) -> int:
        """Return the number of the prepared process; 0: there is none now."""
        process = self._process
        return process.pid if process is not None and self.ready.is_set() else 0

    def close(self) -> None:
        """End the prepared process; what it has forked goes on."""
        self._closed.set()
        with self._lock:
            if self._line is not None:
                self._line.shutdown(socket.SHUT_RDWR)
        self._thread.join()

    def start(self, words: List[str], variables: Mapping[str, str]) -> Optional[Foreign]:
        """Fork a process that has these words as its command line; None: that cannot be done now.

        `variables`: its environment beside the one that all have.
        """
        with self._lock:
            line, process = self._line, self._process
            if line is None or process is None or not self.ready.is_set():
                return None
            added = {k: v for k, v in variables.items() if self._variables.get(k) != v}
            order = json.dumps({"words": words, "variables": added}).encode()
            if not OWN_VARIABLES.issuperset(added) or len(order) > LARGEST_ORDER_B:
                return None
            if kernel.stopped(process):
                self._give_up(process)
                return None
            ours, its = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
            with ours:
                ours.setsockopt(socket.SOL_SOCKET, socket.SO_PASSCRED, 1)
                ours.settimeout(settings.FORK_S)
                try:
                    with its:
                        rights = array.array("i", [its.fileno()])
                        ancillary = [(socket.SOL_SOCKET, socket.SCM_RIGHTS, rights)]
                        line.sendmsg([order], ancillary, socket.MSG_DONTWAIT)
                    return self._await(ours)
                except socket.timeout:
                    self._give_up(process)
                except OSError as error:
                    rospy.logwarn("%s could not be forked: %r", words[-1], error)
        return None

    def _await(self, connection: socket.socket) -> Optional[Foreign]:
        """Let the fork begin, once it says that it is there; the kernel says which one it is."""
        answer, extra, _, _ = connection.recvmsg(len(READY), SPACE)
        pid = sender(extra)
        if answer != READY or not pid:
            return None
        forked = Foreign(pid, self._told)
        connection.send(GO)
        return forked

    def _give_up(self, process: psutil.Process) -> None:
        """End a prepared process that hangs, so that another one is started."""
        self.ready.clear()
        try:
            process.kill()
        except psutil.NoSuchProcess:
            return  # it was quicker

    def _keep(self) -> None:
        pause = settings.FIRST_PAUSE_S
        while not self._over():
            began = time.monotonic()
            try:
                self._serve()
                why = "it has ended"
            except (OSError, ValueError, psutil.Error) as error:
                why = str(error)
            if time.monotonic() > began + settings.LONGEST_PAUSE_S:
                pause = settings.FIRST_PAUSE_S
            if not self._over():
                text = "No prepared process: %s. Substitutes are started by rosrun; again in %g s."
                rospy.logwarn(text, why, pause)
                self._closed.wait(pause)
            pause = min(2 * pause, settings.LONGEST_PAUSE_S)

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
