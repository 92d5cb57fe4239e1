"""Which nodes take others along when they are killed: required ones, and shared processes."""
import os
import threading
from typing import Any, Dict, Set

import psutil

from shsa_core.ros.master.node_api import FAILURES, master_api, node_api

URIS = "/roslaunch/uris"
"""Where each roslaunch says how it can be asked."""
MOST_LAUNCHES = 32
"""Anybody can write there: no more are asked."""
ROOM = 50
"""Processes to remember before it is looked which of them have ended."""


class Protection:
    """Finds why a node is never killed unless the SOM says so by name.

    Calls take as long as the network does: each in a thread of its own.
    """

    def __init__(self) -> None:
        self._processes: Dict[psutil.Process, Set[str]] = {}
        self._room = ROOM
        self._lock = threading.Lock()

    def reason(self, node: str, process: psutil.Process) -> str:
        """Why a node with this process is protected; empty: it is not."""
        if _is_nodelet_manager(process):
            return "its process is a nodelet manager"
        with self._lock:
            if process not in self._processes and len(self._processes) >= self._room:
                self._forget_ended()
            nodes = self._processes.setdefault(process, set())
            nodes.add(node)
            others = sorted(nodes - {node})
        if others:
            return f"its process is that of {', '.join(others)} too"
        if self._is_required(node, process.pid):
            return 'its launch file says required="true"'
        return ""

    def sharing(self, node: str, process: psutil.Process) -> Set[str]:
        """The nodes that were found in the process of a node, beside it."""
        with self._lock:
            return set(self._processes.get(process, ())) - {node}

    def _forget_ended(self) -> None:
        """Those that have ended are not asked about again; looking costs a while, so not always."""
        found = {each: nodes for each, nodes in self._processes.items() if each.is_running()}
        self._processes, self._room = found, 2 * len(found) + ROOM

    def _is_required(self, node: str, pid: int) -> bool:
        """Whether a roslaunch ends with a node's process. Only those of this master are asked."""
        try:
            uris = master_api().getParam(URIS)
        except FAILURES:
            return False  # no roslaunch has started anything
        return any(self._asked(uri, node, pid) for uri in sorted(_leaves(uris))[:MOST_LAUNCHES])

    def _asked(self, uri: str, node: str, pid: int) -> bool:
        roslaunch: Any = node_api(uri)
        try:
            _, _, (alive, _) = roslaunch.list_processes()
            # roslaunch calls the process of /name `name-3`: the third that it has started.
            mine = [name for name, _ in alive if "/" + name.rsplit("-", 1)[0].strip("/") == node]
            infos = [roslaunch.process_info(name)[2] for name in mine]
            return any(info.get("pid") == pid and info.get("required") for info in infos)
        except (*FAILURES, ValueError, TypeError, AttributeError, LookupError):
            return False  # it has ended, or is none


def _leaves(tree: Any) -> Set[str]:
    if isinstance(tree, dict):
        return {leaf for each in tree.values() for leaf in _leaves(each)}
    return {tree} if isinstance(tree, str) else set()


def _is_nodelet_manager(process: psutil.Process) -> bool:
    try:
        words = process.cmdline()
    except psutil.Error:
        return False
    return [os.path.basename(word) for word in words[:2]] == ["nodelet", "manager"]
