"""Subscriptions whose connections are bounded, or read by a thread of our own.

Faults of rospy 1.15 to 1.17: it buffers any length that is claimed for a header or a message
(`read_ros_handshake_header`, `TCPROSTransportProtocol.read_messages`). It waits 60 s for a
publisher to answer (`ROSHandler._connect_topic`): a node that has the port of a dead one by now
takes that call for a header, and serves nobody until it ends. It reads each connection in a thread
that calls back, not saying when one ended, or when a message came. One that was refused stays in
`connections`, so that no other is made to that node. Nobody asks for another connection in place of
one that ended or was refused: who subscribed a table hears nothing of it any more.
"""
import socket
import struct
import threading
import time
import weakref
from contextlib import suppress
from dataclasses import dataclass
from typing import Any, Callable, Dict, Type

import genpy
import rospy
from rosgraph.network import decode_ros_handshake_header
from rospy.exceptions import TransportInitError, TransportTerminated
from rospy.impl import masterslave, tcpros_pubsub
from rospy.impl.registration import Registration, get_topic_manager
from rospy.impl.tcpros import get_tcpros_handler
from rospy.topics import _SubscriberImpl

from shsa_core.agenda import doubled
from shsa_core.errors import ShsaError
from shsa_core.ros import settings
from shsa_core.ros.master.node_api import FAILURES, BadAnswer, ask, node_api, uri_of

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


class _Asking(_SubscriberImpl):
    """rospy's side of a subscription that asks for connections by itself, too."""

    def connect(self, uri: str) -> bool:
        """Connect as rospy does when the master tells it of a publisher. Raises one of FAILURES."""
        if self.has_connection(uri):
            return True
        protocol = ask(uri, "requestTopic", self.resolved_name, [["TCPROS"]])
        if self.closed:  # another one may have its name by now
            return False
        if not protocol or self.has_connection(uri):  # rospy was faster
            return bool(protocol)
        create = get_tcpros_handler().create_transport
        return bool(create(self.resolved_name, uri, protocol)[0] == 1)


@dataclass
class _Lost:
    """A publisher whose connection has ended, or was refused; asked for another at `due`."""

    publisher: str
    due: float
    pauses: int = 0


class _Bounded(_Asking):
    """rospy's side of a subscription, within bounds; a connection that is lost is made anew.

    Its publisher is asked after pauses that grow, until it is gone: it listens no more, or the
    master knows it elsewhere; or says for a minute that it does not offer the topic.
    """

    def __init__(self, name: str, kind: Type[genpy.Message], largest: int) -> None:
        super().__init__(name, kind)
        self._largest = largest
        self._lost: Dict[str, _Lost] = {}  # by URI

    def add_connection(self, transport: Any) -> bool:
        """Called by rospy for every new connection."""
        bound_header(transport)
        bound_messages(transport, self._largest)
        transport.set_cleanup_callback(self._ended)
        return bool(super().add_connection(transport))

    def _ended(self, transport: Any) -> None:
        """Called by rospy, in any thread and with any lock; its next `check` may find it due."""
        lost = _Lost(transport.callerid_pub, time.monotonic() + settings.FIRST_PAUSE_S)
        self._lost.setdefault(transport.endpoint_id, lost)

    def check(self) -> None:
        """Called by rospy every 0.5 s, in a thread that is not to wait."""
        super().check()
        now = time.monotonic()
        for uri, lost in [each for each in list(self._lost.items()) if each[1].due <= now]:
            del self._lost[uri]  # first: what ends from now on is noted anew
            if not self.has_connection(uri):
                self._lost[uri], lost.due = lost, float("inf")
                asking = threading.Thread(target=self._ask, args=(uri, lost), daemon=True)
                try:
                    asking.start()
                except (RuntimeError, MemoryError):
                    lost.due = now  # no thread: at the next look

    def _ask(self, uri: str, lost: _Lost) -> None:
        pause = doubled(settings.FIRST_PAUSE_S, lost.pauses + 1, settings.LONGEST_PAUSE_S)
        gone = self.closed or rospy.is_shutdown()
        try:
            if not gone:
                self.connect(uri)
        except BadAnswer:  # it may be about to register the topic
            gone = pause >= settings.LONGEST_PAUSE_S
        except FAILURES as error:  # who is cut off, or waits for a processor, does not answer
            gone = isinstance(error, ConnectionRefusedError)
            if not gone and lost.publisher != "unknown":  # who has sent no header
                with suppress(*FAILURES):
                    gone = uri_of(lost.publisher) != uri
        finally:  # whatever a strange node answers
            if gone:
                self._lost.pop(uri, None)
            lost.pauses, lost.due = lost.pauses + 1, time.monotonic() + pause


def subscribe(
    topic: str, kind: Type[genpy.Message], heard: Callable[[Any], None], largest: int
) -> rospy.Subscriber:
    """Subscribe; who announces a message of more than `largest` bytes is cut off."""
    name, manager = rospy.resolve_name(topic), get_topic_manager()
    with manager.lock:
        if manager.get_impl(Registration.SUB, name) is None:
            manager._add(_Bounded(name, kind, largest), manager.subs, Registration.SUB)
        return rospy.Subscriber(topic, kind, heard, tcp_nodelay=True)


class HandedOver(_Asking):
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
