"""Which node is at an address, by the master's word: what a connection calls itself is a claim."""
import threading
from collections import deque
from typing import Any, Deque, Dict, NamedTuple, Optional, Tuple

import rosgraph
import rospy

from shsa_core.ros.master.announce import of_topic
from shsa_core.ros.sockets.inbox import Inbox
from shsa_core.ros.master.node_api import master_api

ASKING = 4
"""Threads that ask the master, and no more, however many connections there are."""
MOST_KNOWN = 10_000
LONGEST_NAME = 255


class Identified(NamedTuple):
    """The master was asked who is at the other end of a connection.

    `node` is empty if it lists nobody there for the topic, and None if it did not answer.
    """

    topic: str
    transport: Any
    node: Optional[str]


class Identities:
    """Asks the master, in threads of its own, and remembers what it said until `forget`."""

    def __init__(self, inbox: Inbox) -> None:
        self._inbox = inbox
        self._known: Dict[Tuple[str, str], None] = {}
        self._waiting: Deque[Tuple[str, str, Any]] = deque()
        self._asking = 0
        self._lock = threading.Lock()

    def is_known(self, claim: str, uri: str) -> bool:
        """Whether the master has said that this node is at this address."""
        with self._lock:
            return (claim, uri) in self._known

    def forget(self, node: str, uri: str) -> None:
        """A node has gone: whoever comes to its address is asked about."""
        with self._lock:
            self._known.pop((node, uri), None)

    def ask(self, topic: str, claim: str, transport: Any) -> None:
        """Find out who is at the other end of a connection; puts Identified."""
        with self._lock:
            self._waiting.append((topic, claim, transport))
            if self._asking >= ASKING:
                return
            self._asking += 1
        threading.Thread(target=self._work, name="identities", daemon=True).start()

    def _work(self) -> None:
        while True:
            with self._lock:
                if not self._waiting:
                    self._asking -= 1
                    return
                topic, claim, transport = self._waiting.popleft()
            node: Optional[str] = None
            if not transport.done:
                try:
                    node = self._look(topic, claim, transport.endpoint_id)
                except Exception as error:  # whatever the master or its place says, others wait
                    rospy.logdebug("The master does not say who is on %s: %r", topic, error)
            self._inbox.put(Identified(topic, transport, node))

    def _look(self, topic: str, claim: str, uri: str) -> str:
        if not self._is_at(claim, uri):
            publishing, _, _ = master_api().getSystemState()
            listed = [node for node in of_topic(publishing, topic) if node != claim]
            claim = next((node for node in listed if self._is_at(node, uri)), "")
        if claim:
            with self._lock:
                if len(self._known) >= MOST_KNOWN:
                    self._known.clear()
                self._known[claim, uri] = None
        return claim

    def _is_at(self, node: str, uri: str) -> bool:
        if self.is_known(node, uri):
            return True
        if not 0 < len(node) <= LONGEST_NAME:
            return False
        try:
            return bool(master_api().lookupNode(node) == uri)
        except rosgraph.MasterException:
            return False  # it knows no such node
