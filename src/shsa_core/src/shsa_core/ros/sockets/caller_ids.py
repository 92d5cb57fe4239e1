"""Finds out from the master, and from the kernel, which node is at the other end of a connection.

A name is a claim. A connection counts for a node once the master lists that node at the address
that was connected to, and, on this computer, the kernel says that one user listens there and sends.
"""
import socket
from functools import partial
from typing import Callable, Dict, Optional

import rospy

from shsa_core.analysis.registrations import is_name
from shsa_core.agenda import Agenda, doubled
from shsa_core.ros import clock, settings
from shsa_core.ros.master.node_api import FAILURES, located, master_api, resolved, uri_of
from shsa_core.ros.sockets.connection import Connection
from shsa_core.ros.trust.owners import is_local, listening, speaker
from shsa_core.ros.workers import Workers

NOT_LISTED = "the master does not list this name at its address: it counts for nobody"


class CallerIds:
    """Asks the master whose connections are, and remembers where it said that nodes are.

    For one thread. `tell(connection, node, at)` is called from others with what is to be
    `answered`, `refused(topic, claim, why)` for who is not whom it calls itself.
    """

    def __init__(
        self,
        tell: Callable[[Connection, Optional[str], str], None],
        refused: Callable[[str, str, str], object],
    ) -> None:
        self._tell, self._refused = tell, refused
        self._nodes: Dict[str, str] = {}
        self._tries: Dict[Connection, int] = {}  # of those that are not known yet
        self._again: Agenda[Connection] = Agenda()
        self._workers = Workers("caller ids", settings.MOST_ASKING_MASTER)

    def claim(self, connection: Connection) -> None:
        """Have a connection count for nobody until it is known whose it is."""
        connection.is_known = False
        self._tries[connection] = 0
        self._workers.put(partial(self._work, connection))

    def drop(self, connection: Connection) -> None:
        """Stop asking about a connection that has ended."""
        self._tries.pop(connection, None)
        self._again.set(connection, None)

    def forget(self, node: str, uri: str) -> None:
        """Have whoever comes to the address of a node that has gone asked about."""
        if self._nodes.get(node) == uri:
            self._nodes.pop(node, None)

    def answered(self, connection: Connection, node: Optional[str], at: str) -> bool:
        """Take the answer that a connection is to `node`, at `at`; return whether it is known now.

        `node` is empty if nobody is there for the topic, and None if the master did not answer.
        """
        tries = self._tries.get(connection)
        if tries is None:
            return False
        if node:
            if node != connection.publisher:
                why = f"it is {node}, by the master's word"
                self._refused(connection.topic, connection.publisher, why)
            del self._tries[connection]
            connection.publisher, connection.at, connection.is_known = node, at, True
            if len(self._nodes) >= settings.MOST_KNOWN_NODES:
                self._nodes.clear()
            self._nodes[node] = connection.uri
            return True
        if node is not None and tries:  # at first it may be registering
            self._refused(connection.topic, connection.publisher, NOT_LISTED)
        pause = doubled(settings.FIRST_PAUSE_S, tries, 2 * settings.ANSWER_S)
        self._again.set(connection, clock.now() + pause)
        self._tries[connection] += 1
        return False

    def ask_again(self) -> None:
        """Ask about those whose pause is over."""
        for connection in self._again.pop_due(clock.now()):
            self._workers.put(partial(self._work, connection))

    def _work(self, connection: Connection) -> None:
        node: Optional[str] = None
        at = ""
        try:
            connected = connection.transport.socket
            if connected is not None:
                at = located(connection.uri)
                found = self._look(connection.topic, connection.publisher, connection.uri)
                node = found if found and _is_sender(connected, at) else ""
        except FAILURES as error:
            rospy.logdebug("The master does not say whose %s is: %r", connection.uri, error)
        finally:  # whatever the master or its place says
            self._tell(connection, node, at)

    def _look(self, topic: str, claim: str, uri: str) -> str:
        if self._is_at(claim, uri):
            return claim
        publishing, _, _ = master_api().getSystemState()
        listed = [node for node in dict(publishing).get(topic, ()) if node != claim]
        return next((node for node in listed if self._is_at(node, uri)), "")

    def _is_at(self, node: str, uri: str) -> bool:
        return self._nodes.get(node) == uri or (is_name(node) and uri_of(node) == uri)


def _is_sender(connected: socket.socket, at: str) -> bool:
    """Return whether who sends is of the user who listens at an address; raises OSError."""
    user = speaker(connected)
    owned = None if user is None else listening(resolved(at))
    return not is_local(at) if user is None else owned is not None and owned.user == user
