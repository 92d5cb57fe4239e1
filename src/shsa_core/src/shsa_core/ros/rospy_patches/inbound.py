"""Bounds what others make of us: no caller holds up the others, fills memory or takes a processor.

Faults of rospy 1.15 to 1.17: it reads the header of a connection in the thread that accepts them
all, so that a silent one keeps every subscriber out (`TCPROSServer`); each connection to its
XML-RPC interface has a thread for good, and may send any length at any pace. Here each connection
has a thread, a deadline and a largest size; where too many are open, the oldest of the caller goes
that has the most; and each caller, another user of this computer or an address beyond, has one
budget of processor time for all that it has us do. A subscriber of a topic that was just withdrawn
is told so; rospy logs an "internal error".
"""
import io
import os
import re
import socket
import threading
import time
from collections import Counter
from contextlib import suppress
from functools import partialmethod
from typing import Any, Callable, Dict, Optional, Tuple

import rosgraph
import rospy
from rosgraph.network import write_ros_handshake_header
from rosgraph.xmlrpc import SilenceableXMLRPCRequestHandler, ThreadingXMLRPCServer
from rospy.impl.masterslave import ROSHandler
from rospy.impl.registration import get_topic_manager
from rospy.impl.tcpros_base import TCPROSServer
from rospy.impl.tcpros_pubsub import QueuedConnection, TCPROSHandler

from shsa_core.errors import ShsaError
from shsa_core.ros import settings
from shsa_core.ros.master.node_api import FAILURES, resolved
from shsa_core.ros.rospy_patches.subscribing import read, read_header

Speaker = Callable[[socket.socket], Optional[int]]
Callback = Callable[[Any, socket.socket, Any], None]
EVERYBODY = "everybody"
ESTABLISHED = b"\1"
_MEANT = re.compile(r"\[(/[^]]*)\] Reason: new node registered with same name")
USER = "user "
"""The begin of the name of a caller that is another user of this computer."""
_charged = threading.local()
"""Of each thread: `until`, the time of its own that was charged."""
_calling = threading.local()
"""Of each thread: `by`, the caller whose call it works on."""


def charge_also(spent: float) -> None:
    """Charge who is served by this thread for the time in s that another took for it."""
    _charged.until = getattr(_charged, "until", 0.0) - spent


class Debts:
    """The processor time in s that callers have had beyond their share; `free` owes nothing."""

    def __init__(self, free: str = "") -> None:
        self._free = free
        self._debts: Dict[str, Tuple[float, float]] = {}  # and when that was

    def wait(self, caller: str, at_once: bool = False) -> None:
        """Charge a caller for this thread's time since; it waits if in debt, unless `at_once`."""
        took = time.thread_time()
        spent, _charged.until = took - getattr(_charged, "until", 0.0), took
        seconds = self.owed(caller, spent) if caller else 0.0
        if seconds and not at_once:
            time.sleep(seconds)

    def owed(self, caller: str, spent: float = 0.0) -> float:
        """Return how long a caller waits that has had so much more."""
        if caller == self._free:
            return 0.0
        now = time.monotonic()
        debt, at = self._debts.get(caller, (0.0, now))
        debt = max(0.0, debt - settings.CALLER_SHARE * (now - at)) + spent
        if len(self._debts) >= settings.MOST_API_CONNECTIONS:  # who has many names clears no debt
            self._debts.pop(min(list(self._debts.items()), key=lambda each: each[1])[0], None)
        self._debts[caller] = debt, now
        return max(0.0, debt - settings.CALLER_CREDIT_S) / settings.CALLER_SHARE


class Inbound(socket.socket):
    """A connection to us: a `caller` in debt waits wherever its thread would read or write on.

    `given` is read first. Of what comes to a buffer, `left` bytes are read; then it ends.
    """

    left = 0

    def __init__(
        self, connection: socket.socket, caller: str, debts: Debts, given: bytes = b""
    ) -> None:
        super().__init__(fileno=connection.detach())
        self.caller, self.debts, self._given = caller, debts, given

    def recv(self, size: int, flags: int = 0) -> bytes:
        """Return what comes next."""
        given, self._given = self._given[:size], self._given[size:]
        if not given:
            self.debts.wait(self.caller)
        return given or super().recv(size, flags)

    def recv_into(self, *arguments: Any) -> int:
        """Read what comes next."""
        self.debts.wait(self.caller)
        count = super().recv_into(*arguments) if self.left > 0 else 0
        self.left -= count
        return count

    def publish(self, write: Callable[[], Any]) -> Any:
        """Write a message unless who gets it is in debt. Raises OSError if it owes too much."""
        if not self.caller.startswith(USER):
            return write()
        began, owed = time.thread_time(), self.debts.owed(self.caller)
        if owed > settings.PATIENCE_S:
            raise ConnectionAbortedError(f"{self.caller} has us do too much")
        try:
            return True if owed else write()  # it misses this one: nobody else waits for it
        finally:
            self.debts.owed(self.caller, time.thread_time() - began)

    def sendall(self, *arguments: Any) -> None:
        """Write; a subscriber of another user of this computer pays for each message, and waits."""
        if self.caller.startswith(USER):
            self.debts.wait(self.caller)
        super().sendall(*arguments)


class Room:
    """Connections that are open at the same time, and whose each is."""

    def __init__(self, debts: Debts, speaker: Speaker) -> None:
        self._debts, self._speaker = debts, speaker
        self._open: Dict[Inbound, None] = {}  # in the order in which they came
        self._lock = threading.Lock()

    def admit(self, connection: socket.socket, most: int, serve: Callable[[Inbound], None]) -> None:
        """Serve one more, unless its caller owes too much; others pay together for that."""
        caller = self._look(connection)
        try:
            if caller and self._debts.owed(caller) > settings.PATIENCE_S:
                connection.close()
                return
            inbound = Inbound(connection, caller, self._debts)
            self.enter(inbound, most)
            serve(inbound)
        except (RuntimeError, MemoryError):  # no thread is left: whoever asks again may be served
            inbound.close()
            raise
        finally:
            self._debts.wait(EVERYBODY if caller else "")

    def enter(self, connection: Inbound, most: int) -> None:
        """Have one more; beyond `most` the oldest is ended of the caller that has most of them."""
        with self._lock:
            self._open = {each: None for each in self._open if each.fileno() >= 0}
            self._open[connection] = None
            if len(self._open) <= most:
                return
            count = Counter(each.caller for each in self._open)
            oldest = max(self._open, key=lambda each: count[each.caller])
            del self._open[oldest]
        with suppress(OSError):  # it may have ended
            oldest.shutdown(socket.SHUT_RDWR)

    def _look(self, connection: socket.socket) -> str:
        """Return who calls; empty: our own user, or root."""
        try:
            user = self._speaker(connection)
            at = connection.getpeername()[0] if user is None else f"{USER}{user}"
        except OSError:
            return "a caller that has left"
        return "" if user in (0, os.geteuid()) else str(at)


def serve_each_by_itself(speaker: Speaker) -> None:
    """To be called before the node is initialised; `speaker` is that of `trust/owners`."""
    debts = Debts(_master_host())
    waiting, calls, others = (Room(debts, speaker) for _ in range(3))
    start = _apart(TCPROSServer._tcp_server_callback, others)
    TCPROSServer._tcp_server_callback = partialmethod(_with_room, start, waiting, "MOST_WAITING")
    topics, api = TCPROSHandler, ThreadingXMLRPCServer
    topics.topic_connection_handler = partialmethod(
        _unless_withdrawn, topics.topic_connection_handler
    )
    api.process_request = partialmethod(
        _with_room, api.process_request, calls, "MOST_API_CONNECTIONS"
    )
    handler = SilenceableXMLRPCRequestHandler
    handler.handle_one_request = partialmethod(_in_turn, handler.handle_one_request)
    handler.do_POST = partialmethod(_up_to, handler.do_POST)
    ROSHandler.shutdown = partialmethod(only_if_meant, ROSHandler.shutdown)
    QueuedConnection.write_data = partialmethod(_as_paid, QueuedConnection.write_data)


def _master_host() -> str:
    with suppress(*FAILURES):
        return resolved(rosgraph.get_master_uri()).host
    return ""


def _apart(callback: Callback, others: Room) -> Callback:
    def serve(server: Any, connection: Inbound, address: Any) -> None:
        try:
            header = read_header(connection, settings.PATIENCE_S)
            if connection.getsockopt(socket.IPPROTO_TCP, socket.TCP_INFO, 1) != ESTABLISHED:
                raise OSError("it has left")  # rospy would drop its next one, which came before
            connection = Inbound(connection, connection.caller, connection.debts, header)
            if connection.caller:
                topics = len(get_topic_manager().pubs)
                most = settings.MOST_WAITING + settings.CONSUMERS_A_TOPIC * topics
                others.enter(connection, most)
            callback(server, connection, address)
        except (OSError, ShsaError) as error:
            rospy.logdebug("A connection from %s is given up: %s", address, error)
            connection.close()
        connection.debts.wait(connection.caller, at_once=True)

    def start(*arguments: Any) -> None:
        threading.Thread(target=serve, args=arguments, name="inbound", daemon=True).start()

    return start


def _unless_withdrawn(
    handler: Any, handle: Callable[..., Any], connection: socket.socket, address: Any, header: Any
) -> Any:
    topic = header.get("topic", "")
    publisher = get_topic_manager().get_publisher_impl(topic)
    if publisher is not None and publisher.data_class and not publisher.closed:
        return handle(handler, connection, address, header)
    rospy.logdebug("%s asked for %s, which is withdrawn.", header.get("callerid"), topic)
    write_ros_handshake_header(connection, {"error": f"{topic} is not published here now"})
    connection.close()
    return None


def _as_paid(connection: Any, write: Callable[[Any, bytes], Any], data: bytes) -> Any:
    to, work = connection.socket, lambda: write(connection, data)
    return to.publish(work) if isinstance(to, Inbound) else work()


def _with_room(
    server: Any, serve: Callback, room: Room, most: str, connection: socket.socket, address: Any
) -> None:
    room.admit(connection, getattr(settings, most), lambda each: serve(server, each, address))


def _in_turn(handler: Any, handle: Callable[[Any], None]) -> None:
    connection = handler.connection
    _calling.by = connection.caller
    connection.left = 2 * settings.LARGEST_CALL_B  # for head and body together
    handle(handler)
    connection.debts.wait(connection.caller, at_once=True)


def only_if_meant(handler: Any, shut_down: Callable[..., Any], *arguments: Any) -> Any:
    """End for no other user of this computer, nor in place of whoever had our address before."""
    by, meant = getattr(_calling, "by", ""), _MEANT.search(str(arguments[1:]))
    if meant and meant.group(1) != rospy.get_name():
        by = f"{meant.group(1)}, whose address this was"
    elif not by.startswith(USER):
        return shut_down(handler, *arguments)
    rospy.logwarn_throttle(settings.LONGEST_PAUSE_S, f"Refused to shut down for {by}.")
    return -1, "only its own user may end it", 0


def _up_to(handler: Any, post: Callable[[Any], None]) -> None:
    """Refuse a call that sends too much, or too slowly, or what a parser would make larger."""
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
