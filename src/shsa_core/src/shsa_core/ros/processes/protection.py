"""Finds nodes that take others along: they are killed only where the SOM names them."""
import os
from typing import Any, Iterable, Set

import psutil

from shsa_core.ros.master.node_api import FAILURES, master_api, node_api

URIS = "/roslaunch/uris"
"""Where each roslaunch says how it can be asked."""
MOST_LAUNCHES = 32
"""Anybody can write there: no more are asked."""


def protection(node: str, process: psutil.Process, others: Iterable[str]) -> str:
    """Return why a node is protected whose process `others` share; empty: it is not.

    Asks each roslaunch of this master, and takes as long as they do.
    """
    if _is_nodelet_manager(process):
        return "its process is a nodelet manager"
    if others:
        return f"its process is that of {', '.join(sorted(others))} too"
    if _is_required(node, process.pid):
        return 'its launch file says required="true"'
    return ""


def _is_nodelet_manager(process: psutil.Process) -> bool:
    try:
        words = process.cmdline()
    except psutil.Error:
        return False
    return [os.path.basename(word) for word in words[:2]] == ["nodelet", "manager"]


def _is_required(node: str, pid: int) -> bool:
    """Return whether a roslaunch ends with a node's process."""
    try:
        uris = master_api().getParam(URIS)
    except FAILURES:
        return False  # no roslaunch has started anything
    return any(_requires(uri, node, pid) for uri in sorted(_leaves(uris))[:MOST_LAUNCHES])


def _requires(uri: str, node: str, pid: int) -> bool:
    roslaunch: Any = node_api(uri)
    try:
        _, _, (alive, _) = roslaunch.list_processes()
        # roslaunch calls the process of /name `name-3`: the third that it has started.
        mine = [name for name, _ in alive if "/" + name.rsplit("-", 1)[0].strip("/") == node]
        infos = [roslaunch.process_info(name)[2] for name in mine]
        return any(info.get("pid") == pid and info.get("required") for info in infos)
    except (*FAILURES, ValueError, TypeError, AttributeError, LookupError):
        return False  # it has ended, or is none


def _leaves(tree: Any) -> Set[str]:
    if isinstance(tree, dict):
        return {leaf for each in tree.values() for leaf in _leaves(each)}
    return {tree} if isinstance(tree, str) else set()
