"""Questions of tests to the master and the nodes of a running ROS graph."""
import os
import signal
import xmlrpc.client
from typing import Any, List, Optional

import psutil
import rosgraph
import rospy

from shsa_testing.processes import running


def publishers(topic: str) -> List[str]:
    """Return the nodes registered as publishers of a topic."""
    return _registered(0, topic)


def subscribers(topic: str) -> List[str]:
    """Return the nodes registered as subscribers of a topic."""
    return _registered(1, topic)


def registered_nodes() -> List[str]:
    """Return every node that the master knows."""
    state = _master().getSystemState()
    return sorted({node for part in state for _, nodes in part for node in nodes})


def is_connected(node: str, topic: str, publisher: str) -> bool:
    """Return whether a node is connected to a publisher of a topic, by the node's own word."""
    try:
        uri, wanted = _master().lookupNode(node), _master().lookupNode(publisher)
    except rosgraph.MasterException:
        return False
    links = {row[1].rstrip("/") for row in _call(uri, "getBusInfo") if row[2:5:2] == ["i", topic]}
    return wanted.rstrip("/") in links


def node_pid(node: str) -> int:
    """Return the process of a running node."""
    return int(_call(_master().lookupNode(node), "getPid"))


def node_process(node: str) -> Optional[psutil.Process]:
    """Return the running process of a node; None if it is not up."""
    try:
        process = psutil.Process(node_pid(node))
    except (rosgraph.MasterException, OSError, psutil.NoSuchProcess):
        return None
    return process if running(process) else None


def kill_hard(node: str) -> None:
    """`kill -9` a node."""
    os.kill(node_pid(node), signal.SIGKILL)


def _master() -> rosgraph.Master:
    return rosgraph.Master(rospy.get_name())


def _registered(part: int, topic: str) -> List[str]:
    state = _master().getSystemState()[part]
    return [node for name, nodes in state if name == topic for node in nodes]


def _call(uri: str, method: str) -> Any:
    """Return the answer of a node's own interface."""
    return getattr(xmlrpc.client.ServerProxy(uri), method)(rospy.get_name())[2]
