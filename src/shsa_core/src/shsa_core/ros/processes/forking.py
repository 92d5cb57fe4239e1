"""Substitutes forked from a prepared process, which is kept at hand; without one there are none."""
import json
import os
import signal
import socket
import subprocess
import threading
import time
from typing import Callable, List, Mapping, Optional, Sequence

import psutil
import rospy

from shsa_core.ros import settings
from shsa_core.ros.processes import kernel
from shsa_core.ros.processes.prepared import LARGEST_ORDER_B, VARIABLES, arguments
from shsa_core.substitution import signals

OWN_VARIABLES = frozenset((signals.VARIABLE, signals.JOURNAL))
"""Of a fork's environment; what else there is was read when the prepared process was made."""
LONGEST_ANSWER_B = 100


class Forking:
    """Keeps a prepared process, in a thread of its own; it ends with ours.

    `words`: its command; `variables`: its environment, which every fork has; `types`: the message
    types that it is to load; `ready` is called whenever it is there.
    """

    def __init__(
        self,
        words: Sequence[str],
        variables: Mapping[str, str],
        types: Sequence[str] = (),
        ready: Callable[[], object] = lambda: None,
    ) -> None:
        self._words = [*words, *arguments(types)]
        self._variables = {**variables, **VARIABLES}
        self._ready = ready
        self._lock = threading.Lock()
        self._process: Optional["subprocess.Popen[bytes]"] = None
        self._line: Optional[socket.socket] = None  # to a process that is ready
        self._thread = threading.Thread(target=self._keep, name="prepared process", daemon=True)
        self._thread.start()

    def start(self, words: List[str], variables: Mapping[str, str]) -> Optional[psutil.Process]:
        """Fork a process that has these words as its command line; None: that cannot be done now.

        `variables`: its environment beside the one that all have.
        """
        added = {k: v for k, v in variables.items() if self._variables.get(k) != v}
        order = json.dumps({"words": words, "variables": added}).encode()
        with self._lock:
            if self._line is None or self._process is None:
                return None
            if not OWN_VARIABLES.issuperset(added) or len(order) > LARGEST_ORDER_B:
                return None
            try:
                if kernel.stopped(self._process.pid):
                    raise BlockingIOError("the prepared process is stopped")
                self._line.settimeout(settings.PATIENCE_S)
                self._line.send(order, socket.MSG_DONTWAIT)
                pid = int(self._line.recv(LONGEST_ANSWER_B) or b"0")
            except (OSError, psutil.Error) as error:
                rospy.logwarn("%s could not be forked: %r", words[-1], error)
                pid = self._give_up(self._line, self._process)
        try:
            return psutil.Process(pid) if pid else None
        except psutil.NoSuchProcess:
            return None  # it has ended already
        except OSError:
            os.kill(pid, signal.SIGKILL)  # nobody could look after it: there is no descriptor left
            raise

    def _give_up(self, line: socket.socket, process: "subprocess.Popen[bytes]") -> int:
        """End a prepared process that hangs; return the fork that it has made in the last moment.

        None begins later: nobody hears that it is there.
        """
        self._line = None
        process.kill()
        try:
            line.shutdown(socket.SHUT_RDWR)
            return int(line.recv(LONGEST_ANSWER_B) or b"0")
        except OSError:
            return 0

    def _keep(self) -> None:
        pause = settings.FIRST_PAUSE_S
        while not rospy.is_shutdown():
            began = time.monotonic()
            try:
                self._serve()
                why = "it has ended"
            except (OSError, ValueError) as error:
                why = str(error)
            if time.monotonic() > began + settings.LONGEST_PAUSE_S:
                pause = settings.FIRST_PAUSE_S
            if not rospy.is_shutdown():
                text = "No prepared process: %s. Substitutes are started by rosrun; again in %g s."
                rospy.logwarn(text, why, pause)
                time.sleep(pause)
            pause = min(2 * pause, settings.LONGEST_PAUSE_S)

    def _serve(self) -> None:
        """Start a prepared process, and wait until it has ended. Raises OSError."""
        ours, its = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
        ours.settimeout(None)  # rospy gives every socket a minute
        with ours:
            with its:
                process = subprocess.Popen(
                    self._words, env=self._variables, stdin=its.fileno(), start_new_session=True
                )
            self._process = process
            try:
                if ours.recv(LONGEST_ANSWER_B):
                    with self._lock:
                        self._line = ours
                    self._ready()
                    process.wait()
            finally:
                with self._lock:
                    self._line = None
                process.kill()
                process.wait()
