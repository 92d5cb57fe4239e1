"""Subscriptions whose connections are bounded, or read by a thread of our own.

Faults of rospy 1.15 to 1.17: it buffers any length that is claimed for a header or a message
(`read_ros_handshake_header`, `TCPROSTransportProtocol.read_messages`). It waits 60 s for a
publisher to answer (`ROSHandler._connect_topic`): a node that has the port of a dead one by now
takes that call for a header, and serves nobody until it ends. It reads each connection in a thread
that calls back, not saying when one ended, or when a message came. One that was refused stays in
`connections`, so that no other is made to that node.
"""
import socket
import struct
import time
import weakref
from typing import Any, Callable, Type

import genpy
import rospy
from rosgraph.network import decode_ros_handshake_header
from rospy.exceptions import TransportInitError, TransportTerminated
from rospy.impl import masterslave, tcpros_pubsub
from rospy.impl.registration import Registration, get_topic_manager
from rospy.topics import _SubscriberImpl

from shsa_core.errors import ShsaError
from shsa_core.ros import settings
from shsa_core.ros.master.node_api import node_api

LENGTH = struct.Struct("<I")


def read_header(connection: socket.socket, seconds: float) -> bytes:
    """Return the header with its length, and no byte more. Raises OSError, ShsaError."""
    length = read(connection, LENGTH.size, connection.recv, seconds)
    (size,) = LENGTH.unpack(length)
    if size > settings.LARGEST_HEADER_B:
        raise ShsaError(f"a header of {size} bytes; {settings.LARGEST_HEADER_B} are allowed")
    return length + read(connection, size, connection.recv, seconds)


def read(
    connection: socket.socket, size: int, some: Callable[[int], bytes], seconds: float
) -> bytes:
    """Read so many bytes in a time in s at most; raises OSError, ShsaError."""
    data, end = b"", time.monotonic() + seconds
    while len(data) < size:
        left = end - time.monotonic()
        connection.settimeout(max(1e-3, left))
        came = some(size - len(data))
        if not came:
            raise ShsaError("it ended before all had come")
        data += came
        if left <= 0.0:
            raise ShsaError("it takes too long")
    connection.settimeout(None)
    return data


def ask_in_time() -> None:
    """Have rospy give up a publisher that does not answer in time; call it before `init_node`."""
    patient = lambda uri, **_: node_api(uri, settings.PATIENCE_S)
    masterslave.xmlrpcapi = tcpros_pubsub.ServerProxy = patient


def bound_header(transport: Any) -> None:
    """Have rospy give up a connection whose header does not end."""
    # One that stays without a header keeps a rospy publisher from serving anybody else: what rospy
    # drops while it connects must be closed, and so freed; it may not hold itself.
    weak = weakref.ref(transport)

    def read_bounded() -> None:
        found = weak()
        if found is None or found.socket is None:
            return
        if found.done:  # before there was a socket to close; no header was sent
            found.socket.close()
        try:
            header = read_header(found.socket, settings.LONGEST_PAUSE_S)
            found._validate_header(decode_ros_handshake_header(header))
        except (TransportInitError, socket.timeout) as error:
            found.header = None
            raise ShsaError(str(error)) from error  # on which rospy closes it

    transport.read_header = read_bounded


def bound_messages(transport: Any, largest: int) -> None:
    """Have rospy end a connection that announces a message of more than `largest` bytes."""
    read = transport.protocol.read_messages

    def read_messages(buffer: Any, messages: Any, socket: Any) -> None:
        (size,) = LENGTH.unpack_from(buffer.getbuffer())
        if size > largest:
            raise TransportTerminated(f"a message of {size} bytes; {largest} are allowed")
        read(buffer, messages, socket)

    transport.protocol.read_messages = read_messages


class _Bounded(_SubscriberImpl):
    """rospy's side of a subscription, within bounds."""

    def __init__(self, name: str, kind: Type[genpy.Message], largest: int) -> None:
        super().__init__(name, kind)
        self._largest = largest

    def add_connection(self, transport: Any) -> bool:
        """Called by rospy for every new connection."""
        bound_header(transport)
        bound_messages(transport, self._largest)
        return bool(super().add_connection(transport))


def subscribe(
    topic: str, kind: Type[genpy.Message], heard: Callable[[Any], None], largest: int
) -> rospy.Subscriber:
    """Subscribe; who announces a message of more than `largest` bytes is cut off."""
    name, manager = rospy.resolve_name(topic), get_topic_manager()
    with manager.lock:
        if manager.get_impl(Registration.SUB, name) is None:
            manager._add(_Bounded(name, kind, largest), manager.subs, Registration.SUB)
        return rospy.Subscriber(topic, kind, heard, tcp_nodelay=True)


class HandedOver(_SubscriberImpl):
    """rospy's side of a subscription whose connections somebody else reads.

    `made(transport)` is called once a connection stands, `closed` when rospy has closed one; from
    any thread.
    """

    def __init__(
        self, topic: str, made: Callable[[Any], None], closed: Callable[[Any], None]
    ) -> None:
        super().__init__(topic, rospy.AnyMsg)
        self.set_tcp_nodelay(True)
        self._topic, self._made, self._closed = topic, made, closed

    def subscribe(self) -> None:
        """Register the subscription; waits for the master."""
        manager = get_topic_manager()
        with manager.lock:
            manager._add(self, manager.subs, Registration.SUB)
            self.subscriber = rospy.Subscriber(self._topic, rospy.AnyMsg)

    def has_connection(self, endpoint_id: str) -> bool:
        """Called by rospy before it connects: nobody needs to hear itself."""
        return endpoint_id == rospy.get_node_uri() or bool(super().has_connection(endpoint_id))

    def add_connection(self, transport: Any) -> bool:
        """Called by rospy for every new connection; it may replace one to the same publisher."""
        made, weak = self._made, weakref.ref(transport)
        bound_header(transport)
        transport.receive_loop = lambda callback: made(weak())
        transport.set_cleanup_callback(self._closed)
        return bool(super().add_connection(transport))

    def connects(self, uri: str) -> bool:
        """Return whether a connection to the node at `uri` stands or is under way."""
        with self.c_lock:
            return any(each.endpoint_id == uri for each in self.connections)
