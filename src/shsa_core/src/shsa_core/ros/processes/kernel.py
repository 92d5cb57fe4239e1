"""Asks the kernel about processes: nobody on the graph can forge that (see `trust/owners` too)."""
import os
import signal
import time
from contextlib import suppress
from typing import Callable, Dict, Iterator, List, NamedTuple, Optional, Tuple

import psutil
import rosgraph

from shsa_core.ros import settings
from shsa_core.ros.master.node_api import FAILURES, resolved
from shsa_core.ros.trust.owners import answers_at
from shsa_core.ros.trust.places import master_place

OF_ROS = {"roslaunch", "rosmaster", "roscore", "rosout"}
NAME = "__name:="
OF_HEALING = {"agent", "gate", "monitor", "reconfigurator", "standby", "substitute", "view"}
THEIR_PACKAGES = {"shsa_core", "shsa_gate", "shsa_view"}

Identity = Tuple[int, float]
"""A process by its number and its start, in clock ticks since the computer's."""
NOBODY: Identity = (0, 0.0)
Waits = Tuple[Tuple[str, float], ...]
"""For how long in all nodes waited for a processor, in s, by name; by the empty one, anybody."""


class Running(NamedTuple):
    """A process, its command line and its environment."""

    process: psutil.Process
    words: List[str]
    variables: Dict[str, str]

    @property
    def node(self) -> str:
        """Return the node that it was started as; empty: it is none by name."""
        name = next((word[len(NAME) :] for word in self.words if word.startswith(NAME)), "")
        namespace = self.variables.get("ROS_NAMESPACE", "").strip("/")
        return f"/{namespace}/{name}".replace("//", "/") if name else ""


def robot_processes() -> Iterator[Running]:
    """Return the processes of our user that use our ROS master, however it is spelled there."""
    ours = master_place()
    places = {os.environ.get("ROS_MASTER_URI"): ours}
    for process in psutil.process_iter():
        try:
            seen = Running(process, process.cmdline(), process.environ())
            uri = seen.variables.get("ROS_MASTER_URI")
            if uri not in places:
                places[uri] = master_place(seen.variables)
        except (psutil.Error, FileNotFoundError, ProcessLookupError, ValueError):
            continue  # it has ended, is somebody else's, or of no master at all
        if places[uri] == ours and is_ours(process):
            yield seen


def is_ours(process: psutil.Process) -> bool:
    """Return whether a process runs as the user that we run as, and as no other beside."""
    with suppress(psutil.Error):
        return set(process.uids()) == {os.geteuid()}
    return False


def user(process: Optional[psutil.Process]) -> str:
    """Return the name of the user that a process runs as."""
    with suppress(psutil.Error):
        return str(process.username()) if process else "somebody else"
    return "somebody else"


def identity(pid: int) -> Identity:
    """Return what a process is known by; NOBODY: it is not there. Raises OSError: not told now."""
    try:
        with open(f"/proc/{pid}/stat", "rb") as file:
            found = file.read().rsplit(b")", 1)[1].split()
    except (FileNotFoundError, ProcessLookupError):
        return NOBODY
    return NOBODY if found[0] == b"Z" else (pid, float(found[19]))


def ended(known: Identity) -> bool:
    """Return whether a process has ended, though nobody may have asked for its exit status yet."""
    with suppress(OSError):  # nobody counts as dead because we lack the means to look
        return known == NOBODY or identity(known[0]) != known
    return False


def never_to_end(process: psutil.Process) -> str:
    """Return why a process is never to be ended, whatever anybody says; empty: it may be."""
    if process.pid == os.getpid():
        return "it is the reconfigurator itself"
    with suppress(*FAILURES):
        if answers_at(process.pid, resolved(rosgraph.get_master_uri())):
            return "it is the master"
    if process.pid in {1, *(each.pid for each in ancestors(os.getpid()))}:
        return "its process has started the reconfigurator"
    for *folders, name in programs(process):
        if name in OF_ROS:
            return "it belongs to ROS"
        if name in OF_HEALING and not THEIR_PACKAGES.isdisjoint(folders):
            return "it belongs to healing"
    return ""


def programs(process: psutil.Process) -> List[List[str]]:
    """Return the folders and the name of a process's program, or of its interpreter and that."""
    with suppress(psutil.Error):
        return [word.split("/") for word in process.cmdline()[:2]]
    return []


def ancestors(pid: int) -> List[psutil.Process]:
    """Return the processes that a process descends from, the nearest first, without the first."""
    with suppress(psutil.Error):
        parent = psutil.Process(pid).parent()
        if parent is not None:  # in a container the first process may be a roslaunch
            return [parent, *ancestors(parent.pid)]
    return []


def started_by_launch(pid: int) -> bool:
    """Return whether a roslaunch has started a process, which may start it again."""
    words = (word for each in ancestors(pid)[:1] for word in programs(each))
    return any(name in ("roslaunch", "rostest") for *_, name in words)


def gone(process: psutil.Process) -> bool:
    """Return whether a process has ended, though nobody may have asked for its exit status yet."""
    try:
        return not process.is_running() or process.status() == psutil.STATUS_ZOMBIE
    except psutil.NoSuchProcess:
        return True
    except OSError:
        return False  # nobody counts as dead because we lack the means to look


def stopped(pid: int) -> bool:
    """Return whether a process is stopped, so that it hears nothing."""
    with suppress(psutil.Error, OSError):  # it has ended, or we lack the means to look
        return bool(psutil.Process(pid).status() == psutil.STATUS_STOPPED)
    return False


def waited(pid: int) -> float:
    """Return for how long in s the threads of a process had no processor (see schedstat)."""
    total = 0
    with suppress(OSError, ValueError, IndexError):  # it, or a thread of it, has ended meanwhile
        for task in os.listdir(f"/proc/{pid}/task"):
            with open(f"/proc/{pid}/task/{task}/schedstat", "rb") as file:
                total += int(file.read().split()[1])
    return total / 1e9


def waited_in_all(path: str) -> Waits:
    """Return for how long in s anything waited for a processor, by a file as /proc/pressure/cpu."""
    with suppress(OSError, ValueError), open(path, encoding="ascii") as file:
        return (("", 1e-6 * int(file.readline().rpartition("total=")[2])),)
    return ()


def crowded() -> bool:
    """Return whether more threads could run now than we have processors, if that is told."""
    with suppress(OSError), open("/proc/loadavg", encoding="ascii") as file:
        return int(file.read().split()[3].partition("/")[0]) > len(os.sched_getaffinity(0))
    return False


def kill(process: psutil.Process, number: int = signal.SIGKILL) -> None:
    """Send a signal to this very process. Raises PermissionError, ProcessLookupError."""
    if gone(process):
        raise ProcessLookupError(process.pid)
    if not is_ours(process):
        raise PermissionError(f"it belongs to {user(process)}")
    os.kill(process.pid, number)


def wait_for(done: Callable[[], bool], seconds: float = 0.0) -> bool:
    """Wait until something is done; 0: as long as a process is given to end. False: it is not."""
    deadline = time.monotonic() + (seconds or settings.PATIENCE_S)
    while not done():
        if time.monotonic() > deadline:
            return False
        time.sleep(settings.REST_S)
    return True
