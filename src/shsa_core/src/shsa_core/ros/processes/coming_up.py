"""Tells when nodes come up again: as early as can be, before any consumer hears them.

Who starts a node again and again is known once it was learned: a child of that process with the
same command is the node, long before it registers. Another one is seen when it registers.
"""
import threading
import time
from typing import Callable, Dict, Iterable, Optional

import psutil

from shsa_core.ros.master.node_api import FAILURES, master_api

LOOK_S = 0.01
"""A node in Python takes ten times as long until it registers."""
ASK_S = 0.05
"""Between two questions to the master."""


class ComingUp:
    """Looks for some nodes in a thread of its own, as long as there are any.

    `started(node)` finds the process that was started again as a node was before. `came(node,
    process)` is called in that thread, once for each process, None: for each that registers.
    """

    def __init__(
        self,
        started: Callable[[str], Optional[psutil.Process]],
        came: Callable[[str, Optional[psutil.Process]], None],
    ) -> None:
        self._started, self._came = started, came
        self._addresses: Dict[str, str] = {}  # where each was last; empty: nowhere
        self._processes: Dict[str, psutil.Process] = {}
        self._wanted = threading.Event()
        self._lock = threading.Lock()
        threading.Thread(target=self._look, name="coming up", daemon=True).start()

    def watch(self, nodes: Iterable[str]) -> None:
        """Look for these nodes from now on; where they are registered now, they were before."""
        wanted = set(nodes)
        found = {node: _address(node) for node in wanted - set(self._addresses)}
        with self._lock:
            kept = {node: uri for node, uri in self._addresses.items() if node in wanted}
            self._addresses = {**found, **kept}
            self._wanted.set() if self._addresses else self._wanted.clear()

    def _look(self) -> None:
        ask_at = 0.0
        while self._wanted.wait():
            nodes = list(self._addresses)
            for node in nodes:
                process = self._started(node)
                if process is not None and process != self._processes.get(node):
                    self._processes[node] = process
                    self._came(node, process)
            if time.monotonic() >= ask_at:
                for node in nodes:
                    self._ask(node)
                ask_at = time.monotonic() + ASK_S
            time.sleep(LOOK_S)

    def _ask(self, node: str) -> None:
        uri, known = _address(node), self._addresses.get(node)
        if known is None or not uri or uri == known:
            return
        with self._lock:
            self._addresses[node] = uri
        self._came(node, None)


def _address(node: str) -> str:
    """Where the master says that a node is; empty: it does not know, or does not answer."""
    try:
        return str(master_api().lookupNode(node))
    except FAILURES:
        return ""
