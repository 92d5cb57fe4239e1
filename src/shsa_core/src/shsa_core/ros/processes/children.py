"""The processes that healing has started or taken up: how they end, and who is told."""
import os
import signal
import threading
import time
from typing import Callable, Dict, List, Optional, Protocol, Tuple, Union

import psutil
import rospy

from shsa_core.ros import settings
from shsa_core.ros.processes import kernel

UNKNOWN = "unknown"
Status = Union[int, str]
"""An exit status; UNKNOWN: whoever started the process cannot tell."""


class Process(Protocol):
    """A process, as subprocess.Popen has it."""

    pid: int

    def poll(self) -> Optional[Status]:
        """Return the exit status; None as long as it runs."""


class Foreign:
    """A process that another one has started, which may tell its exit status in `told`."""

    def __init__(self, pid: int, told: Optional[Dict[int, int]] = None) -> None:
        self.pid = pid
        self._known = kernel.identity(pid)
        self._told = {} if told is None else told
        self._told.pop(pid, None)  # of another one, which had this number
        self._status: Optional[Status] = None
        self._until = 0.0  # that long its status may come

    def poll(self) -> Optional[Status]:
        """Return the exit status; None as long as it runs."""
        if self._status is None and kernel.ended(self._known):
            now = time.monotonic()
            self._until = self._until or now + settings.EXIT_STATUS_S
            status = self._told.pop(self.pid, None)
            if status is not None or now > self._until:
                self._status = UNKNOWN if status is None else status
        return self._status


class Children:
    """Calls `ended(status)`, from its own thread and so briefly, once a watched process ended."""

    def __init__(self) -> None:
        self._watched: List[Tuple[Process, Callable[[Status], None]]] = []
        self._changed = threading.Condition()
        threading.Thread(target=self._watch, name="children", daemon=True).start()

    def watch(self, process: Process, ended: Callable[[Status], None]) -> None:
        """Call `ended` with the exit status once this process has ended."""
        with self._changed:
            self._watched.append((process, ended))
            self._changed.notify()

    def _watch(self) -> None:
        while True:
            with self._changed:
                self._changed.wait_for(lambda: self._watched)
                polled = [(each, each[0].poll()) for each in self._watched]
                self._watched = [each for each, status in polled if status is None]
            for (process, ended), status in polled:
                if status is None:
                    continue
                try:
                    ended(status)
                except Exception as error:  # whatever it is, the other processes are waited for
                    rospy.logerr("The end of process %d: %r", process.pid, error)
            time.sleep(settings.EXIT_LOOK_S)


def end(process: Process, answers: bool = True) -> None:
    """End a process and all that it started; ask it first if it can be asked. Waits for its end."""
    if process.poll() is not None:
        return  # its number may be another one's by now
    try:
        asks = answers and not kernel.stopped(psutil.Process(process.pid))
        for number in (signal.SIGINT, signal.SIGKILL) if asks else (signal.SIGKILL,):
            os.killpg(process.pid, number)
            if kernel.wait_for(lambda: process.poll() is not None):
                return
    except (ProcessLookupError, psutil.NoSuchProcess):
        return
