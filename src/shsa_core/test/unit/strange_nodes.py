"""Nodes that answer XML-RPC as nobody should: real sockets, each with answers of its own."""
import functools
import gzip
import io
import socket
import threading
import time
import xmlrpc.client
from contextlib import suppress
from typing import Any, Callable, Dict, Optional

HOST = "127.0.0.1"
HEADER = "HTTP/1.0 200 OK\r\nContent-Type: text/xml\r\n{}\r\n"
LAUGHS = (
    '<?xml version="1.0"?><!DOCTYPE l [<!ENTITY a "lol">'
    + "".join(f'<!ENTITY {b} "{("&" + a + ";") * 10}">' for a, b in zip("abcdefgh", "bcdefghi"))
    + "]><methodResponse><params><param><value><string>&i;</string></value></param></params>"
    "</methodResponse>"
)

Send = Callable[[socket.socket], None]


def body(value: Any) -> str:
    return xmlrpc.client.dumps((value,), methodresponse=True, allow_none=True)


def raw(text: str, more: str = "") -> Send:
    """An answer of a certain text."""

    def send(caller: socket.socket) -> None:
        caller.sendall(HEADER.format(more).encode() + text.encode())

    return send


def value(answer: Any) -> Send:
    return raw(body(answer))


def drip(caller: socket.socket) -> None:
    """A byte each 0.3 s, for ever."""
    for letter in HEADER.format("") + body([1, "", 4]) * 100:
        caller.sendall(letter.encode())
        time.sleep(0.3)


def endless(caller: socket.socket) -> None:
    caller.sendall(HEADER.format("Content-Length: 4000000000\r\n").encode())
    while True:
        caller.sendall(b" " * 65536)


@functools.lru_cache(maxsize=None)
def bomb() -> bytes:
    """An answer of 300 MB in 300 kB; takes a second to make."""
    head, tail = body([1, "", "x"]).encode().split(b"x<")
    file = io.BytesIO()
    with gzip.GzipFile(fileobj=file, mode="w") as packed:
        packed.write(head)
        for _ in range(300):
            packed.write(b"x" * 1_000_000)
        packed.write(b"x<" + tail)
    return file.getvalue()


def zipped(caller: socket.socket) -> None:
    caller.sendall(HEADER.format("Content-Encoding: gzip\r\n").encode() + bomb())


def nothing(caller: socket.socket) -> None:
    """The connection stands, and nothing comes."""
    caller.recv(10)
    time.sleep(60.0)


NONSENSE: Dict[str, Send] = {
    "a text": value([1, "", "not a number"]),
    "a negative number": value([1, "", -1]),
    "a huge number": value([1, "", 2**31 - 1]),
    "a truth": value([1, "", True]),
    "a real number": value([1, "", 4.5]),
    "a struct": value([1, "", {"pid": 1}]),
    "no triple": value([1, ""]),
    "no list": value("hello"),
    "a nested list": value([1, "", [[[[]]]]]),
    "nothing at all": value(None),
    "a failure": value([-1, "no", 0]),
    "a fault": raw(xmlrpc.client.dumps(xmlrpc.client.Fault(1, "no"))),
    "a number that is none": raw(body([1, "", 4]).replace(">4<", ">four<")),
    "no XML": raw("<<<>>>&&&"),
    "no XML-RPC": raw("<html><body>It works!</body></html>"),
    "half an answer": raw(body([1, "", 4])[:60]),
    "no HTTP": lambda caller: caller.sendall(b"\x00\xff" * 500),
    "a name that grows": raw(LAUGHS),
    "end": lambda caller: None,
}
"""Answers to getPid, each of another kind."""


class StrangeNode:
    """Answers each method as it is told, `otherwise` to all others."""

    def __init__(self, otherwise: Send, port: int = 0, host: str = HOST, **methods: Send) -> None:
        self.calls: Dict[str, int] = {}
        self._methods, self._otherwise = methods, otherwise
        family = socket.AF_INET6 if ":" in host else socket.AF_INET
        self._socket = socket.create_server((host, port), family=family)
        self.port = self._socket.getsockname()[1]
        self.uri = f"http://{HOST}:{self.port}/"
        threading.Thread(target=self._accept, daemon=True).start()

    def tells(self, **methods: Send) -> None:
        """Answer these methods otherwise from now on."""
        self._methods.update(methods)

    def end(self) -> None:
        """Listen no more."""
        self._socket.close()

    def _accept(self) -> None:
        while True:
            try:
                caller, _ = self._socket.accept()
            except OSError:
                return
            threading.Thread(target=self._answer, args=(caller,), daemon=True).start()

    def _answer(self, caller: socket.socket) -> None:
        with caller, suppress(OSError):  # the caller may have gone
            method = self._method(caller)
            if method is not None:
                self.calls[method] = self.calls.get(method, 0) + 1
                self._methods.get(method, self._otherwise)(caller)

    @staticmethod
    def _method(caller: socket.socket) -> Optional[str]:
        data = b""
        while b"</methodCall>" not in data:
            received = caller.recv(65536)
            if not received:
                return None
            data += received
        return xmlrpc.client.loads(data[data.index(b"<?xml") :].decode())[1]
