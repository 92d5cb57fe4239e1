"""The priority of a process that stands by, and of its threads: the robot's own nodes come first.

It may have hundreds of threads where the robot has hundreds of topics. Each would have as much of
the processor as a node of the robot's that is to publish now.

Where each session has its own share (`man 7 sched`, "The autogroup feature"), as on a desktop, the
priority of a process counts within its session alone, and who is alone in one would be lowered for
nothing: so that of the session is lowered as well.
"""
import os
import threading
import time
from contextlib import suppress
from pathlib import Path
from typing import List

from shsa_core.ros import settings

LOWERED = 10
"""By so much: where all are busy, a tenth of the processor time that others have."""

USUAL = os.getpriority(os.PRIO_PROCESS, os.getpid())
"""Of this process, until it is lowered."""
SESSION = "/proc/self/autogroup"
USUAL_SESSION = _wanted = 0
_lowered = False
SWITCH_INTERVAL_S = 0.0005
"""Between switches of Python's threads: its own 5 ms, at each step between two of them, would be
most of a takeover."""


def lower() -> bool:
    """Have this thread, and those that it starts, wait for others; whether that can be undone.

    Where it cannot it is not done. Each thread can count as much as others again as root, or where
    the user's limit `nice` allows it (see limits.conf); a session can for everybody.
    """
    global _lowered
    _lowered = _may_restore()
    if _lowered:
        os.nice(LOWERED)
    return _set_session(LOWERED) or _lowered


def restore_all() -> None:
    """Have all threads count as much as others again."""
    _set_all(USUAL, USUAL_SESSION)


def lower_all() -> None:
    """Have all threads wait for others again, after they were restored."""
    _set_all(USUAL + LOWERED, LOWERED)


def _set_all(nice: int, session: int) -> None:
    for thread in map(int, os.listdir("/proc/self/task") if _lowered else ()):
        with suppress(ProcessLookupError):  # it has ended meanwhile
            os.setpriority(os.PRIO_PROCESS, thread, nice)
    _set_session(session)


def _set_session(nice: int) -> bool:
    """Set the priority of our session, now or soon; False: it has none, or is not ours alone."""
    global _wanted
    if not os.access(SESSION, os.W_OK) or os.getsid(0) != os.getpid():
        return False
    _wanted = nice
    if not _try():
        threading.Thread(target=_insist, name="priority", daemon=True).start()
    return True


def _try() -> bool:
    """Set what is wanted last; False: somebody's was changed less than 0.1 s ago."""
    try:
        Path(SESSION).write_text(f"{_wanted}\n")
    except BlockingIOError:
        return False
    return True


def _insist() -> None:
    while not _try():
        time.sleep(settings.SOON_S)


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
