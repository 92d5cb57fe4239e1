"""Processes that a test starts: found by the mark that they inherit, and ended with it."""
import atexit
import random
import socket
import subprocess
from contextlib import suppress
from functools import lru_cache
from typing import Any, List

import psutil
from roslib.packages import find_node


def running(process: psutil.Process) -> bool:
    """Return whether a process is there and not a zombie."""
    try:
        return process.is_running() and process.status() != psutil.STATUS_ZOMBIE
    except psutil.NoSuchProcess:
        return False


def marked(name: str, value: str) -> List[psutil.Process]:
    """Return the running processes whose environment variable `name` has this value."""

    def has_mark(process: psutil.Process) -> bool:
        try:
            return bool(process.environ().get(name) == value)
        except (psutil.Error, OSError):  # it ended, or is another user's
            return False

    return [each for each in psutil.process_iter() if has_mark(each) and running(each)]


@lru_cache(maxsize=None)
def program(package: str, executable: str) -> str:
    """Return the path of a node, as rosrun finds it, and in less time."""
    return str(find_node(package, executable)[0])


def own_address() -> str:
    """Return an address of this computer for a robot of its own.

    A master calls nodes that have died: the kernel gives their ports to others, if at that address.
    """
    return ".".join(["127", *(str(random.randint(1, 254)) for _ in range(3))])


def free_port() -> int:
    """Return a port that is free and stays so: the kernel gives those above it to nodes."""
    while True:
        port = random.randint(20000, 32000)
        with suppress(OSError), socket.socket() as probe:
            probe.bind(("", port))
            return port


def rosrun(package: str, executable: str, *arguments: str) -> "subprocess.Popen[bytes]":
    """Start a node as rosrun does; it ends with this process."""
    process = subprocess.Popen([program(package, executable), *arguments])
    atexit.register(end_process, process)
    return process


def end_process(process: "subprocess.Popen[Any]") -> None:
    """End a process that a test started."""
    process.kill()
    process.wait()
