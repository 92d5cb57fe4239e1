"""Bounds what others make of us: no caller holds up the others, fills memory or takes a processor.

Faults of rospy 1.15 to 1.17: it reads the header of a connection in the thread that accepts them
all, so that a silent one keeps every subscriber out (`TCPROSServer`); each connection to its
XML-RPC interface has a thread for good, and may send any length at any pace. Here each connection
has a thread, a deadline and a largest size; where too many are open, the oldest of the caller goes
that has the most; and each caller has one budget of processor time for all that it has us do: a
user of this computer, or an address beyond. A subscriber of a topic that was just withdrawn is told
so; rospy logs an "internal error".
"""
import io
import socket
import threading
from typing import Any, Callable

import rospy
from rosgraph.network import write_ros_handshake_header
from rosgraph.xmlrpc import SilenceableXMLRPCRequestHandler, ThreadingXMLRPCServer
from rospy.impl.masterslave import ROSHandler
from rospy.impl.registration import get_topic_manager
from rospy.impl.tcpros_base import TCPROSServer
from rospy.impl.tcpros_pubsub import QueuedConnection, TCPROSHandler

from shsa_core.errors import ShsaError
from shsa_core.ros import settings
from shsa_core.ros.rospy_patches.callers import USER, Debts, Inbound, Room, Speaker
from shsa_core.ros.rospy_patches.subscribing import read, read_header

Callback = Callable[[Any, socket.socket, Any], None]
_calling = threading.local()
"""Of each thread: `by`, the caller whose call it works on."""


def serve_each_by_itself(speaker: Speaker) -> None:
    """To be called before the node is initialised.

    `speaker` returns the user at the other end; None: that is on another computer. Raises OSError.
    """
    debts = Debts()
    waiting, calls, others = (Room(debts, speaker) for _ in range(3))
    start = _apart(TCPROSServer._tcp_server_callback, others)
    TCPROSServer._tcp_server_callback = _with_room(start, waiting, "MOST_WAITING")
    TCPROSHandler.topic_connection_handler = _unless_withdrawn(
        TCPROSHandler.topic_connection_handler
    )
    ThreadingXMLRPCServer.process_request = _with_room(
        ThreadingXMLRPCServer.process_request, calls, "MOST_API_CONNECTIONS"
    )
    handler = SilenceableXMLRPCRequestHandler
    handler.handle_one_request = _in_turn(handler.handle_one_request)
    handler.do_POST = _up_to(handler.do_POST)
    ROSHandler.shutdown = _of_our_user(ROSHandler.shutdown)
    QueuedConnection.write_data = _as_paid(QueuedConnection.write_data)


def _apart(callback: Callback, others: Room) -> Callback:
    def serve(server: Any, connection: Inbound, address: Any) -> None:
        try:
            header = read_header(connection, settings.PATIENCE_S)
            connection = Inbound(connection, connection.caller, connection.debts, header)
            if connection.caller:
                others.enter(connection, settings.MOST_WAITING)
            callback(server, connection, address)
        except (OSError, ShsaError) as error:
            rospy.logdebug("A connection from %s is given up: %s", address, error)
            connection.close()
        connection.pay()

    def start(*arguments: Any) -> None:
        threading.Thread(target=serve, args=arguments, name="inbound", daemon=True).start()

    return start


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


def _as_paid(write: Callable[[Any, bytes], Any]) -> Callable[[Any, bytes], Any]:
    def written(connection: Any, data: bytes) -> Any:
        to = connection.socket
        if not isinstance(to, Inbound):
            return write(connection, data)
        return to.publish(lambda: write(connection, data))

    return written


def _with_room(serve: Callback, room: Room, most: str) -> Callback:
    """Serve no more at the same time than the setting `most`: who was idle may come again."""

    def accept(server: Any, connection: socket.socket, address: Any) -> None:
        begin = lambda inbound: serve(server, inbound, address)
        room.admit(connection, getattr(settings, most), begin)

    return accept


def _in_turn(handle: Callable[[Any], None]) -> Callable[[Any], None]:
    """Have a call cost its caller; head and body are bounded together."""

    def handled(handler: Any) -> None:
        connection = handler.connection
        _calling.by, connection.left = connection.caller, 2 * settings.LARGEST_CALL_B
        handle(handler)
        connection.pay()

    return handled


def _of_our_user(shut_down: Callable[..., Any]) -> Callable[..., Any]:
    """Let no other user of this computer end us: `rosnode kill` works from other computers."""

    def asked(handler: Any, *arguments: Any) -> Any:
        by = getattr(_calling, "by", "")
        if not by.startswith(USER):
            return shut_down(handler, *arguments)
        rospy.logwarn_throttle(settings.LONGEST_PAUSE_S, f"Refused to shut down for {by}.")
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
            body = read(handler.connection, int(length), came.read1, settings.PATIENCE_S)
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
