"""Keeps what the master knows in a file, for the next reconfigurator: both may die together.

Parameters are not among it: a robot that was launched anew must not get those of before.
"""
import json
import os
import time
from typing import Tuple

import rospy

from shsa_core.analysis.registrations import NOTHING, Graph, Part
from shsa_core.files.regular import read_own
from shsa_core.journal.lines import write_anew, write_line
from shsa_core.ros import settings

LARGEST_B = 1 << 25
"""A larger file is not read."""


Known = Tuple[int, Graph]
"""A master by its process, 0 for none, and what it knew."""


class KnowledgeFile:
    """A file at `path` that is ours alone; it counts for LONGEST_PAUSE_S after it was written.

    And in the same `boot` of the computer.
    """

    def __init__(self, path: str, boot: str) -> None:
        self._path, self._boot = path, boot
        self._written = b""

    def write(self, pid: int, known: Graph) -> None:
        """Write what is known now, if it is not what was written last."""
        parts, nodes, providers = known
        pairs = {part.value: sorted(parts[part]) for part in Part}
        places = {"nodes": nodes, "providers": providers}
        data = write_line({"boot": self._boot, "pid": pid, "parts": pairs, **places})
        try:
            if data == self._written:
                os.utime(self._path)
                return
            os.close(write_anew(self._path, data))
            self._written = data
        except OSError as error:
            self._written = b""
            rospy.logdebug("%s is not written: %s", self._path, error)

    def read(self) -> Known:
        """Return what was written a moment ago, before this process; nothing if nothing was."""
        try:
            age = time.time() - os.stat(self._path).st_mtime
            told = json.loads(read_own(self._path, LARGEST_B))
            if told["boot"] != self._boot or not 0.0 <= age <= settings.LONGEST_PAUSE_S:
                return 0, NOTHING
            pairs = {part: told["parts"][part.value] for part in Part}
            parts = {part: frozenset((name, node) for name, node in pairs[part]) for part in Part}
            return told["pid"], Graph(parts, told["nodes"], told["providers"])
        except (OSError, ValueError, LookupError, TypeError) as error:
            rospy.logdebug("%s is not read: %s", self._path, error)
            return 0, NOTHING
