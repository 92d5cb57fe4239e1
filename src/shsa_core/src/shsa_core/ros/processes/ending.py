"""Kills a node: asks it to leave, ends its process, clears its registrations.

Which process a node is was verified before (`nodes`), and healing decides when each step comes.
"""
import signal
import socket
import threading
from typing import Callable

import rosgraph
import rospy

from shsa_core.errors import ShsaError
from shsa_core.healing.settings import LEAVE_S
from shsa_core.ros import settings
from shsa_core.ros.master.node_api import FAILURES, ask, master_api, resolved
from shsa_core.ros.processes import kernel
from shsa_core.ros.processes.nodes import Nodes
from shsa_core.ros.trust.owners import listener

WHY = "it failed, and is healed"


class Untouchable(ShsaError):
    """It is not known which process a node is, whether it may be ended, or whether it has left."""


def ask_to_leave(nodes: Nodes, node: str, answered: Callable[[], object] = lambda: None) -> bool:
    """`rosnode kill` by its API; return whether the process has ended in time.

    `answered` is called when the node has. Elsewhere, return whether nobody listens any more where
    it has answered. Raises Untouchable.
    """
    known = nodes.known(node)
    if known is None:
        raise Untouchable("it is not known which process it is")
    if known.process is None:
        return _ask_elsewhere(node, known.uri, answered)
    process = known.process
    threading.Thread(target=_ask, args=(nodes, node, answered), daemon=True).start()
    return kernel.wait_for(lambda: kernel.gone(process), LEAVE_S)


def end_process(nodes: Nodes, node: str, gently: bool = False) -> bool:
    """End a node's process by SIGKILL, or SIGTERM; return whether it ended. Raises Untouchable."""
    known = nodes.known(node)
    if known is None or known.process is None:
        raise Untouchable("it is not known which process it is")
    process = known.process
    try:
        kernel.kill(process, signal.SIGTERM if gently else signal.SIGKILL)
    except ProcessLookupError:
        return True
    except PermissionError as error:
        raise Untouchable(f"it does not leave, and {error}") from error
    return kernel.wait_for(lambda: kernel.gone(process))


def clear(nodes: Nodes, node: str) -> bool:
    """Clear what a dead node left registered at the master, and nothing of a successor.

    False: it was no publisher any more, and so had unregistered itself.
    """
    known = nodes.forget(node)
    if known is not None and known.process is not None and known.lives:
        return True
    uri = known.uri if known else ""
    try:
        if not uri:
            uri = master_api().lookupNode(node)
            if known is not None and listener(resolved(uri)) is not None:
                return True  # it was ended before it registered: this is a successor
        return _unregister(node, uri)
    except FAILURES:
        return True  # the master does not know it, or is away: there is nothing to be cleared


def _ask(nodes: Nodes, node: str, answered: Callable[[], object]) -> None:
    """Ask a node here to leave; whether it does, its process tells."""
    try:
        uri = nodes.uri(node)
        if uri:
            ask(uri, "shutdown", WHY)
            answered()
    except FAILURES as error:
        rospy.logdebug("%s was asked to leave: %s", node, error)


def _ask_elsewhere(node: str, uri: str, answered: Callable[[], object]) -> bool:
    """Ask a node on another computer to leave.

    It has ended if it listens no more, and has said so before: to the master, when it left by
    itself, or to us.
    """
    try:
        ask(uri, "shutdown", WHY)
    except ConnectionRefusedError as error:
        if _is_registered(node):
            why = "it refuses the connection, and cannot be verified to have ended"
            raise Untouchable(why) from error
        return True
    except FAILURES as error:
        raise Untouchable(f"it cannot be verified to have ended: {error}") from error
    answered()
    return kernel.wait_for(lambda: _refuses(uri), LEAVE_S)


def _refuses(uri: str) -> bool:
    """Return whether nobody listens any more at an address; no answer is no proof."""
    try:
        socket.create_connection(resolved(uri), settings.CALL_S).close()
    except OSError as error:
        return isinstance(error, ConnectionRefusedError)
    return False


def _is_registered(node: str) -> bool:
    """Return whether the master knows a node; True as well if that cannot be told."""
    try:
        master_api().lookupNode(node)
    except rosgraph.MasterException:
        return False
    except FAILURES:
        return True
    return True


def _unregister(node: str, uri: str) -> bool:
    """Unregister (node, uri) everywhere; a successor with the same name has another uri.

    Return whether the node was a publisher. Raises one of FAILURES if the master does not answer.
    """
    master = master_api(node)
    publishers, subscribers, services = master.getSystemState()
    for topic, nodes in publishers:
        if node in nodes:
            master.unregisterPublisher(topic, uri)
    for topic, nodes in subscribers:
        if node in nodes:
            master.unregisterSubscriber(topic, uri)
    for name, nodes in services:
        if node in nodes and master.lookupNode(node) == uri:
            master.unregisterService(name, master.lookupService(name))
    return any(node in nodes for _, nodes in publishers)
