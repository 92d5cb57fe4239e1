"""Takes over what a former reconfigurator has left: its records, and what still runs.

What the master knew is a file beside them, since both may die together; but no parameters: a robot
that was launched anew must not get those of before. Another file says that the robot is maintained:
only our own account can write it, it outlives the boot, and it needs no master.
"""
import json
import os
import re
import time
from contextlib import suppress
from functools import lru_cache
from typing import Collection, Set, Tuple

import rospkg
import rospy
from rosgraph import get_master_uri

from shsa_core.analysis.duties import duties_of, subscribers_of
from shsa_core.analysis.registrations import NOTHING, Graph, Part, read_pairs
from shsa_core.errors import ShsaError
from shsa_core.files.regular import read_own, written_by_others
from shsa_core.healing import events
from shsa_core.healing.records import Record, of_this_robot
from shsa_core.journal.codec import Codec
from shsa_core.journal.lines import write_anew, write_line
from shsa_core.journal.record_file import Former, RecordFile, read_records
from shsa_core.model.names import Names
from shsa_core.model.som import Som
from shsa_core.ros import clock, settings
from shsa_core.ros.master.node_api import FAILURES, master_api
from shsa_core.ros.processes.local import LocalHost
from shsa_core.ros.trust.places import boot, master_place

CODEC = Codec(Record)
RUN = "/run_id"
"""The parameter that a ROS master's start is known by."""
LARGEST_B = 1 << 25
"""A larger file of what a master knew is not read."""


def take_over(
    host: LocalHost, som: Som, names: Names, known: Graph, elsewhere: Collection[str] = ()
) -> Tuple[events.Started, RecordFile]:
    """Look what a former reconfigurator of this master and namespace has left, and watch it.

    Returns the event to begin with, and the file for the records from now on.

    `known`: what the former one knew of the graph, as the master may be a new one. `elsewhere`:
    what agents on other computers have told to run there.
    """
    path = record_path(rospy.get_namespace())
    owner = {"boot": boot(), "run": str(rospy.get_param(RUN, ""))}
    former = _read(path)
    running = [*host.take_up(), *elsewhere]
    same_boot = former.owner.get("boot") == owner["boot"]  # moments of another: of another clock
    runs = running if same_boot else ()
    records = of_this_robot(former.records, former.owner == owner, runs)
    now = list(map(read_pairs, master_api().getSystemState()))
    nodes = {node for _, node in now[0]}
    order = Part.PUBLISHER, Part.SUBSCRIBER, Part.SERVICE
    parts = [pairs | known.parts[part] for pairs, part in zip(now, order)]
    started = events.Started(
        clock.now(),
        *_sorted_out(host, nodes - set(running)),
        records,
        tuple(running),
        subscribers=tuple(subscribers_of(som, parts[1]).items()),
        duties=tuple(duties_of(som, names, *parts).items()),
    )
    return started, RecordFile(path, CODEC, owner, rospy.logwarn)


def _sorted_out(host: LocalHost, nodes: Set[str]) -> Tuple[Tuple[str, ...], Tuple[str, ...]]:
    """Return the nodes with a substitute's name: those that are dead; strangers."""
    named = sorted(each for each in nodes if each.startswith(host.prefix))
    dead = []
    for node in named:
        with suppress(*FAILURES):  # nobody knows it
            known = host.nodes.look(node)
            if known is not None and known.dead:
                dead.append(node)
    return tuple(dead), tuple(each for each in named if each not in dead)


def _read(path: str) -> Former:
    """Read the records; name those that cannot be ours, and put them aside."""
    try:
        return read_records(path, CODEC)
    except ShsaError as error:
        rospy.logerr("Refused: %s. Healing begins without these records.", error)
        with suppress(OSError):  # then they are overwritten
            os.replace(path, path + ".refused")
        return Former({}, ())


def record_path(namespace: str, kind: str = "records") -> str:
    """Return a file of this master and namespace, in a folder that is made if it is not there."""
    folder = os.path.join(rospkg.get_ros_home(), "shsa")
    with suppress(OSError):  # who writes into it says so
        os.makedirs(folder, 0o700, exist_ok=True)
    name = re.sub(r"[^A-Za-z0-9_.]+", "-", f"{_place(get_master_uri())}/{namespace}").strip("-")
    return os.path.join(folder, f"{name}.{kind}")


@lru_cache(maxsize=None)
def _place(uri: str) -> str:
    """Return the place of our master as it was first told: a name may not be resolved later."""
    return master_place()


class KnowledgeFile:
    """Keeps what a master knows at `path`: for LONGEST_PAUSE_S, and in the same `boot` alone."""

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

    def read(self) -> Tuple[int, Graph]:
        """Return the process of a master, 0 for none, and what was written of it a moment ago."""
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


def maintained(namespace: str) -> bool:
    """Tell that the healing of this master and namespace is to kill and start nothing."""
    path = record_path(namespace, "maintenance")
    why = written_by_others(path) if os.path.lexists(path) else ""
    if why:
        rospy.logerr_once(f"Refused: {path} does not count, as {why}.")
    return os.path.lexists(path) and not why


def maintain(namespace: str, on: bool) -> None:
    """Have it be so, or not. Raises OSError."""
    path = record_path(namespace, "maintenance")
    if on:
        os.close(os.open(path, os.O_WRONLY | os.O_CREAT | os.O_NOFOLLOW, 0o600))
    elif os.path.lexists(path):
        os.unlink(path)
