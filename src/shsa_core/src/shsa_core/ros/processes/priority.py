"""The priority of healing's processes, and of all their threads.

What stands by comes after the robot's own nodes. What is on the way from a failure to the next
message comes before all, where that is permitted: to root, or by the user's limit `nice` (see
limits.conf). Where each session has its own share (`man 7 sched`, "The autogroup feature"), the
priority of a process counts within its session alone: so that of the session is set as well.
"""
import os
import threading
import time
from contextlib import suppress
from pathlib import Path
from typing import Dict

from shsa_core.ros import settings

STANDS_BY, USUAL, HURRIES = 10, 0, -10
"""For a tenth of the processor time that others have where all are busy, as much, and ten times."""
SESSION = "/proc/{}/autogroup"
_wanted: Dict[int, int] = {}  # of sessions that could not be set yet
_lock = threading.Lock()
SWITCH_INTERVAL_S = 0.0005
"""Between switches of Python's threads: its own 5 ms, at each step between two of them, would be
most of a takeover."""


def set_all(nice: int, pid: int = 0) -> None:
    """Set the priority of the threads of a process, 0: of ours, if they can be raised again."""
    pid = pid or os.getpid()
    may = _may_hurry()
    for thread in Path(f"/proc/{pid}/task").glob("*") if may else ():
        with suppress(OSError):  # it has ended meanwhile, or is somebody else's
            os.setpriority(os.PRIO_PROCESS, int(thread.name), nice)
    with suppress(OSError):  # it has ended meanwhile
        if os.access(SESSION.format(pid), os.W_OK) and os.getsid(pid) == pid:
            _set_session(nice if may else max(nice, USUAL), pid)


def _set_session(nice: int, pid: int) -> None:
    with _lock:
        waits = pid in _wanted
        _wanted[pid] = nice
    if not _try(pid) and not waits:
        with suppress(RuntimeError, MemoryError):  # no thread: the next change tries it again
            threading.Thread(target=_insist, args=(pid,), name="priority", daemon=True).start()


def _try(pid: int) -> bool:
    with _lock:
        try:
            Path(SESSION.format(pid)).write_text(f"{_wanted[pid]}\n")
        except BlockingIOError:  # somebody's was changed less than 0.1 s ago
            return False
        except (OSError, KeyError):
            pass  # it has ended meanwhile, or another thread did so
        _wanted.pop(pid, None)
        return True


def _insist(pid: int) -> None:
    while not _try(pid):
        time.sleep(settings.TICK_S)


def _may_hurry() -> bool:
    here = threading.get_native_id()
    before = os.getpriority(os.PRIO_PROCESS, here)
    try:
        os.setpriority(os.PRIO_PROCESS, here, HURRIES)
    except PermissionError:
        return False
    os.setpriority(os.PRIO_PROCESS, here, before)
    return True
