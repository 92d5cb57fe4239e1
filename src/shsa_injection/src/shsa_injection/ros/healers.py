"""The processes of healing on this computer, known by the programs that they run.

Their names prove nothing: anybody can claim one.
"""
import argparse
import functools
import os
from dataclasses import dataclass
from typing import Dict, FrozenSet, Iterator, List, Sequence, Tuple

import psutil
from roslib.packages import find_node

from shsa_core.errors import ShsaError
from shsa_core.model.names import full_name
from shsa_core.ros.master.node_api import master_uri
from shsa_core.ros.processes.kernel import robot_processes
from shsa_core.ros.processes.prepared import OPTION
from shsa_injection.errors import Refused

PACKAGE = "shsa_core"
HEALERS = ("monitor", "reconfigurator")
SUBSTITUTES = ("substitute", "standby")


@dataclass(frozen=True)
class Healer:
    """A process of healing: its program, its node's name, and the namespace that it is in."""

    program: str
    node: str
    namespace: str
    process: psutil.Process
    words: Tuple[str, ...]


@functools.lru_cache(maxsize=None)
def _files(program: str) -> FrozenSet[str]:
    """Return the path of a program's executable."""
    return frozenset(os.path.realpath(path) for path in find_node(PACKAGE, program))


def is_one(process: psutil.Process) -> bool:
    """Return whether a process runs one of the programs of healing."""
    return bool(_program(process.cmdline(), (*HEALERS, *SUBSTITUTES)))


def running(programs: Sequence[str] = HEALERS) -> List[Healer]:
    """Return the processes of this user and this master that run these programs."""
    return list(_running(programs))


def _running(programs: Sequence[str]) -> Iterator[Healer]:
    for process, words, variables in robot_processes():
        program = _program(words, programs)
        if not program or OPTION in words:
            continue  # who only forks substitutes is none
        namespace = variables.get("ROS_NAMESPACE", "/")
        names = [word.split(":=")[1] for word in words if word.startswith("__name:=")]
        node = full_name(names[-1] if names else program, namespace)
        yield Healer(program, node, namespace, process, tuple(words))


def only(program: str) -> Healer:
    """Return the one process of a program. Raises Refused if there is none, or several."""
    found = running((program,))
    if len(found) != 1:
        raise Refused(f"{len(found)} processes of this user run {program}; one is needed")
    return found[0]


def som_file() -> Tuple[str, str]:
    """Return the SOM file that healing runs with, and its namespace.

    Taken from the process and not from the parameter server, where anybody may write. Raises
    ShsaError if there is no such process, or several with other files.
    """
    master_uri()  # what is none is of no robot
    found = {(_option(each), each.namespace) for each in running(("reconfigurator",))}
    if len(found) != 1:
        why = "no reconfigurator of this user runs here" if not found else "several robots run here"
        raise ShsaError(f"{why}: name the SOM with --som FILE")
    return found.pop()


def _option(healer: Healer) -> str:
    parser = argparse.ArgumentParser(add_help=False)
    parser.add_argument("--som", default="")
    path: str = parser.parse_known_args(healer.words)[0].som
    return os.path.join(healer.process.cwd(), path)


def substitutes(namespace: str) -> Dict[str, int]:
    """Return the processes of substitutes in a namespace, by the names of their nodes."""
    found = running(SUBSTITUTES)
    return {each.node: each.process.pid for each in found if each.namespace == namespace}


def _program(words: Sequence[str], programs: Sequence[str]) -> str:
    files = {os.path.realpath(word) for word in words[:2] if word.startswith("/")}
    return next((each for each in programs if files & _files(each)), "")
