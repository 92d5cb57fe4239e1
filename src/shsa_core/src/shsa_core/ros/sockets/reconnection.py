"""Tells a node that has gone from one that only closed a connection, and connects to it again.

A lost connection alone is no evidence: a rospy subscriber that is told of a publisher twice makes
two connections, and each end may drop another one; a publisher may drop a slow subscriber. What a
node that has gone cannot do is listen at its own address, or offer the topic.
"""
import socket
import threading
import time
from collections import deque
from typing import Any, Deque, Dict, NamedTuple, Tuple
from urllib.parse import urlparse

import rospy
from rospy.impl.tcpros import get_tcpros_handler

from shsa_core.ros.sockets.inbox import Inbox
from shsa_core.ros.master.node_api import FAILURES, ask

LOOK_S = 0.002
"""A node on this computer has refused, or dropped the call, by then; any other is asked."""

LISTENED_S = 0.1
"""A node that has just listened is asked without another look."""


class Answered(NamedTuple):
    """The node at `uri` was asked for another connection.

    If it was `willing`, that is under way. `number`: as it was asked.
    """

    topic: str
    uri: str
    willing: bool
    number: int


def refuses(address: str, uri: str) -> bool:
    """Whether nobody listens any more where the node at `uri` did, by the address of its host.

    A process that dies closes its connections before the socket that it listens on: who accepts is
    given a moment to drop the call.
    """
    port = _port(uri)
    if not address or not port:
        return False
    end = time.monotonic() + LOOK_S
    left = LOOK_S
    while left > 0.0:
        with socket.socket(socket.AF_INET6 if ":" in address else socket.AF_INET) as caller:
            caller.settimeout(left)
            try:
                caller.connect((address, port))
                caller.settimeout(max(1e-6, end - time.monotonic()))
                caller.recv(1)
            except ConnectionRefusedError:
                return True
            except ConnectionResetError:
                pass
            except OSError:
                return False
        left = end - time.monotonic()
    return False


def _port(uri: str) -> int:
    try:
        return urlparse(uri).port or 0
    except ValueError:
        return 0


class Reconnection:
    """Asks nodes for connections; one thread a node, so that a hung one delays no other."""

    def __init__(self, inbox: Inbox) -> None:
        self._inbox = inbox
        self._lock = threading.Lock()
        self._waiting: Dict[str, Deque[Tuple[str, Any, int]]] = {}
        self._listened: Dict[str, float] = {}

    def is_gone(self, address: str, uri: str) -> bool:
        """Whether a node refuses calls; one look does for all the topics that it closes at once."""
        now = time.monotonic()
        self._listened = {each: at for each, at in self._listened.items() if at > now - LISTENED_S}
        if uri in self._listened:
            return False
        gone = refuses(address, uri)
        if not gone:
            self._listened[uri] = now
        return gone

    def ask(self, topic: str, uri: str, implementation: Any, number: int) -> None:
        """Connect rospy's subscription of a topic to the node at `uri`; puts Answered."""
        with self._lock:
            if uri in self._waiting:
                self._waiting[uri].append((topic, implementation, number))
                return
            self._waiting[uri] = deque([(topic, implementation, number)])
        threading.Thread(target=self._work, args=(uri,), name="reconnect", daemon=True).start()

    def _work(self, uri: str) -> None:
        while True:
            with self._lock:
                waiting = self._waiting[uri]
                if not waiting:
                    del self._waiting[uri]
                    return
                topic, implementation, number = waiting.popleft()
            try:
                willing = _connect(topic, uri, implementation)
            except Exception as error:  # whatever a strange node answers, it is not willing
                rospy.logdebug("%s gives no connection for %s: %r", uri, topic, error)
                willing = False
            self._inbox.put(Answered(topic, uri, willing, number))


def _connect(topic: str, uri: str, implementation: Any) -> bool:
    """As rospy does when the master tells it of a publisher."""
    if implementation.connects(uri):
        return True
    try:
        protocol = ask(uri, "requestTopic", topic, [["TCPROS"]])
    except FAILURES:
        return False
    if not protocol:
        return False
    if implementation.connects(uri):  # rospy was faster
        return True
    done: int = get_tcpros_handler().create_transport(topic, uri, protocol)[0]
    return done == 1
