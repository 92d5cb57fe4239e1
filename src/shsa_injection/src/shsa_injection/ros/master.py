"""The master's process: found by its address, and looked at before it is touched."""
import os
from typing import Tuple

import psutil

from shsa_core.ros.master.node_api import master_uri
from shsa_injection.errors import Refused
from shsa_injection.ros import targets
from shsa_injection.ros.targets import Start

NAMES = ("rosmaster",)
LAUNCHERS = ("roslaunch", "roscore", "rostest")
BESIDE = ("rosmaster", "rosout")


def find() -> psutil.Process:
    """Return the master's process.

    Raises Refused if it is not this user's rosmaster, or if a launch would end with it; ShsaError
    if ROS_MASTER_URI is none.
    """
    uri = master_uri()
    process = targets.owned(targets.listening_process(uri), "the master")
    if not _is(process, NAMES):
        raise Refused(f"process {process.pid}, which listens at {uri}, is no rosmaster")
    parent = process.parent()
    if parent is not None and _is(parent, LAUNCHERS):
        others = [each for each in parent.children() if not _is(each, BESIDE)]
        if others:
            raise Refused(
                f"the master is part of a launch (process {parent.pid}), which would end with it: "
                "start the master by itself, with `roscore` or `rosmaster --core`"
            )
    return process


def start_of(process: psutil.Process) -> Start:
    """Return how the master was started; the new one ends with nobody."""
    start = targets.start_of(process)
    return Start(start.words, start.folder, start.environment, None)


def _is(process: psutil.Process, names: Tuple[str, ...]) -> bool:
    try:
        words = process.cmdline()[:2]
    except psutil.Error:
        return False
    return any(os.path.basename(word) in names for word in words)
