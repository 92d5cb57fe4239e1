"""Bounds what others make of us: no caller holds up the others, fills memory or takes a processor.

Faults of rospy 1.15 to 1.17: it reads the header of a connection in the thread that accepts them
all, so that a silent one keeps every subscriber out (`TCPROSServer`); each connection to its
XML-RPC interface has a thread for good, and may send any length at any pace. Here each connection
has a thread, a deadline and a largest size; where too many are open, the oldest of the caller goes
that has the most; and who calls too much waits. A caller is a user of this computer, or an address
beyond. A subscriber of a topic that was just withdrawn is told so; rospy logs an "internal error".
"""
import io
import os
import socket
import threading
import time
from collections import Counter
from contextlib import suppress
from typing import Any, Callable, Dict, Optional, Tuple

import rospy
from rosgraph.network import write_ros_handshake_header
from rosgraph.xmlrpc import SilenceableXMLRPCRequestHandler, ThreadingXMLRPCServer
from rospy.impl.masterslave import ROSHandler
from rospy.impl.registration import get_topic_manager
from rospy.impl.tcpros_base import TCPROSServer
from rospy.impl.tcpros_pubsub import TCPROSHandler

from shsa_core.errors import ShsaError
from shsa_core.ros import settings
from shsa_core.ros.rospy_patches.subscribing import LENGTH

Callback = Callable[[Any, socket.socket, Any], None]
Speaker = Callable[[socket.socket], Optional[int]]
EVERYBODY = ""
USER = "user "
"""The begin of the name of a caller that is another user of this computer."""
_calling = threading.local()
"""Of each thread: `by`, the caller whose call it works on."""


def serve_each_by_itself(speaker: Speaker) -> None:
    """To be called before the node is initialised.

    `speaker` returns the user at the other end; None: that is on another computer. Raises OSError.
    """
    TCPROSServer._tcp_server_callback = _apart(TCPROSServer._tcp_server_callback, speaker)
    TCPROSHandler.topic_connection_handler = _unless_withdrawn(
        TCPROSHandler.topic_connection_handler
    )
    room, debts = _Room(speaker), _Debts()
    calls = SilenceableXMLRPCRequestHandler
    ThreadingXMLRPCServer.process_request = _with_room(
        ThreadingXMLRPCServer.process_request, room, debts
    )
    calls.handle_one_request = _in_turn(calls.handle_one_request, room, debts)
    calls.do_POST = _up_to(calls.do_POST)
    ROSHandler.shutdown = _of_our_user(ROSHandler.shutdown)


class _Room:
    """Connections that are open at the same time, and whose each is."""

    def __init__(self, speaker: Speaker) -> None:
        self._speaker = speaker
        self._open: Dict[socket.socket, str] = {}
        self._lock = threading.Lock()

    def enter(self, connection: socket.socket, most: int) -> None:
        """Have one more, until it is closed or detached.

        Where these are more than `most`, the oldest is ended of the caller that has most of them.
        """
        with self._lock:
            self._open = {each: who for each, who in self._open.items() if each.fileno() >= 0}
            self._open[connection] = self._look(connection)
            if len(self._open) <= most:
                return
            count = Counter(self._open.values())
            oldest = max(self._open, key=lambda each: count[self._open[each]])
            del self._open[oldest]
        with suppress(OSError):  # it may have ended
            oldest.shutdown(socket.SHUT_RDWR)

    def caller(self, connection: socket.socket) -> str:
        """Return the other user, or the address beyond; empty: it is of our own, or of root."""
        return self._open.get(connection, "")

    def _look(self, connection: socket.socket) -> str:
        try:
            user = self._speaker(connection)
            at = connection.getpeername()[0] if user is None else f"{USER}{user}"
        except OSError:
            return "whoever has left"
        return "" if user in (0, os.geteuid()) else str(at)


class _Debts:
    """The processor time in s that callers have had beyond their share. From any thread."""

    def __init__(self) -> None:
        self._debts: Dict[str, Tuple[float, float]] = {}  # and when that was
        self._charged = threading.local()

    def wait(self, caller: str) -> None:
        """Charge a caller with what this thread took since the last time; wait if it is in debt."""
        now, took = time.monotonic(), time.thread_time()
        spent, self._charged.until = took - getattr(self._charged, "until", 0.0), took
        debt, at = self._debts.get(caller, (0.0, now))
        debt = max(0.0, debt - settings.CALLER_SHARE * (now - at)) + spent
        if len(self._debts) >= settings.MOST_API_CONNECTIONS:
            self._debts.clear()
        self._debts[caller] = debt, now
        if debt > settings.CALLER_CREDIT_S:
            time.sleep((debt - settings.CALLER_CREDIT_S) / settings.CALLER_SHARE)


def _apart(callback: Callback, speaker: Speaker) -> Callback:
    room, others, debts = _Room(speaker), _Room(speaker), _Debts()

    def serve(server: Any, connection: socket.socket, address: Any) -> None:
        try:
            header = _read_header(connection)
        except (OSError, ShsaError) as error:
            rospy.logdebug("A connection from %s is given up: %s", address, error)
            connection.close()
            return
        caller = room.caller(connection)
        greeted = _Greeted(connection, header)
        if caller:
            debts.wait(caller)
            others.enter(greeted, settings.MOST_WAITING)
        callback(server, greeted, address)
        if caller:
            debts.wait(caller)

    def accept(server: Any, connection: socket.socket, address: Any) -> None:
        room.enter(connection, settings.MOST_WAITING)
        arguments = server, connection, address
        try:
            threading.Thread(target=serve, args=arguments, name="inbound", daemon=True).start()
        except (RuntimeError, MemoryError):  # no thread is left: whoever asks again may be served
            connection.close()
            raise
        debts.wait(EVERYBODY)

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


def _with_room(process: Callback, room: _Room, debts: _Debts) -> Callback:
    """Calls of a node's API: a client whose idle connection was ended makes another."""

    def accept(server: Any, connection: socket.socket, address: Any) -> None:
        room.enter(connection, settings.MOST_API_CONNECTIONS)
        process(server, connection, address)
        debts.wait(EVERYBODY)

    return accept


def _in_turn(handle: Callable[[Any], None], room: _Room, debts: _Debts) -> Callable[[Any], None]:
    """Have a call wait whose caller calls too much; one of our own user is not held up."""

    def handled(handler: Any) -> None:
        caller = _calling.by = room.caller(handler.connection)
        if caller:
            debts.wait(caller)
        came, handler.rfile = handler.rfile, _Head(handler.rfile)
        try:
            handle(handler)
        finally:
            handler.rfile = came

    return handled


def _of_our_user(shut_down: Callable[..., Any]) -> Callable[..., Any]:
    """Let no other user of this computer end us: `rosnode kill` works from other computers."""

    def asked(handler: Any, *arguments: Any) -> Any:
        by = getattr(_calling, "by", "")
        if not by.startswith(USER):
            return shut_down(handler, *arguments)
        rospy.logwarn_throttle(settings.SAY_AGAIN_S, f"Refused to shut down for {by}.")
        return -1, "only its own user may end it", 0

    return asked


def _up_to(post: Callable[[Any], None]) -> Callable[[Any], None]:
    """Refuse a call that sends too much, or too slowly, or what a parser would make larger."""

    def bounded(handler: Any) -> None:
        length = str(handler.headers.get("content-length", ""))
        is_large = not length.isdigit() or len(length) > 9 or int(length) > settings.LARGEST_CALL_B
        if is_large or handler.headers.get("content-encoding"):
            handler.close_connection = True
            handler.send_error(413)
            return
        came = handler.rfile
        try:
            body = _read(handler.connection, int(length), came.read1)
            handler.connection.settimeout(None)
            if b"<!" in body:
                raise ShsaError("it is no plain XML-RPC")
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


class _Head:
    """Lines of a call's head, LARGEST_CALL_B of them at most; `read1` reads its body."""

    def __init__(self, came: Any) -> None:
        self._came, self.read1 = came, came.read1
        self._left = settings.LARGEST_CALL_B

    def readline(self, most: int) -> bytes:
        """Return the next line, or as much of it as is allowed."""
        line: bytes = self._came.readline(min(most, self._left))
        self._left -= len(line)
        return line


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
