"""The connections to the publishers of topics, read by one thread of our own.

rospy makes the connections, each in a thread that then reads and calls back. Here that thread ends
when the connection stands, and whoever calls `read` gets the messages straight from the sockets:
what the kernel has received by then is handled before anybody is judged, and a connection that ends
is seen after its last message, when it ends.
"""
import struct
import weakref
from dataclasses import dataclass, field
from typing import Any, Dict, Iterator, List, NamedTuple, Set, Union

import rospy
from rospy.impl.registration import Registration, get_topic_manager
from rospy.topics import _SubscriberImpl

from shsa_core.ros.graph.inbox import Inbox

CHUNK = 65536
CHUNKS_A_TURN = 16
"""A babbling publisher must not keep the others waiting."""


class Made(NamedTuple):
    """rospy has made a connection and read its header."""

    topic: str
    transport: Any


class Closed(NamedTuple):
    """rospy has closed a connection."""

    topic: str
    transport: Any


@dataclass(eq=False)
class Connection:
    """A standing connection to a publisher."""

    topic: str
    publisher: str
    header: Dict[str, str]
    transport: Any
    descriptor: int
    buffer: bytearray = field(default_factory=bytearray)

    def read(self) -> bool:
        """Read what has come; whether the connection still stands."""
        for _ in range(CHUNKS_A_TURN):
            try:
                data = self.transport.socket.recv(CHUNK)
            except BlockingIOError:
                return True
            except (OSError, AttributeError):
                return False
            if not data:
                return False
            self.buffer += data
            if len(data) < CHUNK:
                return True
        return True

    def messages(self) -> List[bytes]:
        """The complete messages that were read, each once."""
        found, start, buffer = [], 0, self.buffer
        while len(buffer) >= start + 4:
            end = start + 4 + struct.unpack_from("<I", buffer, start)[0]
            if len(buffer) < end:
                break
            found.append(bytes(buffer[start + 4 : end]))
            start = end
        del buffer[:start]
        return found


class Connected(NamedTuple):
    """The first connection to a publisher of a topic stands."""

    topic: str
    publisher: str


class Lost(NamedTuple):
    """The last connection to a publisher of a topic is lost."""

    topic: str
    publisher: str


class Arrived(NamedTuple):
    """A message has come."""

    connection: Connection
    data: bytes


Happening = Union[Connected, Lost, Arrived]


class _Implementation(_SubscriberImpl):
    """rospy's side of a subscription, which hands its connections over."""

    def __init__(self, topic: str, inbox: Inbox) -> None:
        super().__init__(topic, rospy.AnyMsg)
        self.set_tcp_nodelay(True)
        self._topic, self._inbox = topic, inbox

    def add_connection(self, transport: Any) -> bool:
        """Called by rospy for every new connection; it may replace one to the same publisher."""
        topic, inbox = self._topic, self._inbox
        # What rospy drops while it connects must be freed, and so closed, at once: a connection
        # that stays without a header keeps a rospy publisher from serving anybody else. So it may
        # not hold itself.
        weak = weakref.ref(transport)
        transport.receive_loop = lambda callback: inbox.put(Made(topic, weak()))
        transport.set_cleanup_callback(lambda closing: inbox.put(Closed(topic, closing)))
        return bool(super().add_connection(transport))

    def has_successor(self, transport: Any) -> bool:
        """Whether another connection to the same publisher is under way."""
        with self.c_lock:
            return any(
                other is not transport and other.endpoint_id == transport.endpoint_id
                for other in self.connections
            )


class Connections:
    """The connections of every subscribed topic.

    All methods are for one thread, the one that reads `inbox`.
    """

    def __init__(self, inbox: Inbox) -> None:
        self._inbox = inbox
        self._subscribers: Dict[str, rospy.Subscriber] = {}
        self._standing: Dict[int, Connection] = {}
        self._new: Set[int] = set()
        self._expected: Dict[Any, str] = {}

    def subscribe(self, topic: str) -> None:
        """Subscribe `topic`."""
        manager = get_topic_manager()
        implementation = _Implementation(topic, self._inbox)
        with manager.lock:
            manager._add(implementation, manager.subs, Registration.SUB)
            self._subscribers[topic] = rospy.Subscriber(topic, rospy.AnyMsg)

    def unsubscribe(self, topic: str) -> None:
        """End the subscription of `topic` and its connections."""
        self._subscribers.pop(topic).unregister()
        for connection in list(self._standing.values()):
            if connection.topic == topic:
                del self._standing[connection.descriptor]

    def heed(self, item: Union[Made, Closed]) -> Iterator[Happening]:
        """What follows from what rospy did."""
        if item.topic not in self._subscribers:
            return
        if isinstance(item, Made):
            yield from self._take_over(item.topic, item.transport)
        else:
            for connection in list(self._standing.values()):
                if connection.transport is item.transport:
                    yield from self._lose(connection)
            yield from self._settle(item.topic, item.transport)

    def read(self, ready: Set[int]) -> List[Happening]:
        """What has come on the descriptors that are ready, and on new connections."""
        ready, self._new = ready | self._new, set()
        return list(self._read(ready))

    def _read(self, ready: Set[int]) -> Iterator[Happening]:
        for descriptor in ready:
            connection = self._standing.get(descriptor)
            if connection is None:
                continue
            stands = connection.read()
            for data in connection.messages():
                yield Arrived(connection, data)
            if not stands:
                yield from self._lose(connection)
                connection.transport.close()

    def _take_over(self, topic: str, transport: Any) -> Iterator[Happening]:
        socket = transport.socket
        if transport.done or socket is None:
            return
        socket.setblocking(False)
        publisher, descriptor = transport.callerid_pub, socket.fileno()
        connection = Connection(topic, publisher, transport.header, transport, descriptor)
        connection.buffer += transport.read_buff.getvalue()
        if descriptor in self._standing:
            yield from self._lose(self._standing[descriptor])
        known = self._publishers(topic)
        self._standing[descriptor] = connection
        self._new.add(descriptor)
        self._inbox.watch(descriptor)
        if publisher not in known:
            yield Connected(topic, publisher)
        yield from self._settle(topic, transport)

    def _lose(self, connection: Connection) -> Iterator[Happening]:
        del self._standing[connection.descriptor]
        topic, transport = connection.topic, connection.transport
        if self._implementation(topic).has_successor(transport):
            self._expected[(topic, transport.endpoint_id)] = connection.publisher
        elif connection.publisher not in self._publishers(topic):
            yield Lost(topic, connection.publisher)

    def _settle(self, topic: str, transport: Any) -> Iterator[Happening]:
        """A successor stands or has failed.

        Its predecessor's publisher is lost unless it is connected again.
        """
        publisher = self._expected.get((topic, transport.endpoint_id))
        if publisher is None:
            return
        connected = publisher in self._publishers(topic)
        if connected or not self._implementation(topic).has_successor(transport):
            del self._expected[(topic, transport.endpoint_id)]
            if not connected:
                yield Lost(topic, publisher)

    def _implementation(self, topic: str) -> _Implementation:
        return self._subscribers[topic].impl

    def _publishers(self, topic: str) -> Set[str]:
        return {c.publisher for c in self._standing.values() if c.topic == topic}
