"""Yields a topic to its returning original, consumer by consumer, so that each hears one voice and no gap.

Subscribers connect to a new publisher one after the other, up to 0.2 s apart. A substitute that fell mute at the
original's first message would leave the last of them without any; one that went on would talk over the original at
the first.
"""
import threading
import xmlrpc.client
from typing import Any, FrozenSet, Optional

import genpy
import rosgraph
import rospy

from shsa_core.ros.graph.node_api import node_api

NOBODY: FrozenSet[str] = frozenset()
SHORTEST_PERIOD = 0.01  # s between two looks at the original


class Handover:
    """Knows which consumers of `topic` its original serves; looks once a period while it follows one."""

    def __init__(self, topic: str, period: float) -> None:
        self.served = NOBODY
        self._topic = topic
        self._period = max(period, SHORTEST_PERIOD)
        self._original = ""
        self._closed = False
        self._wake = threading.Event()
        threading.Thread(target=self._watch, name="handover", daemon=True).start()

    def follow(self, original: str) -> None:
        """Look for the node `original` from now on; `""` for none."""
        if original == self._original:
            return
        self._original = original
        self.served = NOBODY
        if original:
            self._wake.set()
        else:
            self._wake.clear()

    def close(self) -> None:
        """Look no more."""
        self._closed = True
        self._wake.set()

    def _watch(self) -> None:
        master = rosgraph.Master(rospy.get_name())
        while not self._closed and not rospy.is_shutdown():
            self._wake.wait()
            original = self._original
            served = self._ask(master, original) if original else NOBODY
            self.served = served if original == self._original else NOBODY
            rospy.rostime.wallsleep(self._period)

    def _ask(self, master: rosgraph.Master, original: str) -> FrozenSet[str]:
        uri = _uri(master, original)
        if uri is None:
            return NOBODY
        try:
            stats: Any = node_api(uri).getBusStats(rospy.get_name())
            info: Any = node_api(uri).getBusInfo(rospy.get_name())
        except (OSError, xmlrpc.client.Error):
            return NOBODY
        # A row of a publication ends with its connections: id, bytes sent, and what has been sent of messages.
        rows = [row for entry in stats[2][0] if entry[0] == self._topic for row in entry[-1]]
        spoken_to = {row[0] for row in rows if row[2] > 0}
        outbound = [row for row in info[2] if row[2] == "o" and row[4] == self._topic]
        return frozenset(str(row[1]) for row in outbound if row[0] in spoken_to)


def _uri(master: rosgraph.Master, node: str) -> Optional[str]:
    try:
        return str(master.lookupNode(node))
    except (rosgraph.MasterException, OSError):
        return None


def publish_to_others(
    publisher: rospy.Publisher, message: genpy.Message, served: FrozenSet[str]
) -> None:
    """Publish to every connected subscriber but those `served`."""
    if not served:
        publisher.publish(message)
        return
    impl = publisher.impl
    impl.acquire()
    try:
        for connection in list(impl.connections):
            if connection.endpoint_id not in served:
                impl.publish(message, connection_override=connection)
    finally:
        impl.release()
