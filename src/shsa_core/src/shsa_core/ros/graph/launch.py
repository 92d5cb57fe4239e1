"""Whether the launch that this node belongs to is ending.

Then nodes stop on purpose, and nothing is to be healed.

roslaunch signals its nodes ten at a time, in no certain order, each in a session of its own: a
healthy node may be gone up to seconds before we are told to go. It writes to its log that it shuts
down before it signals anybody, and that log is open in our parent for us to find. Where it cannot
be read, our own signal is the first sign.
"""
import os
import re
from typing import BinaryIO, Iterator, Optional

import rospy

SHUTDOWN = re.compile(rb"\[roslaunch\.pmon\].*ProcessMonitor\.(_post_run|shutdown) ")
LONGEST_LINE = 1000


class Launch:
    """The roslaunch that started this node, if one did."""

    def __init__(self) -> None:
        self._log = _open_log()
        self._seen = 0 if self._log is None else os.fstat(self._log.fileno()).st_size
        self._ends = False

    def ending(self) -> bool:
        """Whether it is shutting down, or this node is. Costs a microsecond; asks nobody."""
        if not self._ends:
            self._ends = bool(rospy.core.is_shutdown_requested()) or self._log_tells()
        return self._ends

    def _log_tells(self) -> bool:
        if self._log is None or os.fstat(self._log.fileno()).st_size <= self._seen:
            return False
        self._log.seek(max(0, self._seen - LONGEST_LINE))
        overlap = self._seen - self._log.tell()
        new = self._log.read()
        self._seen += len(new) - overlap
        # What was there before we came is of a launch that went on: only what ends in the new part
        # counts.
        return any(found.end() > overlap for found in SHUTDOWN.finditer(new))


def _open_log() -> Optional[BinaryIO]:
    """The log of the nearest roslaunch among our ancestors."""
    for pid in _ancestors():
        name = re.compile(rf"/[^/]*-{pid}\.log$")
        folder = f"/proc/{pid}/fd"
        try:
            files = [os.readlink(f"{folder}/{each}") for each in os.listdir(folder)]
            found = next((file for file in files if name.search(file)), None)
            if found is not None:
                return open(found, "rb")
        except OSError:
            continue  # it is somebody else's process, or gone
    return None


def _ancestors() -> Iterator[int]:
    pid = os.getppid()
    while pid > 1:
        yield pid
        try:
            with open(f"/proc/{pid}/stat", "rb") as stat:
                pid = int(stat.read().rsplit(b")", 1)[1].split()[1])
        except (OSError, ValueError, IndexError):
            return
