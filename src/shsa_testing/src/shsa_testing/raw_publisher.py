"""A publisher that says of itself what it likes, in its connection header and in its lengths."""
import io
import socket
import socketserver
import struct
import threading
import xmlrpc.client
from typing import Any, Dict, List, Type
from xmlrpc.server import SimpleXMLRPCRequestHandler, SimpleXMLRPCServer

import genpy
import rosgraph

PERIOD_S = 0.02
LENGTH = struct.Struct("<I")

FRAME_B = 1 << 20


class _Quiet(SimpleXMLRPCRequestHandler):
    def log_message(self, format: str, *args: Any) -> None:
        """Say nothing."""


class RawPublisher:
    """Publishes one message over and over to whoever connects, as the node `claim`.

    The master does not know of it before `register`. `sent`: bytes so far. `ended`: a connection
    was closed by whoever had made it.
    """

    def __init__(self, topic: str, claim: str, message: genpy.Message) -> None:
        self.sent, self.ended = 0, False
        self._topic, self._kind = topic, type(message)
        buffer = io.BytesIO()
        message.serialize(buffer)
        self._frame = LENGTH.pack(buffer.tell()) + buffer.getvalue()
        self._header = _header(topic, claim, self._kind)
        self._ends = threading.Event()
        outer = self

        class Handler(socketserver.BaseRequestHandler):
            """One connection."""

            def handle(self) -> None:
                """Send until it is closed."""
                outer._serve(self.request)

        self._data = socketserver.ThreadingTCPServer(("localhost", 0), Handler)
        self._data.daemon_threads = True
        self._api = SimpleXMLRPCServer(
            ("localhost", 0), requestHandler=_Quiet, logRequests=False, allow_none=True
        )
        request: Any = self._request_topic
        self._api.register_function(request, "requestTopic")
        self.uri = f"http://localhost:{self._api.server_address[1]}/"
        for server in (self._data, self._api):
            threading.Thread(target=server.serve_forever, daemon=True).start()

    def claim_length(self, size: int) -> None:
        """Announce one message of `size` bytes, and send as much as is taken."""
        self._header += LENGTH.pack(size)
        self._frame = bytes(FRAME_B)

    def claim_header(self, size: int) -> None:
        """Announce a header of `size` bytes likewise."""
        self._header, self._frame = LENGTH.pack(size), bytes(FRAME_B)

    def register(self, name: str) -> None:
        """Have the master list it under a name."""
        rosgraph.Master(name).registerPublisher(self._topic, self._kind._type, self.uri)

    def unregister(self, name: str) -> None:
        """Have the master forget it."""
        rosgraph.Master(name).unregisterPublisher(self._topic, self.uri)

    def tell(self, subscriber: str) -> None:
        """Tell a subscriber of it, as only the master should."""
        uri = rosgraph.Master("/raw_publisher").lookupNode(subscriber)
        xmlrpc.client.ServerProxy(uri).publisherUpdate("/master", self._topic, [self.uri])

    def close(self) -> None:
        """End it."""
        self._ends.set()
        for server in (self._data, self._api):
            server.shutdown()
            server.server_close()

    def _request_topic(self, caller: str, topic: str, protocols: List[Any]) -> List[Any]:
        return [1, "", ["TCPROS", "localhost", self._data.server_address[1]]]

    def _serve(self, connection: socket.socket) -> None:
        try:
            connection.recv(1 << 20)
            connection.sendall(self._header)
            while not self._ends.wait(0.0 if len(self._frame) >= 1 << 20 else PERIOD_S):
                connection.sendall(self._frame)
                self.sent += len(self._frame)
        except OSError:
            self.ended = True


def _header(topic: str, claim: str, kind: Type[genpy.Message]) -> bytes:
    fields: Dict[str, str] = {
        "topic": topic,
        "type": kind._type,
        "md5sum": kind._md5sum,
        "message_definition": kind._full_text,
        "latching": "0",
        "callerid": claim,
    }
    lines = [f"{key}={value}".encode() for key, value in fields.items()]
    body = b"".join(LENGTH.pack(len(line)) + line for line in lines)
    return LENGTH.pack(len(body)) + body
