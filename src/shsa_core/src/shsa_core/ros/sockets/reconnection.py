"""Tells a node that has gone from one that only closed a connection, and connects to it again.

A lost connection alone is no evidence: a rospy subscriber that is told of a publisher twice makes
two connections, and each end may drop another one; a publisher may drop a slow subscriber. What a
node that has gone cannot do is listen at its own address, or offer the topic.
"""
import socket
import threading
import time
from collections import deque
from functools import partial
from typing import Callable, Deque, Dict, NamedTuple, Tuple
from urllib.parse import urlparse

from rospy.impl.tcpros import get_tcpros_handler

from shsa_core.ros import settings
from shsa_core.ros.master.node_api import FAILURES, ask
from shsa_core.ros.rospy_patches.subscribing import HandedOver
from shsa_core.ros.workers import Workers


class Answered(NamedTuple):
    """The node at `uri` was asked for another connection.

    If it was `willing`, that is under way. `number`: as it was asked.
    """

    topic: str
    uri: str
    willing: bool
    number: int


def refuses(address: str, uri: str) -> bool:
    """Return whether nobody listens any more where the node at `uri` did, on host `address`.

    A process that dies closes its connections before the socket that it listens on: who accepts is
    given a moment to drop the call.
    """
    port = _port(uri)
    if not port:
        return False
    end = time.monotonic() + settings.REFUSAL_S
    left = settings.REFUSAL_S
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
    """Asks nodes for connections: each for one at a time, so that a hung one delays no other."""

    def __init__(self, tell: Callable[[Answered], None]) -> None:
        self._tell = tell
        self._workers = Workers("reconnect", settings.MOST_CALLS)
        self._lock = threading.Lock()
        self._waiting: Dict[str, Deque[Tuple[str, HandedOver, int]]] = {}
        self._listened: Dict[str, float] = {}

    def is_gone(self, address: str, uri: str) -> bool:
        """Return whether a node refuses calls; one look does for all topics that it closes."""
        begin = time.monotonic() - settings.LISTENED_S
        self._listened = {each: at for each, at in self._listened.items() if at > begin}
        if not address or uri in self._listened:
            return False
        gone = refuses(address, uri)
        if not gone:
            self._listened[uri] = time.monotonic()
        return gone

    def ask(self, topic: str, uri: str, implementation: HandedOver, number: int) -> None:
        """Connect rospy's subscription of a topic to the node at `uri`; tells Answered."""
        with self._lock:
            waiting = self._waiting.setdefault(uri, deque())
            waiting.append((topic, implementation, number))
            if len(waiting) == 1:
                self._workers.put(partial(self._work, uri))

    def _work(self, uri: str) -> None:
        with self._lock:
            topic, implementation, number = self._waiting[uri][0]
        willing = False
        try:
            willing = _connect(topic, uri, implementation)
        finally:  # whatever a strange node answers, it is not willing
            self._tell(Answered(topic, uri, willing, number))
            with self._lock:
                self._waiting[uri].popleft()
                if self._waiting[uri]:
                    self._workers.put(partial(self._work, uri))
                else:
                    del self._waiting[uri]


def _connect(topic: str, uri: str, implementation: HandedOver) -> bool:
    """Connect as rospy does when the master tells it of a publisher."""
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
