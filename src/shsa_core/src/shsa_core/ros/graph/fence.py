"""Which process each node is, and how it is made to leave; whoever calls decides when."""
import threading
import time
import urllib.parse
import xmlrpc.client
from dataclasses import dataclass
from typing import Callable, Dict, Optional

import psutil
import rosgraph
import rosgraph.network
import rosnode

from shsa_core.healing.events import Where
from shsa_core.ros.graph.node_api import node_api

POLL_S = 0.002
WATCH_S = 5.0
"""So long it is looked whether a process has ended; whoever asked has given up by then."""


@dataclass(frozen=True)
class Known:
    """A node's address, and its process; None: that is on another computer, or cannot be told.

    `dead`: nobody listens at its address, which is on this computer.
    """

    uri: str
    process: Optional[psutil.Process]
    dead: bool = False

    @property
    def lives(self) -> bool:
        """Whether it may still run."""
        return not self.dead and (self.process is None or not gone(self.process))


class Fence:
    """Knows which process each node is.

    Calls take as long as the network does: each in a thread of its own.
    """

    def __init__(self, caller_id: str) -> None:
        self._caller_id = caller_id
        self._known: Dict[str, Known] = {}
        self._lock = threading.Lock()

    def learn(self, node: str) -> Optional[Known]:
        """Remember the process of a node; None: it has none that can be told.

        A healthy node tells its process, and is believed if that listens where the node does. A
        hung one is found by that address.
        """
        known = self._look(node)
        if known is None or (known.process is None and _is_local(known.uri)):
            return None  # it has died meanwhile
        with self._lock:
            self._known[node] = known
        return known

    def find(self, node: str, successor: bool) -> Where:
        """Where the process of a node runs: the learned one, or if that is dead, its successor."""
        known = self._find(node, successor)
        if known is None:
            return Where.NOWHERE
        with self._lock:
            self._known[node] = known
        if known.process is None:
            return Where.DEAD if known.dead else Where.ELSEWHERE
        if gone(known.process):
            return Where.DEAD
        try:
            stopped = known.process.status() == psutil.STATUS_STOPPED
        except psutil.NoSuchProcess:
            return Where.DEAD
        return Where.STOPPED if stopped else Where.HERE

    def ask_to_leave(self, node: str, left: Callable[[], None]) -> None:
        """`rosnode kill`; calls `left` once the process has ended.

        Elsewhere, once the node has answered.
        """
        asked = threading.Thread(target=rosnode.kill_nodes, args=([node],), daemon=True)
        asked.start()
        process = self._process(node)
        if process is not None:
            _await_end(process, left)
            return
        asked.join(WATCH_S)
        if not asked.is_alive():
            left()

    def end_process(self, node: str, left: Callable[[], None]) -> None:
        """`kill -9`; calls `left` once the process has ended.

        Raises psutil.AccessDenied if it is somebody else's.
        """
        process = self._process(node)
        if process is None:
            return
        try:
            process.kill()
        except psutil.NoSuchProcess:
            left()
            return
        _await_end(process, left)

    def clear(self, node: str) -> None:
        """Clear what a dead node left registered at the master, and nothing of a successor."""
        with self._lock:
            known = self._known.get(node)
            if known is not None and known.process is not None and known.lives:
                return
            self._known.pop(node, None)
        try:
            uri = known.uri if known else rosgraph.Master(self._caller_id).lookupNode(node)
            _unregister(node, uri)
        except (rosgraph.MasterException, OSError):
            return  # the master does not know it, or is away: there is nothing to be cleared

    def _process(self, node: str) -> Optional[psutil.Process]:
        with self._lock:
            known = self._known.get(node)
        return known.process if known else None

    def _find(self, node: str, successor: bool) -> Optional[Known]:
        """What is known of a node: the living process, its successor, or the dead one."""
        with self._lock:
            known = self._known.get(node)
        if known is not None and (known.lives or (known.process is not None and not successor)):
            return known
        current = self._look(node)
        if known is None or (current is not None and current.uri != known.uri):
            return current
        return known  # not called again: its address may be an innocent one's by now

    def _look(self, node: str) -> Optional[Known]:
        try:
            uri = rosgraph.Master(self._caller_id).lookupNode(node)
        except (rosgraph.MasterException, OSError):
            return None
        try:
            process = self._ask_process(uri)
        except ConnectionRefusedError:
            return Known(uri, None, dead=_is_local(uri))
        except (OSError, xmlrpc.client.Error):
            process = None
        if process is None or not _listens(process, uri):
            process = _listening_process(uri)
        return Known(uri, process)

    def _ask_process(self, uri: str) -> Optional[psutil.Process]:
        if not _is_local(uri):
            return None
        code, _, pid = node_api(uri).getPid(self._caller_id)  # type: ignore[misc]
        try:
            return psutil.Process(int(pid)) if code == 1 else None  # type: ignore[arg-type]
        except psutil.NoSuchProcess:
            return None


def _unregister(node: str, uri: str) -> None:
    """Unregister (node, uri) everywhere; a successor with the same name has another uri."""
    master = rosgraph.Master(node)
    publishers, subscribers, services = master.getSystemState()
    for topic, nodes in publishers:
        if node in nodes:
            master.unregisterPublisher(topic, uri)
    for topic, nodes in subscribers:
        if node in nodes:
            master.unregisterSubscriber(topic, uri)
    for name, nodes in services:
        if node in nodes and master.lookupNode(node) == uri:
            master.unregisterService(name, master.lookupService(name))


def _is_local(uri: str) -> bool:
    host = urllib.parse.urlparse(uri).hostname or ""
    return bool(rosgraph.network.is_local_address(host))


def _listens(process: psutil.Process, uri: str) -> bool:
    """Whether a process is the one behind a node's URI."""
    port = urllib.parse.urlparse(uri).port
    try:
        return any(
            each.status == psutil.CONN_LISTEN and each.laddr.port == port
            for each in process.connections(kind="tcp")
        )
    except psutil.Error:
        return False


def _listening_process(uri: str) -> Optional[psutil.Process]:
    """The process behind a node that does not answer, by the port that it listens on."""
    if not _is_local(uri):
        return None
    port = urllib.parse.urlparse(uri).port
    for connection in psutil.net_connections(kind="tcp"):
        if connection.status == psutil.CONN_LISTEN and connection.laddr.port == port:
            return psutil.Process(connection.pid) if connection.pid else None
    return None


def gone(process: psutil.Process) -> bool:
    """Whether a process has ended, though nobody may have asked for its exit status yet."""
    try:
        return not process.is_running() or process.status() == psutil.STATUS_ZOMBIE
    except psutil.NoSuchProcess:
        return True


def _await_end(process: psutil.Process, left: Callable[[], None]) -> None:
    deadline = time.monotonic() + WATCH_S
    while not gone(process):
        if time.monotonic() > deadline:
            return
        time.sleep(POLL_S)
    left()
