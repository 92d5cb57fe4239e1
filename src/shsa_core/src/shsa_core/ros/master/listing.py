"""What the master lists: who publishes what, and how that is cleared after a death."""
import threading
import time
from typing import Dict, Set

from shsa_core.ros.master.node_api import master_api


class Listing:
    """The publishers by the master's word; the last answer is kept for those who come soon.

    Whoever is not in it may have come since: the master is asked again.
    """

    def __init__(self) -> None:
        self._publishers: Dict[str, Set[str]] = {}
        self._asked = float("-inf")
        self._lock = threading.Lock()

    def has(self, node: str, topic: str, age: float) -> bool:
        """Whether the master lists a node as a publisher of a topic, at most `age` s ago.

        Raises one of FAILURES if it does not answer.
        """
        with self._lock:
            now = time.monotonic()
            known = node in self._publishers.get(topic, ())
            if not known or now - self._asked > age:
                publishers, _, _ = master_api().getSystemState()
                self._publishers = {topic: set(nodes) for topic, nodes in publishers}
                self._asked = now
            return node in self._publishers.get(topic, ())


def unregister(node: str, uri: str) -> bool:
    """Unregister (node, uri) everywhere; a successor with the same name has another uri.

    Whether the node was a publisher. Raises one of FAILURES if the master does not answer.
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
