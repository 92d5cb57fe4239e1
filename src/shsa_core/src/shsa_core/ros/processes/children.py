"""Keeps the processes that healing has started or taken up; ends them, and tells their ends."""
import os
import signal
import subprocess
import threading
from contextlib import suppress
from typing import Any, Callable, Dict, List, Optional, Sequence, Set

import psutil

from shsa_core.ros import settings
from shsa_core.ros.processes import kernel
from shsa_core.ros.workers import guarded, repeating


class Started(psutil.Process):  # type: ignore[misc]
    """A process in a session of its own; `poll` tells its exit status. May raise OSError."""

    def __init__(self, words: Sequence[str], **where: Any) -> None:
        started = subprocess.Popen(words, stdin=subprocess.DEVNULL, start_new_session=True, **where)
        self.poll: Callable[[], Optional[int]] = started.poll
        try:
            super().__init__(started.pid)
        except OSError:
            started.kill()
            started.wait()
            raise


def ending(process: psutil.Process) -> str:
    """Return how a process has ended, in words; empty: it runs."""
    if isinstance(process, Started):
        status = process.poll()
        return "" if status is None else f"exit status {status}"
    return "exit status unknown" if kernel.gone(process) else ""


class Children:
    """The processes of ours by the names of their nodes, and one thread that waits for their ends.

    `ended(node, how)` is called from that thread once one has ended; empty: it was stopped.
    """

    def __init__(self, ended: Callable[[str, str], object]) -> None:
        self._ended = ended
        self._running: Dict[str, psutil.Process] = {}
        self._stopped: Set[str] = set()
        self._changed = threading.Condition()
        repeating("children", settings.TICK_S, self._watch).start()

    def keep(self, node: str, process: psutil.Process) -> None:
        """Take a process for that of a node, and wait for its end."""
        with self._changed:
            self._running[node] = process
            self._stopped.discard(node)
            self._changed.notify()

    def process(self, node: str) -> Optional[psutil.Process]:
        """Return the process of a node; None: it does not run."""
        with self._changed:
            return self._running.get(node)

    def running(self) -> List[str]:
        """Return the nodes that run."""
        with self._changed:
            return sorted(self._running)

    def stop(self, node: str) -> None:
        """Ask a node to leave, if it can be asked; kill it if it stays; wait for its end."""
        process = self.process(node)
        if process is not None:
            self._stopped.add(node)
            end(process)

    def _watch(self) -> None:
        with self._changed:
            self._changed.wait_for(lambda: self._running)
            polled = {node: ending(process) for node, process in self._running.items()}
            over = {node: how for node, how in polled.items() if how}
            for node in over:
                del self._running[node]
            stopped = self._stopped & over.keys()
            self._stopped -= stopped
        for node, how in over.items():
            guarded(f"The end of {node}", self._ended, node, "" if node in stopped else how)


def end(process: psutil.Process) -> None:
    """End a process and all that it started; ask it first if it can be asked. Waits for its end."""
    ended = lambda: bool(ending(process))
    with suppress(ProcessLookupError, psutil.NoSuchProcess):
        for number in (signal.SIGINT, signal.SIGKILL):
            if ended():
                return  # its number may be another one's by now
            if number == signal.SIGKILL or not kernel.stopped(process.pid):
                try:
                    os.killpg(process.pid, number)
                except ProcessLookupError:  # its group is led by a sandbox that has forked it
                    os.kill(process.pid, number)
                kernel.wait_for(ended)
