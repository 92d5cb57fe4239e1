"""What others publish on a substitute's own topic, heard beside what it reads and publishes."""
import io
import select
import time
from typing import Any, Callable, Dict, List

import genpy
import rospy

from shsa_core.ros.graph import clock
from shsa_core.ros.graph.messages import message_class
from shsa_core.ros.graph.reconnection import refuses
from shsa_core.ros.graph.subscription import subscribe

READ_S = 0.0005
"""What rospy's threads have received is told by then: they need the lock of the interpreter."""

ENDED = select.POLLRDHUP | select.POLLHUP | select.POLLERR | select.POLLNVAL


class Overhearing:
    """Subscriptions of topics on which only others count.

    `heard(topic, publisher, stamp)` is called, from rospy's threads, at every message of others;
    `stamp` in ns, 0: it has none. `gone(topic, publisher)`: its connection has ended, and nobody
    listens any more where its node did.

    A topic has one subscription in a process, which a program may read as well: so messages are
    decoded here though nobody looks into them.
    """

    def __init__(
        self,
        name: str,
        heard: Callable[[str, str, int], None],
        gone: Callable[[str, str], None],
    ) -> None:
        self._name, self._heard, self._gone = name, heard, gone
        self._subscribers: Dict[str, rospy.Subscriber] = {}
        self._newest: Dict[str, genpy.Message] = {}

    def listen(self, topic: str, kind: str) -> None:
        """Subscribe a topic, once; waits for the master."""
        if topic in self._subscribers:
            return
        self._subscribers[topic] = subscribe(topic, message_class(kind), self._received, self.ended)

    def ended(self, topic: str, connection: Any) -> None:
        """A connection of any topic has ended; called by the thread that read it."""
        publisher, address = connection.callerid_pub, connection.dest_address
        if topic not in self._subscribers or publisher == self._name or not address:
            return
        if refuses(address[0], connection.endpoint_id):
            self._gone(topic, publisher)

    def newest(self, topic: str) -> bytes:
        """The newest message of another one, serialized; empty: there is none."""
        message = self._newest.get(topic)
        if message is None:
            return b""
        written = io.BytesIO()
        message.serialize(written)
        return written.getvalue()

    def stands(self, topic: str, publisher: str) -> bool:
        """Whether a connection to a publisher stands.

        What has come from anybody else, and was not read yet, is told before.
        """
        time.sleep(READ_S)
        found = False
        for transport in self._connections(topic):
            if transport.callerid_pub == self._name or transport.done:
                continue
            state = _poll(transport.socket)
            if state & ENDED:
                continue
            if state & select.POLLIN:
                self._heard(topic, transport.callerid_pub, 0)
            found = found or transport.callerid_pub == publisher
        return found

    def _connections(self, topic: str) -> List[Any]:
        subscriber = self._subscribers.get(topic)
        impl = None if subscriber is None else subscriber.impl
        # Once ROS shuts down there are none. rospy never changes the list itself.
        return [] if impl is None else list(impl.connections or ())

    def _received(self, message: genpy.Message, topic: str) -> None:
        publisher = message._connection_header["callerid"]
        if publisher == self._name:
            return
        self._newest[topic] = message
        stamp = message.header.stamp.to_nsec() if message._has_header else 0
        self._heard(topic, publisher, min(stamp, clock.ros_ns()) if stamp else 0)


def _poll(connection: Any) -> int:
    """What is with a socket. Nothing is read: rospy's thread may do that meanwhile."""
    poll = select.poll()
    try:
        poll.register(connection, select.POLLIN | select.POLLRDHUP)
    except (TypeError, ValueError):  # it was closed
        return ENDED
    return next((events for _, events in poll.poll(0)), 0)
