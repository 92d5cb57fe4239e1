"""Bounds the connections that others make to us: no caller holds up the others, or fills memory.

Faults of rospy 1.15 to 1.17: it reads the header of a connection in the thread that accepts them
all, so that a silent one keeps every subscriber out (`TCPROSServer`); each connection to its
XML-RPC interface has a thread for good, and may send any length at any pace. Here each connection
has a thread, a deadline and a largest size, and the oldest goes where too many are open. A
subscriber of a topic that was just withdrawn is told so; rospy logs an "internal error".
"""
import io
import socket
import threading
import time
from contextlib import suppress
from typing import Any, Callable, List

import rospy
from rosgraph.network import write_ros_handshake_header
from rosgraph.xmlrpc import SilenceableXMLRPCRequestHandler, ThreadingXMLRPCServer
from rospy.impl.registration import get_topic_manager
from rospy.impl.tcpros_base import TCPROSServer
from rospy.impl.tcpros_pubsub import TCPROSHandler

from shsa_core.errors import ShsaError
from shsa_core.ros import settings
from shsa_core.ros.rospy_patches.subscribing import LENGTH


Callback = Callable[[Any, socket.socket, Any], None]


def serve_each_by_itself() -> None:
    """To be called before the node is initialised."""
    TCPROSServer._tcp_server_callback = _apart(TCPROSServer._tcp_server_callback)
    TCPROSHandler.topic_connection_handler = _unless_withdrawn(
        TCPROSHandler.topic_connection_handler
    )
    ThreadingXMLRPCServer.process_request = _with_room(ThreadingXMLRPCServer.process_request)
    SilenceableXMLRPCRequestHandler.do_POST = _up_to(SilenceableXMLRPCRequestHandler.do_POST)


class _Room:
    """Connections that are open at the same time: with more than `most`, the oldest is ended."""

    def __init__(self) -> None:
        self._open: List[socket.socket] = []
        self._lock = threading.Lock()

    def enter(self, connection: socket.socket, most: int) -> None:
        """Have one more, until it is closed or detached."""
        with self._lock:
            self._open = [each for each in self._open if each.fileno() >= 0] + [connection]
            oldest = self._open.pop(0) if len(self._open) > most else None
        if oldest is not None:
            with suppress(OSError):  # it may have ended
                oldest.shutdown(socket.SHUT_RDWR)


def _apart(callback: Callback) -> Callback:
    room = _Room()

    def serve(server: Any, connection: socket.socket, address: Any) -> None:
        try:
            header = _read_header(connection)
        except (OSError, ShsaError) as error:
            rospy.logdebug("A connection from %s is given up: %s", address, error)
            connection.close()
            return
        callback(server, _Greeted(connection, header), address)

    def accept(server: Any, connection: socket.socket, address: Any) -> None:
        room.enter(connection, settings.MOST_WAITING)
        arguments = server, connection, address
        try:
            threading.Thread(target=serve, args=arguments, name="inbound", daemon=True).start()
        except (RuntimeError, MemoryError):  # no thread is left: whoever asks again may be served
            connection.close()
            raise

    return accept


def _unless_withdrawn(handle: Callable[..., Any]) -> Callable[..., Any]:
    def connected(handler: Any, connection: socket.socket, address: Any, header: Any) -> Any:
        topic = header.get("topic", "")
        publisher = get_topic_manager().get_publisher_impl(topic)
        if publisher is not None and publisher.data_class and not publisher.closed:
            return handle(handler, connection, address, header)
        rospy.logdebug("%s asked for %s, which is withdrawn.", header.get("callerid"), topic)
        write_ros_handshake_header(connection, {"error": f"{topic} is not published here now"})
        connection.close()
        return None

    return connected


def _with_room(process: Callback) -> Callback:
    """Calls of a node's API: a client whose idle connection was ended makes another."""
    room = _Room()

    def accept(server: Any, connection: socket.socket, address: Any) -> None:
        room.enter(connection, settings.MOST_API_CONNECTIONS)
        process(server, connection, address)

    return accept


def _up_to(post: Callable[[Any], None]) -> Callable[[Any], None]:
    """Refuse a call that sends too much, or too slowly."""

    def bounded(handler: Any) -> None:
        length = str(handler.headers.get("content-length", ""))
        if not length.isdigit() or len(length) > 9 or int(length) > settings.LARGEST_CALL_B:
            handler.close_connection = True
            handler.send_error(413)
            return
        came = handler.rfile
        try:
            body = _read(handler.connection, int(length), came.read1)
            handler.connection.settimeout(None)
        except (OSError, ShsaError) as error:
            rospy.logdebug("A call is given up: %s", error)
            handler.close_connection = True
            return
        handler.rfile = io.BytesIO(body)
        try:
            post(handler)
        finally:
            handler.rfile = came

    return bounded


class _Greeted(socket.socket):
    """A connection whose header was read, and is given first."""

    def __init__(self, connection: socket.socket, header: bytes) -> None:
        super().__init__(fileno=connection.detach())
        self._header = header

    def recv(self, size: int, flags: int = 0) -> bytes:
        """Return what comes next."""
        given, self._header = self._header[:size], self._header[size:]
        return given or super().recv(size, flags)


def _read_header(connection: socket.socket) -> bytes:
    """Return the header with its length, and no byte more. Raises OSError, ShsaError."""
    end = time.monotonic() + settings.PATIENCE_S
    length = _read(connection, LENGTH.size, connection.recv, end)
    (size,) = LENGTH.unpack(length)
    if size > settings.LARGEST_HEADER_B:
        raise ShsaError(f"a header of {size} bytes; {settings.LARGEST_HEADER_B} are allowed")
    header = length + _read(connection, size, connection.recv, end)
    connection.settimeout(None)
    return header


def _read(
    connection: socket.socket, size: int, read: Callable[[int], bytes], end: float = 0.0
) -> bytes:
    """Read so many bytes until `end`, or for as long as a header may take."""
    end = end or time.monotonic() + settings.PATIENCE_S
    data = b""
    while len(data) < size:
        connection.settimeout(max(1e-3, end - time.monotonic()))
        came = read(size - len(data))
        if not came:
            raise ShsaError("it ended before all had come")
        data += came
        if time.monotonic() > end:
            raise ShsaError("it takes too long")
    return data
