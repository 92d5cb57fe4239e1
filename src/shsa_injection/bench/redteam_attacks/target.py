"""The robot as anybody on its computer sees it, and what many attacks share."""
import http.client
import io
import re
import socket
import struct
import threading
import time
import xmlrpc.client
from contextlib import suppress
from typing import Any, Callable, Dict, Set, Tuple

import rosgraph

HEALERS = "/monitor", "/reconfigurator"
GATE = "/gated_gate"
PART = re.compile("/(monitor|reconfigurator|view|gated_gate|substitute_.*)$")
FLOOD_THREADS = 8
ASKED_S = 20.0
LENGTH = struct.Struct("<I")
ERRORS = (OSError, xmlrpc.client.Error, http.client.HTTPException, rosgraph.MasterException)
Try = Callable[[], object]


class Target:
    """The robot, as anybody on its computer sees it."""

    def __init__(self, folder: str, innocent: int) -> None:
        self.folder, self.innocent = folder, innocent
        self.master = rosgraph.Master("/stranger")
        self.uris = {each: str(self.master.lookupNode(each)) for each in HEALERS}
        self.code = f"__import__('os').system('touch {folder}/ran')"

    def healing(self) -> Set[str]:
        """Return where the nodes of healing listen."""
        publishers, _, _ = self.master.getSystemState()
        nodes = {node for _, those in publishers for node in those if PART.match(node)}
        found = set()
        for node in nodes:
            with suppress(*ERRORS):  # it has ended
                found.add(str(self.master.lookupNode(node)))
        return found

    def address(self, node: str) -> Tuple[str, int]:
        """Return where a healer's API listens."""
        return "127.0.0.1", int(self.uris[node].rstrip("/").rsplit(":", 1)[1])

    def data(self, node: str) -> Tuple[str, int]:
        """Return where a healer's topics are to be had; ask again while others attack it."""
        api: Any = xmlrpc.client.ServerProxy(self.uris[node])
        topic = "/shsa/health" if node == "/monitor" else "/shsa/substitutions"
        last = time.monotonic() + ASKED_S
        while True:
            try:
                return "127.0.0.1", int(api.requestTopic("/stranger", topic, [["TCPROS"]])[2][2])
            except ERRORS:
                if time.monotonic() > last:
                    raise
                time.sleep(0.1)


def flood(tries: Callable[[str], Try], end: float, target: Target) -> int:
    """Try as fast as can be, in threads, each against one healer."""
    counts = [0] * FLOOD_THREADS

    def work(number: int) -> None:
        attempt = tries(HEALERS[number % 2])
        while time.monotonic() < end:
            with suppress(*ERRORS):
                attempt()
            counts[number] += 1

    threads = [threading.Thread(target=work, args=(k,), daemon=True) for k in range(FLOOD_THREADS)]
    for each in threads:
        each.start()
    for each in threads:
        each.join(max(0.0, end - time.monotonic()) + 1.0)
    return sum(counts)


def post(at: Tuple[str, int], body: bytes, *headers: str, length: int = -1) -> bytes:
    """Send a call as it is; return the first of the answer."""
    with socket.create_connection(at, 2.0) as connection:
        size = len(body) if length < 0 else length
        lines = ["POST /RPC2 HTTP/1.1", f"Content-Length: {size}", *headers, "", ""]
        connection.sendall("\r\n".join(lines).encode() + body)
        return connection.recv(1000)


def header(fields: Dict[str, str]) -> bytes:
    """Return a connection header."""
    lines = [f"{key}={value}".encode() for key, value in fields.items()]
    written = b"".join(LENGTH.pack(len(line)) + line for line in lines)
    return LENGTH.pack(len(written)) + written


def framed(message: Any) -> bytes:
    """Return a message as it is sent."""
    buffer = io.BytesIO()
    message.serialize(buffer)
    return LENGTH.pack(buffer.tell()) + buffer.getvalue()
