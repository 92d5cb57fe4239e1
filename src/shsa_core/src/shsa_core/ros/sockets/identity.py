"""Finds out from the master which node is at the other end of a connection.

What a connection calls itself is a claim. Until the master has said whose it is, it counts for
nobody.
"""
import threading
from dataclasses import dataclass
from functools import partial
from typing import Callable, Dict, NamedTuple, Optional, Tuple

import rosgraph
import rospy

from shsa_core.ros import clock, settings
from shsa_core.ros.master.announce import of_topic
from shsa_core.ros.master.node_api import FAILURES, master_api
from shsa_core.ros.sockets.connection import Connection
from shsa_core.ros.workers import Workers

NOT_LISTED = "the master does not list this name at its address: it counts for nobody"
LONGEST_NAME = 255


class Identified(NamedTuple):
    """The master was asked whose a connection is.

    `node` is empty if it lists nobody there for the topic, and None if it did not answer.
    """

    connection: Connection
    node: Optional[str]


@dataclass
class _Claim:
    """A connection that is not known yet; `ask`: when the master is asked again; None: it is."""

    tries: int = 0
    ask: Optional[float] = None


class Identities:
    """Asks the master whose connections are, and remembers what it said until `forget`.

    All methods are for one thread. `tell` is called from others. `refused(topic, claim, why)` is
    called for who is not whom it calls itself.
    """

    def __init__(
        self, tell: Callable[[Identified], None], refused: Callable[[str, str, str], object]
    ) -> None:
        self._tell, self._refused = tell, refused
        self._known: Dict[Tuple[str, str], None] = {}
        self._lock = threading.Lock()
        self._claims: Dict[Connection, _Claim] = {}
        self._workers = Workers("identities", settings.MOST_ASKING_MASTER)

    def claim(self, connection: Connection) -> bool:
        """Return whether a connection is known to be whose it says; else the master is asked."""
        connection.is_known = self._is_known(connection.publisher, connection.uri)
        if not connection.is_known:
            self._claims[connection] = _Claim()
            self._ask(connection)
        return connection.is_known

    def drop(self, connection: Connection) -> None:
        """Stop asking about a connection that has ended."""
        self._claims.pop(connection, None)

    def forget(self, node: str, uri: str) -> None:
        """Have whoever comes to the address of a node that has gone asked about."""
        with self._lock:
            self._known.pop((node, uri), None)

    def answered(self, item: Identified) -> bool:
        """Take the master's answer; return whether the connection is known by it."""
        connection, node = item
        claim = self._claims.get(connection)
        if claim is None:
            return False
        if node:
            if node != connection.publisher:
                why = f"it is {node}, by the master's word"
                self._refused(connection.topic, connection.publisher, why)
                connection.publisher = node
            del self._claims[connection]
            connection.is_known = True
            return True
        if node is not None and claim.tries:  # at first it may be registering
            self._refused(connection.topic, connection.publisher, NOT_LISTED)
        pauses = settings.ASK_MASTER_AGAIN_S
        claim.ask = clock.now() + pauses[min(claim.tries, len(pauses) - 1)]
        claim.tries += 1
        return False

    def ask_again(self) -> None:
        """Ask about those whose pause is over."""
        now = clock.now()
        for connection, claim in self._claims.items():
            if claim.ask is not None and claim.ask <= now:
                claim.ask = None
                self._ask(connection)

    def _ask(self, connection: Connection) -> None:
        self._workers.put(partial(self._work, connection))

    def _work(self, connection: Connection) -> None:
        node: Optional[str] = None
        try:
            if not connection.transport.done:
                node = self._look(connection.topic, connection.publisher, connection.uri)
        except FAILURES as error:
            rospy.logdebug("The master does not say whose %s is: %r", connection.uri, error)
        finally:  # whatever the master or its place says
            self._tell(Identified(connection, node))

    def _look(self, topic: str, claim: str, uri: str) -> str:
        if not self._is_at(claim, uri):
            publishing, _, _ = master_api().getSystemState()
            listed = [node for node in of_topic(publishing, topic) if node != claim]
            claim = next((node for node in listed if self._is_at(node, uri)), "")
        if claim:
            with self._lock:
                if len(self._known) >= settings.MOST_KNOWN_NODES:
                    self._known.clear()
                self._known[claim, uri] = None
        return claim

    def _is_known(self, node: str, uri: str) -> bool:
        with self._lock:
            return (node, uri) in self._known

    def _is_at(self, node: str, uri: str) -> bool:
        if self._is_known(node, uri):
            return True
        if not 0 < len(node) <= LONGEST_NAME:
            return False
        try:
            return bool(master_api().lookupNode(node) == uri)
        except rosgraph.MasterException:
            return False  # it knows no such node
