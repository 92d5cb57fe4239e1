"""What the kernel says of processes, which nobody on the graph can forge.

Who listens where, whose it is, whether it has ended.
"""
import functools
import os
import signal
import socket
import time
from typing import Callable, Iterable, List, Optional, Set, Tuple

import psutil
import rosgraph.network

from shsa_core.ros.master.node_api import BadAnswer, address

POLL_S = 0.002
REFUSAL_TIMEOUT_S = 0.2
MASTER_AGE_S = 10.0
"""To look through all connections takes tens of milliseconds on a large robot."""
ANY_ADDRESS = ("0.0.0.0", "::")

Identity = Tuple[int, float]
"""A process by its number and its start, in clock ticks since the computer's."""
NOBODY: Identity = (0, 0.0)


def is_local(uri: str) -> bool:
    """Whether a node's address is one of this computer."""
    try:
        return bool(rosgraph.network.is_local_address(address(uri).host))
    except (BadAnswer, UnicodeError):
        return False


def listens(process: psutil.Process, uri: str) -> bool:
    """Whether a process is the one behind a node's URI."""
    try:
        return bool(_matching(process.connections(kind="tcp"), uri))
    except psutil.Error:
        return False


def listener(uri: str) -> Optional[psutil.Process]:
    """The process behind a node's URI; None: there is none here, or we may not see it."""
    if not is_local(uri):
        return None
    for found in _matching(psutil.net_connections(kind="tcp"), uri):
        try:
            return psutil.Process(found.pid) if found.pid else None
        except psutil.NoSuchProcess:
            continue
    return None


def _matching(connections: Iterable[psutil._common.sconn], uri: str) -> List[psutil._common.sconn]:
    try:
        host, port = address(uri)
        found = socket.getaddrinfo(host, port, proto=socket.IPPROTO_TCP)
    except (BadAnswer, OSError, UnicodeError):
        return []
    hosts = {str(each[4][0]) for each in found} | {*ANY_ADDRESS}
    return [
        each
        for each in connections
        if each.status == psutil.CONN_LISTEN and each.laddr.port == port and each.laddr.ip in hosts
    ]


def is_ours(process: psutil.Process) -> bool:
    """Whether a process runs as the user that we run as, and as no other beside."""
    try:
        return set(process.uids()) == {os.geteuid()}
    except psutil.Error:
        return False


def identity(pid: int) -> Identity:
    """What a process is known by; NOBODY: it is not there."""
    try:
        with open(f"/proc/{pid}/stat", "rb") as stat:
            return pid, float(stat.read().rsplit(b")", 1)[1].split()[19])
    except (OSError, ValueError, IndexError):
        return NOBODY


def same_process(known: Identity) -> Optional[psutil.Process]:
    """The process of our user that this is; None: it is gone, or another one has its number."""
    if known[0] <= 0:
        return None
    try:
        process = psutil.Process(known[0])
        same = identity(known[0]) == known and not gone(process)
    except psutil.Error:
        return None
    return process if same and is_ours(process) else None


def user(process: psutil.Process) -> str:
    """The name of the user that a process runs as."""
    try:
        return str(process.username())
    except psutil.Error:
        return "somebody else"


def never_to_end(process: psutil.Process) -> str:
    """Why a process is never to be ended, whatever anybody says; empty: it may be."""
    if process.pid == os.getpid():
        return "it is the reconfigurator itself"
    if process == _master(rosgraph.get_master_uri(), int(time.monotonic() / MASTER_AGE_S)):
        return "it is the master"
    if process.pid in _ancestors():
        return "its process has started the reconfigurator"
    return ""


@functools.lru_cache(maxsize=1)
def _master(uri: str, age: int) -> Optional[psutil.Process]:
    """The master's process, if it is on this computer, looked for anew in each `age`."""
    return listener(uri)


def _ancestors() -> Set[int]:
    try:
        return {each.pid for each in psutil.Process().parents()} | {1, os.getppid()}
    except psutil.Error:
        return {1, os.getppid()}


def started_by_launch(process: psutil.Process) -> bool:
    """Whether a roslaunch has started a process, which may start it again once it has ended."""
    try:
        parent = process.parent()
        words = parent.cmdline() if parent is not None else []
    except psutil.Error:
        return False
    return any(os.path.basename(word) in ("roslaunch", "rostest") for word in words[:2])


def gone(process: psutil.Process) -> bool:
    """Whether a process has ended, though nobody may have asked for its exit status yet."""
    try:
        return not process.is_running() or process.status() == psutil.STATUS_ZOMBIE
    except psutil.NoSuchProcess:
        return True


def stopped(process: psutil.Process) -> bool:
    """Whether a process is stopped, so that it hears nothing."""
    try:
        return bool(process.status() == psutil.STATUS_STOPPED)
    except psutil.NoSuchProcess:
        return False


def waited(pid: int) -> float:
    """For how long the threads of a process could run and had no processor so far, in s.

    0 where the kernel does not tell: see its documentation of schedstat.
    """
    total = 0
    try:
        for task in os.listdir(f"/proc/{pid}/task"):
            with open(f"/proc/{pid}/task/{task}/schedstat", "rb") as file:
                total += int(file.read().split()[1])
    except (OSError, ValueError, IndexError):
        return total / 1e9  # it, or a thread of it, has ended meanwhile
    return total / 1e9


def kill(process: psutil.Process) -> None:
    """`kill -9` this very process, and no other that has its number by now.

    Raises PermissionError if it is not ours, ProcessLookupError if it has ended.
    """
    opened = descriptor(process.pid)
    try:
        # From here on the descriptor, if there is one, names what this looks at.
        if gone(process):
            raise ProcessLookupError(process.pid)
        if not is_ours(process):
            raise PermissionError(f"it belongs to {user(process)}")
        if opened is None:
            os.kill(process.pid, signal.SIGKILL)
        else:
            signal.pidfd_send_signal(opened, signal.SIGKILL)  # type: ignore[attr-defined]
    finally:
        if opened is not None:
            os.close(opened)


def descriptor(pid: int) -> Optional[int]:
    """A descriptor of a process; None: Python before 3.9 or Linux before 5.3 has none."""
    try:
        return int(os.pidfd_open(pid))  # type: ignore[attr-defined]
    except ProcessLookupError:
        raise
    except (AttributeError, OSError):
        return None


def await_end(process: psutil.Process, seconds: float, ended: Callable[[], None]) -> bool:
    """Call `ended` once a process has ended; False: it has not by then."""
    deadline = time.monotonic() + seconds
    while not gone(process):
        if time.monotonic() > deadline:
            return False
        time.sleep(POLL_S)
    ended()
    return True


def await_refusal(uri: str, seconds: float) -> bool:
    """Wait until nobody listens any more at an address; False: somebody still did in the end."""
    deadline = time.monotonic() + seconds
    while time.monotonic() < deadline:
        try:
            socket.create_connection(address(uri), REFUSAL_TIMEOUT_S).close()
        except ConnectionRefusedError:
            return True
        except OSError:
            pass  # no answer is no proof
        time.sleep(POLL_S)
    return False
