"""Connections that bound what they read: rospy's own take any length that is claimed."""
import struct
import weakref
from typing import Any, Callable, Type

import genpy
import rospy
from rosgraph.network import read_ros_handshake_header
from rospy.exceptions import TransportTerminated
from rospy.impl.registration import Registration, get_topic_manager
from rospy.topics import _SubscriberImpl

from shsa_core.errors import ShsaError

LARGEST_HEADER_B = 1 << 20
"""A connection header holds the message's definition."""
LENGTH = struct.Struct("<I")


class _Limited:
    """A socket that gives no more than a header can need."""

    def __init__(self, socket: Any) -> None:
        self._socket, self._came = socket, 0

    def recv(self, size: int) -> bytes:
        """Read; raises ShsaError."""
        if self._came > LARGEST_HEADER_B:
            raise ShsaError(f"its header is longer than {LARGEST_HEADER_B} bytes")
        data: bytes = self._socket.recv(size)
        self._came += len(data)
        return data


def bound_header(transport: Any) -> None:
    """Have rospy give up a connection whose header does not end."""
    weak = weakref.ref(transport)  # it may not hold itself; see connections

    def read_header() -> None:
        found = weak()
        if found is None or found.socket is None:
            return
        found.socket.setblocking(1)
        limited, size = _Limited(found.socket), found.protocol.buff_size
        found._validate_header(read_ros_handshake_header(limited, found.read_buff, size))

    transport.read_header = read_header


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
