"""The process of a node: the one that listens where the master says the node does."""
import json
import os
import time
from dataclasses import dataclass
from typing import Dict, List, Optional, Tuple

import psutil

from shsa_core.model.service import Service
from shsa_core.ros.master.node_api import FAILURES, master_api, node_api, resolved, uri_at
from shsa_core.ros.trust import owners
from shsa_injection.errors import Refused
from shsa_injection.ros import guard, healers
from shsa_injection.ros.guard import STARTER

CALLER = "/shsa_inject"
SHUTDOWN_S = 3.0
"""So long a process may take to end."""
POLL_S = 0.002


@dataclass(frozen=True)
class Start:
    """The start of a process: so it can be started again.

    `starter`: who did first, with which it ends, as (pid, when it was made); None: nobody.
    """

    words: List[str]
    folder: str
    environment: Dict[str, str]
    starter: Optional[Tuple[int, float]]


@dataclass(frozen=True)
class Target:
    """A node: its name, its address, and the process that listens there."""

    node: str
    uri: str
    process: psutil.Process

    @property
    def pid(self) -> int:
        """The process's number."""
        return int(self.process.pid)

    @property
    def created(self) -> float:
        """The time at which the process was made: numbers are used again."""
        return float(self.process.create_time())


def find(service: Service) -> Target:
    """Return the process of a service's node.

    Raises Refused if the node is not there, does not publish the topic, or is not this user's on
    this computer.
    """
    node = service.node
    try:
        publishing, _, _ = master_api().getSystemState()
        uri = master_api().lookupNode(node)
    except FAILURES as error:
        raise Refused(f"{node}: the master does not tell where it is: {error}") from error
    if node not in dict(publishing).get(service.topic, ()):
        raise Refused(f"{node} does not publish {service.topic} now")
    process = owned(listening_process(uri), node)
    if healers.is_one(process):
        raise Refused(f"{node} belongs to healing itself: only `shsa chaos --healers` touches that")
    return Target(node, uri, process)


def listening_process(uri: str) -> psutil.Process:
    """Return the process that listens at an address on this computer. Raises Refused."""
    try:
        at = resolved(uri)
    except FAILURES as error:
        raise Refused(f"{uri} cannot be found: {error}") from error
    if not owners.is_local(uri_at(at)):
        raise Refused(f"{uri} is on another computer: run the tool there")
    process = owners.listener(at)
    if process is None:
        raise Refused(f"no process of this user listens at {uri}")
    return process


def owned(process: psutil.Process, what: str) -> psutil.Process:
    """Return a process, if it is this user's and not our own. Raises Refused if not."""
    try:
        user = process.uids().real
    except psutil.Error as error:
        raise Refused(f"{what} has ended") from error
    if user != os.getuid():
        raise Refused(f"{what} is another user's (process {process.pid})")
    if process.pid == os.getpid():
        raise Refused(f"{what} is this process itself")
    return process


def start_of(process: psutil.Process) -> Start:
    """Return how a process was started. Raises Refused if that is not known."""
    try:
        environment = process.environ()
        starter = _starter(process, environment.pop(STARTER, ""))
        return Start(process.cmdline(), process.cwd(), environment, starter)
    except (psutil.Error, OSError) as error:
        raise Refused(f"process {process.pid} cannot be looked at: {error}") from error


def _starter(process: psutil.Process, told: str) -> Optional[Tuple[int, float]]:
    parent = process.parent()
    if parent is None or parent.pid == 1:
        return None
    if os.path.abspath(guard.__file__) in parent.cmdline():
        first = json.loads(told)
        return None if first[0] is None else (int(first[0]), float(first[1]))
    return parent.pid, parent.create_time()


def lives(process: psutil.Process) -> bool:
    """Return whether a process runs; one that has ended and waits for its parent does not."""
    try:
        return bool(process.is_running() and process.status() != psutil.STATUS_ZOMBIE)
    except psutil.NoSuchProcess:
        return False


def send_signal(process: psutil.Process, number: int) -> bool:
    """Send a signal; whether the process was still there."""
    try:
        process.send_signal(number)
    except psutil.NoSuchProcess:
        return False
    return True


def ask_to_leave(target: Target) -> None:
    """End a node as `rosnode kill` does. Raises Refused if its process does not end."""
    why = "it was asked, and stays"
    try:
        node_api(target.uri).shutdown(CALLER, "an injected fault")
    except FAILURES as error:
        why = str(error)  # who leaves may have no time to answer
    if not has_ended(target.process):
        raise Refused(f"{target.node} does not leave: {why}")


def has_ended(process: psutil.Process) -> bool:
    """Wait until a process has ended, be it that nobody has asked for its status yet."""
    deadline = time.monotonic() + SHUTDOWN_S
    while lives(process):
        if time.monotonic() > deadline:
            return False
        time.sleep(POLL_S)
    return True
