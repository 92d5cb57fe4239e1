"""Kills nodes for certain, never waiting on a hung one."""
import threading
import time
import urllib.parse
import xmlrpc.client
from dataclasses import dataclass
from typing import Dict, Optional, Tuple

import psutil
import rosgraph
import rosgraph.network
import rosnode

from shsa_core.ros.graph.node_api import node_api

EXIT_TIMEOUT = 1.0
POLL = 0.002


@dataclass(frozen=True)
class _Known:
    uri: str
    process: Optional[psutil.Process]  # None: on another computer


class Fence:
    """Knows which process each node is, and makes sure that a killed node is gone.

    `patience`: how long in s a node may take to leave after `rosnode kill` before its process is killed.
    """

    def __init__(self, caller_id: str, patience: float) -> None:
        self._caller_id = caller_id
        self._patience = patience
        self._known: Dict[str, _Known] = {}
        self._lock = threading.Lock()

    def learn(self, node: str) -> Optional[psutil.Process]:
        """Remember the process of a node, and return it if it is on this computer.

        A healthy node tells its process, and is believed if that listens where the node does. A hung one is found
        by that address.
        """
        known = self._look(node)
        if known is None or (known.process is None and _is_local(known.uri)):
            return None  # it has died meanwhile
        with self._lock:
            self._known[node] = known
        return known.process

    def knows(self, node: str) -> bool:
        """Whether the node's process is remembered, dead or alive."""
        with self._lock:
            return node in self._known

    def kill(self, node: str, urgent: bool = True) -> Tuple[bool, str]:
        """Kill `node` and clear its registrations; whether it is gone for certain, and how it went.

        `urgent`: it may still speak, so it gets no more than `patience` to leave; else EXIT_TIMEOUT.

        Takes as long as it takes, but at most about 3 s: call it in a thread of its own.
        """
        known = self._find(node)
        if known is None:
            return True, f"{node} is not registered"
        if known.process is None:
            certain, how = self._kill_remote(node)
        else:
            patience = self._patience if urgent else EXIT_TIMEOUT
            certain, how = self._kill_local(node, known.process, patience)
        if certain:
            self._forget(node, known.uri)
        return certain, how

    def clear(self, node: str) -> None:
        """Clear what a dead node left registered at the master."""
        try:
            uri = rosgraph.Master(self._caller_id).lookupNode(node)
        except (rosgraph.MasterException, OSError):
            return
        self._forget(node, uri)

    def _find(self, node: str) -> Optional[_Known]:
        """What is known of a node: the living process, its successor of the same name, or the dead one."""
        with self._lock:
            known = self._known.get(node)
        if known is not None and (known.process is None or not gone(known.process)):
            return known
        current = self._look(node)
        if known is None or (current is not None and current.uri != known.uri):
            return current
        return known  # not called again: its address may be an innocent one's by now

    def _look(self, node: str) -> Optional[_Known]:
        try:
            uri = rosgraph.Master(self._caller_id).lookupNode(node)
        except (rosgraph.MasterException, OSError):
            return None
        try:
            process = self._ask_process(uri)
        except ConnectionRefusedError:
            return _Known(uri, None)  # nobody is there
        except (OSError, xmlrpc.client.Error):
            process = None
        if process is None or not _listens(process, uri):
            process = _listening_process(uri)
        return _Known(uri, process)

    def _ask_process(self, uri: str) -> Optional[psutil.Process]:
        if not _is_local(uri):
            return None
        code, _, pid = node_api(uri).getPid(self._caller_id)  # type: ignore[misc]
        try:
            return psutil.Process(int(pid)) if code == 1 else None  # type: ignore[arg-type]
        except psutil.NoSuchProcess:
            return None

    def _kill_local(self, node: str, process: psutil.Process, patience: float) -> Tuple[bool, str]:
        if gone(process):
            return True, f"{node} had died"
        how = f"{node} was shut down"
        if not self._left_when_asked(node, process, patience):
            how = f"{node} did not leave in time, its process was killed"
            try:
                process.kill()
            except psutil.NoSuchProcess:
                return True, how
            except psutil.AccessDenied:
                return False, f"{node} does not leave, and its process belongs to somebody else"
        return _wait_gone(process, EXIT_TIMEOUT), how

    def _left_when_asked(self, node: str, process: psutil.Process, patience: float) -> bool:
        try:
            if process.status() == psutil.STATUS_STOPPED:
                return False
        except psutil.NoSuchProcess:
            return True
        self._rosnode_kill(node)
        return _wait_gone(process, patience)

    def _kill_remote(self, node: str) -> Tuple[bool, str]:
        asked = self._rosnode_kill(node)
        asked.join(EXIT_TIMEOUT)
        if asked.is_alive():
            return False, f"{node} runs on another computer and does not answer"
        return True, f"{node} was shut down"

    def _rosnode_kill(self, node: str) -> threading.Thread:
        thread = threading.Thread(target=rosnode.kill_nodes, args=([node],), daemon=True)
        thread.start()
        return thread

    def _forget(self, node: str, uri: str) -> None:
        """Unregister (node, uri) everywhere; a successor with the same name has another uri."""
        with self._lock:
            self._known.pop(node, None)
        try:
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
        except (rosgraph.MasterException, OSError):
            return


def _is_local(uri: str) -> bool:
    host = urllib.parse.urlparse(uri).hostname or ""
    return rosgraph.network.is_local_address(host)


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


def _wait_gone(process: psutil.Process, timeout: float) -> bool:
    deadline = time.monotonic() + timeout
    while not gone(process):
        if time.monotonic() > deadline:
            return False
        time.sleep(POLL)
    return True
