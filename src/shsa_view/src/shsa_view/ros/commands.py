"""The commands by which the robot's nodes on this computer were started: the kernel tells."""
import shlex
import time
from pathlib import Path
from typing import Callable, Collection, Dict, Iterable, Iterator, List, Sequence, Tuple

from shsa_core.ros.processes.kernel import robot_processes
from shsa_core.ros.workers import Workers
from shsa_core.text import shown
from shsa_view.facts import CommandsTold

LOOK_S = 10.0
LONGEST = 1000
"""Characters; a longer command is not shown."""
OF_LOG = "__log:="


class Commands:
    """Looks for the commands of nodes now and then, in a thread of its own."""

    def __init__(self, put: Callable[[CommandsTold], None]) -> None:
        self._put, self._workers = put, Workers("commands")
        self._looked = float("-inf")

    def look(self, nodes: Iterable[str]) -> None:
        """Look for these nodes, if it is time to; returns at once."""
        if time.monotonic() < self._looked + LOOK_S:
            return
        self._looked = time.monotonic()
        wanted = {*nodes}
        self._workers.put(lambda: self._put(CommandsTold(dict(_found(wanted)))))


def _found(nodes: Collection[str]) -> Iterator[Tuple[str, str]]:
    for running in robot_processes():
        if running.node in nodes:
            text = command(running.words, running.variables)
            if len(text) <= LONGEST:
                yield running.node, shown(text, LONGEST)


def command(words: List[str], variables: Dict[str, str]) -> str:
    """Return what starts a node again in a terminal."""
    namespace = variables.get("ROS_NAMESPACE", "")
    place = f"ROS_NAMESPACE={shlex.quote(namespace)} " if namespace.strip("/") else ""
    kept = (word for word in by_rosrun(words) if not word.startswith(OF_LOG))
    return place + " ".join(map(shlex.quote, kept))


def by_rosrun(words: Sequence[str]) -> Sequence[str]:
    """Return the command by rosrun of a program that lies where catkin puts those of a package."""
    at = 1 if Path(words[0]).name.startswith("python") and len(words) > 1 else 0
    *_, folder, package, program = ("", "", *Path(words[at]).parts)
    return ["rosrun", package, program, *words[at + 1 :]] if folder == "lib" else words
