"""The priority of a process that stands by, and of its threads: the robot's own nodes come first.

It may have hundreds of threads where the robot has hundreds of topics. Each would have as much of
the processor as a node of the robot's that is to publish now.
"""
import os
import threading
from contextlib import suppress
from typing import List

LOWERED = 10
"""By so much: where all are busy, a tenth of the processor time that others have."""

USUAL = os.getpriority(os.PRIO_PROCESS, os.getpid())
"""Of this process, until it is lowered."""
SWITCH_INTERVAL_S = 0.0005
"""Between switches of Python's threads: its own 5 ms, at each step between two of them, would be
most of a takeover."""


def lower() -> bool:
    """Have this thread, and those that it starts, wait for others; whether that is so.

    Only where each can count as much as others again: as root, or where the user's limit `nice`
    allows it (see limits.conf).
    """
    if not _may_restore():
        return False
    os.nice(LOWERED)
    return True


def restore_all() -> None:
    """Have all threads count as much as others again."""
    for thread in map(int, os.listdir("/proc/self/task")):
        with suppress(ProcessLookupError):  # it has ended meanwhile
            os.setpriority(os.PRIO_PROCESS, thread, USUAL)


def _may_restore() -> bool:
    """Tried by a thread that then ends."""
    found: List[bool] = []

    def work() -> None:
        try:
            _change(1)
            _change(-1)
            found.append(True)
        except PermissionError:
            found.append(False)

    thread = threading.Thread(target=work)
    thread.start()
    thread.join()
    return found[0]


def _change(nice: int) -> None:
    """Change the priority of this thread alone."""
    here = threading.get_native_id()
    os.setpriority(os.PRIO_PROCESS, here, os.getpriority(os.PRIO_PROCESS, here) + nice)
