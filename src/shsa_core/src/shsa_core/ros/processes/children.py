"""Waits for the processes that were started: one thread for all of them."""
import threading
from typing import Callable, List, Optional, Protocol, Tuple, Union

import rospy

POLL_S = 0.02

Status = Union[int, str]
Ended = Callable[[Status], None]
"""Is told the exit status."""


class Process(Protocol):
    """A process that was started, by us or by another one."""

    pid: int

    def poll(self) -> Optional[Status]:
        """The exit status; None as long as it runs."""


class Children:
    """Calls `ended(status)`, from its own thread and so briefly, once a watched process ended."""

    def __init__(self) -> None:
        self._watched: List[Tuple[Process, Ended]] = []
        self._changed = threading.Condition()
        threading.Thread(target=self._watch, name="children", daemon=True).start()

    def watch(self, process: Process, ended: Ended) -> None:
        """Call `ended` once this process has ended."""
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
            threading.Event().wait(POLL_S)
