"""Lets one healer of a name run on a ROS master: the second one says so and leaves.

Two nodes of one name would end each other for ever: the master shuts the older one down, and its
launch starts it again. So it is looked before anything is registered.
"""
import os
import sys
import time
from typing import Optional

import rosgraph
import rosgraph.names
import rospy

from shsa_core.ros import settings
from shsa_core.ros.master.node_api import FAILURES, master_api, pid, resolved
from shsa_core.ros.processes import kernel
from shsa_core.ros.trust.owners import is_local, listener

GONE_LOOKS = 5
"""So often nobody must be found: a launch starts its healer again within 2 s."""


ASKED_BY_API = "external shutdown request"
"""The beginning of rospy's reason then."""


def await_turn(name: str) -> None:
    """Return at once if no other node `name` of this namespace answers on the master.

    Else say so and leave, with exit status 1. A launch that would start this process again, and
    again, is spared that: it waits, registered nowhere, until the other one has gone for good.
    """
    full = _full_name(name)
    other = find_other(full)
    if other is None:
        return
    text = f"Healing runs on this ROS master already: {full} is {other}. This one leaves."
    if not kernel.started_by_launch(os.getpid()):
        sys.exit(text)
    print(f"{text} It takes its place once that has ended: rosnode kill {full}", file=sys.stderr)
    gone = 0
    try:
        while gone < GONE_LOOKS:
            time.sleep(settings.LOOK_S)
            gone = gone + 1 if find_other(full) is None else 0
    except KeyboardInterrupt:
        sys.exit(0)


def find_other(node: str) -> Optional[str]:
    """Return in words which process a node is that is registered and answers; None: none.

    One that hangs is none: what is started beside it is to take its place. One of another user of
    this computer is none either: anybody can register our name, and all of healing is one user's.
    """
    try:
        uri = master_api().lookupNode(node)
        number = pid(uri)
    except FAILURES:
        return None
    if number == os.getpid():
        return None
    if is_local(uri):
        process = listener(resolved(uri), number)
        if process is None or not kernel.is_ours(process):
            whose = kernel.user(process) if process is not None else "somebody else"
            text = f"{node} is a process of {whose}, and no healer of ours: it is replaced."
            print(text, file=sys.stderr)
            return None
    return f"process {number} at {uri}"


def _full_name(name: str) -> str:
    mappings = rosgraph.names.load_mappings(sys.argv)
    namespace = rosgraph.names.get_ros_namespace()
    return str(rosgraph.names.ns_join(namespace, mappings.get("__name", name)))


class Handover:
    """Hears why this node ends; to be made before the node is initialised.

    Anybody may ask for it by our API, or by taking our name, and as soon as we have registered.
    """

    def __init__(self) -> None:
        self._asked = False
        rospy.core.add_preshutdown_hook(self._told)

    @property
    def followed(self) -> bool:
        """True if our launch starts another one: then what publishes goes on."""
        return self._asked and kernel.started_by_launch(os.getpid())

    def _told(self, reason: str) -> None:
        self._asked = reason.startswith(ASKED_BY_API)
