"""Connections that say nothing, and calls that cost much: real sockets, rospy's own servers."""
import gzip
import itertools
import os
import socket
import struct
import subprocess
import sys
import threading
import xmlrpc.client
from contextlib import suppress
from functools import partialmethod
from types import SimpleNamespace
from typing import Any, Dict, Iterator, List, Tuple

import pytest
import rospy
from rosgraph.xmlrpc import SilenceableXMLRPCRequestHandler, ThreadingXMLRPCServer
from rospy.impl.masterslave import ROSHandler
from rospy.impl.tcpros_base import TCPROSServer, TCPROSTransport
from rospy.impl.tcpros_pubsub import QueuedConnection, TCPROSHandler, TCPROSPub
from std_msgs.msg import String

from shsa_core.ros import settings
from shsa_core.ros.rospy_patches import inbound
from shsa_core.ros.trust.owners import speaker
from shsa_testing.waiting import wait_until

HEADER = b"\x0a\x00\x00\x00topic=/abc"
WHOLE = struct.pack("<I", len(HEADER)) + HEADER


class Server:
    """A TCPROS server that keeps the topics it was asked for, and what its sockets then read."""

    def __init__(self) -> None:
        self.headers: List[Dict[str, str]] = []
        self.read: List[bytes] = []
        self.server = TCPROSServer()
        self.server.topic_connection_handler = self._connected
        self.server.start_server()

    def _connected(self, connection: socket.socket, _: Any, header: Dict[str, str]) -> None:
        self.headers.append(header)
        if header["topic"] == "/abc":
            read = lambda: self.read.append(connection.recv(100))
            threading.Thread(target=read, daemon=True).start()

    def connect(self) -> socket.socket:
        """A new connection."""
        connection = socket.create_connection(("127.0.0.1", self.server.get_address()[1]), 10.0)
        connection.settimeout(20.0)
        return connection


@pytest.fixture
def server(monkeypatch: pytest.MonkeyPatch) -> Iterator[Server]:
    rooms = [inbound.Room(inbound.Debts(), speaker) for _ in range(2)]
    callback = TCPROSServer._tcp_server_callback
    monkeypatch.setattr(
        TCPROSServer,
        "_tcp_server_callback",
        partialmethod(
            inbound._with_room, inbound._apart(callback, rooms[0]), rooms[1], "MOST_WAITING"
        ),
    )
    found = Server()
    yield found
    found.server.shutdown()


def test_who_says_nothing_keeps_nobody_out(server: Server) -> None:
    silent = [server.connect() for _ in range(5)]
    client = server.connect()
    client.sendall(WHOLE)
    wait_until(lambda: server.headers, 1.5, "the one who speaks is served")
    assert server.headers[0]["topic"] == "/abc"
    client.sendall(b"and more")
    wait_until(lambda: server.read == [b"and more"], 5.0, "what comes after the header")
    assert all(each.recv(1) == b"" for each in silent)  # given up after a while


def test_a_header_may_come_byte_by_byte_but_not_for_ever(
    server: Server, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(settings, "PATIENCE_S", 10.0)
    client = server.connect()
    for each in WHOLE:
        client.sendall(bytes([each]))
    wait_until(lambda: server.headers, 5.0, "it is served")
    monkeypatch.setattr(settings, "PATIENCE_S", 0.2)
    slow = server.connect()
    slow.sendall(WHOLE[:5])
    assert slow.recv(1) == b""
    assert len(server.headers) == 1


def test_a_header_that_is_too_long_is_not_read(server: Server) -> None:
    client = server.connect()
    client.sendall(struct.pack("<I", 0xFFFFFFFF))
    assert client.recv(1) == b""


def test_the_oldest_goes_where_too_many_wait(
    server: Server, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(settings, "PATIENCE_S", 60.0)
    monkeypatch.setattr(settings, "MOST_WAITING", 3)
    silent = [server.connect() for _ in range(5)]
    assert all(each.recv(1) == b"" for each in silent[:2])
    client = server.connect()
    client.sendall(WHOLE)
    wait_until(lambda: server.headers, 5.0, "the one who speaks is served")
    for each in silent:
        each.close()


def test_who_comes_for_a_withdrawn_topic_is_told_and_nobody_is_warned() -> None:
    def handle(*_: Any) -> str:
        return "Internal error"

    ours, theirs = socket.socketpair()
    header = {"topic": "/withdrawn", "callerid": "/consumer", "md5sum": "*"}
    assert inbound._unless_withdrawn(None, handle, ours, "", header) is None
    assert b"/withdrawn is not published here now" in theirs.recv(1000)
    theirs.close()


@pytest.fixture
def api(monkeypatch: pytest.MonkeyPatch) -> Iterator[Tuple[str, int]]:
    for kind, name in (
        (TCPROSServer, "_tcp_server_callback"),
        (TCPROSHandler, "topic_connection_handler"),
        (ThreadingXMLRPCServer, "process_request"),
        (SilenceableXMLRPCRequestHandler, "do_POST"),
        (SilenceableXMLRPCRequestHandler, "handle_one_request"),
        (ROSHandler, "shutdown"),
        (QueuedConnection, "write_data"),
    ):
        monkeypatch.setattr(kind, name, getattr(kind, name))
    monkeypatch.setattr(ROSHandler, "shutdown", lambda *_: (1, "it is done", 0))
    inbound.serve_each_by_itself(speaker)
    server = ThreadingXMLRPCServer(("127.0.0.1", 0), 0)
    server.register_function(lambda text: text, "echo")
    shut_down = lambda by="/somebody", why="why": ROSHandler.shutdown(None, by, why)
    server.register_function(shut_down, "shutdown")
    threading.Thread(target=server.serve_forever, daemon=True).start()
    yield server.server_address
    server.shutdown()
    server.server_close()


def test_silent_calls_do_not_pile_up(api: Tuple[str, int], monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(settings, "MOST_API_CONNECTIONS", 5)
    before = threading.active_count()
    proxy = xmlrpc.client.ServerProxy(f"http://127.0.0.1:{api[1]}")
    assert proxy.echo("x") == "x"
    silent = [socket.create_connection(api, 10.0) for _ in range(30)]
    for each in silent[:25]:
        each.settimeout(10.0)
        assert each.recv(1) == b""
    wait_until(lambda: threading.active_count() <= before + 6, 10.0, "their threads end")
    assert proxy.echo("y" * 50_000) == "y" * 50_000  # its own connection was ended as well
    for each in silent:
        each.close()


@pytest.mark.parametrize("length", ("65537", "9999999999999", "-1", "x"))
def test_a_call_that_is_too_long_is_not_read(api: Tuple[str, int], length: str) -> None:
    with socket.create_connection(api, 10.0) as client:
        client.sendall(f"POST /RPC2 HTTP/1.1\r\nContent-Length: {length}\r\n\r\n".encode())
        assert b" 413 " in client.recv(1000)


def test_the_body_of_a_call_has_a_deadline(
    api: Tuple[str, int], monkeypatch: pytest.MonkeyPatch
) -> None:
    body = xmlrpc.client.dumps(("x" * 30_000,), "echo").encode()
    head = f"POST /RPC2 HTTP/1.1\r\nContent-Length: {len(body)}\r\n\r\n".encode()
    with socket.create_connection(api, 10.0) as client:
        for _ in range(2):  # by one connection
            client.sendall(head + body[:20_000])
            client.sendall(body[20_000:])
            answer = b""
            while b"</methodResponse>" not in answer:
                answer += client.recv(100_000)
            assert b" 200 " in answer
        monkeypatch.setattr(settings, "PATIENCE_S", 0.2)
        client.sendall(head + body[:20_000])
        assert client.recv(1) == b""


def test_nothing_grows_when_it_is_read(api: Tuple[str, int]) -> None:
    body = gzip.compress(xmlrpc.client.dumps(("x" * 1_000_000,), "echo").encode())
    entity = (
        b'<!DOCTYPE x [<!ENTITY a "aaa">]><methodCall><methodName>echo</methodName></methodCall>'
    )
    for head, sent in (("Content-Encoding: gzip\r\n", body), ("", entity)):
        with socket.create_connection(api, 10.0) as client:
            post = f"POST /RPC2 HTTP/1.1\r\n{head}Content-Length: {len(sent)}\r\n\r\n"
            client.sendall(post.encode() + sent)
            assert b" 200 " not in client.recv(1000)


def test_the_head_of_a_call_has_an_end(api: Tuple[str, int]) -> None:
    with socket.create_connection(api, 10.0) as client:
        lines = "".join(f"X-{k}: {'x' * 30_000}\r\n" for k in range(5))
        body = xmlrpc.client.dumps(("x",), "echo")
        head = f"POST /RPC2 HTTP/1.1\r\nContent-Length: {len(body)}\r\n{lines}\r\n"
        try:
            client.sendall((head + body).encode())
            assert b"<string>x</string>" not in client.recv(100_000)
        except ConnectionError:
            return  # it was given up while more came


STRANGERS = 4002
STRANGER = """
import socket, sys, time, xmlrpc.client
port, what = int(sys.argv[1]), sys.argv[2]
proxy = xmlrpc.client.ServerProxy(f"http://127.0.0.1:{port}")
if what == "shutdown":
    print(proxy.shutdown())
if what == "silent":
    silent = [socket.create_connection(("127.0.0.1", port)) for _ in range(30)]
    print("ready", flush=True)
    time.sleep(60.0)
"""


def stranger(api: Tuple[str, int], what: str) -> "subprocess.Popen[str]":
    if os.geteuid() != 0:
        pytest.skip("only root starts processes of others")
    words = ["setpriv", "--reuid=nobody", "--clear-groups", sys.executable, "-c", STRANGER]
    command = [*words, str(api[1]), what]
    return subprocess.Popen(command, stdout=subprocess.PIPE, universal_newlines=True)


def test_only_our_own_user_ends_us(api: Tuple[str, int], monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(rospy.rostime, "_rostime_initialized", True)
    answer: Any = xmlrpc.client.ServerProxy(f"http://127.0.0.1:{api[1]}").shutdown()
    assert answer[0] == 1
    assert "-1, 'only its own user may end it'" in stranger(api, "shutdown").communicate()[0]


def test_a_master_that_means_whoever_had_our_address_before_does_not_end_us(
    api: Tuple[str, int], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(rospy.rostime, "_rostime_initialized", True)
    told: List[str] = []
    done: Any = partialmethod(inbound.only_if_meant, lambda *words: told.append(words[2]))
    monkeypatch.setattr(ROSHandler, "shutdown", done)
    proxy = xmlrpc.client.ServerProxy(f"http://127.0.0.1:{api[1]}")
    for name in ("/before", rospy.get_name()):
        with suppress(xmlrpc.client.Fault):  # None is no answer
            proxy.shutdown("/master", f"[{name}] Reason: new node registered with same name")
    assert told == [f"[{rospy.get_name()}] Reason: new node registered with same name"]


def test_who_has_most_connections_loses_one(
    api: Tuple[str, int], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(settings, "MOST_API_CONNECTIONS", 12)
    ours = [socket.create_connection(api, 10.0) for _ in range(4)]
    flood = stranger(api, "silent")
    assert flood.stdout is not None and flood.stdout.readline() == "ready\n"
    assert xmlrpc.client.ServerProxy(f"http://127.0.0.1:{api[1]}").echo("x") == "x"
    for each in ours:
        each.setblocking(False)
        with pytest.raises(BlockingIOError):  # the oldest of all, and still there
            each.recv(1)
        each.close()
    flood.kill()
    flood.communicate()


def test_who_calls_too_much_waits_and_nobody_else(monkeypatch: pytest.MonkeyPatch) -> None:
    now, used = [0.0], [0.0]
    waits: List[float] = []
    clock = SimpleNamespace(
        monotonic=lambda: now[0], thread_time=lambda: used[0], sleep=waits.append
    )
    monkeypatch.setattr(inbound, "time", clock)
    monkeypatch.setattr(settings, "CALLER_CREDIT_S", 0.5)
    monkeypatch.setattr(settings, "CALLER_SHARE", 0.1)
    monkeypatch.setattr(inbound, "_charged", threading.local())
    debts = inbound.Debts()
    for caller, spent, told in (
        ("a", 0.5, []),
        ("a", 0.2, [2.0]),
        ("b", 0.1, []),
        ("a", 0.0, [2.0]),
    ):
        used[0] += spent
        debts.wait(caller)
        assert waits == pytest.approx(told), caller
        waits.clear()
    now[0] += 2.0
    debts.wait("a")
    assert waits == []


def test_a_caller_has_one_budget_for_all_that_it_has_us_do(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    debts = inbound.Debts()
    rooms = [inbound.Room(debts, lambda _: STRANGERS) for _ in range(2)]
    monkeypatch.setattr(settings, "CALLER_SHARE", 1e-6)
    monkeypatch.setattr(settings, "CALLER_CREDIT_S", 5.0)
    debts.wait("")
    call, subscribe = socket.socketpair(), socket.socketpair()
    served: List[inbound.Inbound] = []
    rooms[0].admit(call[0], 10, served.append)
    assert [each.caller for each in served] == [f"user {STRANGERS}"]
    inbound.charge_also(6.0)  # as for a service's answer, which another thread finds
    served[0].debts.wait(served[0].caller, at_once=True)
    rooms[1].admit(subscribe[0], 10, served.append)
    assert len(served) == 1 and subscribe[1].recv(1) == b""  # refused, before anything is read
    for each in (call[1], subscribe[1], *served):
        each.close()


def test_the_master_elsewhere_waits_for_nothing(monkeypatch: pytest.MonkeyPatch) -> None:
    """It has three threads to tell nodes of publishers, and each waits for an answer."""
    monkeypatch.setenv("ROS_MASTER_URI", "http://192.168.0.1:11311")
    debts = inbound.Debts(inbound._master_host())
    assert debts.owed("192.168.0.1", 1000.0) == 0.0 < debts.owed("192.168.0.2", 1000.0)
    monkeypatch.setenv("ROS_MASTER_URI", "http://no such host:11311")
    assert inbound._master_host() == ""


def test_who_has_many_addresses_clears_no_debt() -> None:
    debts = inbound.Debts()
    debts.owed("10.0.0.1", 100.0)
    for number in range(2 * settings.MOST_API_CONNECTIONS):
        debts.owed(f"10.0.1.{number}", 1e-6)
    assert debts.owed("10.0.0.1") > 0.0


def test_another_user_pays_for_what_it_subscribes_to(monkeypatch: pytest.MonkeyPatch) -> None:
    """A hundred of its subscribers cost a gate a third of a processor; computers rely on it."""
    used, waits = [0.0], []  # type: List[float], List[float]
    clock = SimpleNamespace(monotonic=lambda: 0.0, thread_time=lambda: used[0], sleep=waits.append)
    monkeypatch.setattr(inbound, "time", clock)
    monkeypatch.setattr(inbound, "_charged", threading.local())
    debts = inbound.Debts()
    for caller, waits_then in (("", False), ("10.0.0.2", False), (f"user {STRANGERS}", True)):
        ours, theirs = socket.socketpair()
        connection = inbound.Inbound(ours, caller, debts)
        for _ in range(200):
            used[0] += 0.01
            connection.sendall(b"message")
        assert bool(waits) is waits_then, caller
        connection.close()
        theirs.close()


class Subscriber:
    """A connection of rospy's to a subscriber that somebody has."""

    def __init__(self, caller: str, debts: inbound.Debts) -> None:
        ours, self._theirs = socket.socketpair()
        transport = TCPROSTransport(TCPROSPub("/topic", String), "/topic")
        transport.set_socket(inbound.Inbound(ours, caller, debts), "/consumer")
        self.connection = QueuedConnection(transport, settings.CONSUMER_QUEUE)
        self._theirs.settimeout(10.0)

    def heard(self, last: bytes) -> bytes:
        """Return what has come, up to the last message."""
        data = b""
        while not data.endswith(last):
            data += self._theirs.recv(100)
        return data

    def close(self) -> None:
        """End it."""
        self.connection.close()
        self._theirs.close()


def test_another_user_in_debt_misses_messages_and_nobody_else_does(
    api: Tuple[str, int], monkeypatch: pytest.MonkeyPatch
) -> None:
    """To hand 50 messages a second to each of its 100 subscribers cost a gate 10 %."""
    now, used, waits = [0.0], itertools.count(), []  # type: List[float], Any, List[float]
    monkeypatch.setattr(
        inbound,
        "time",
        SimpleNamespace(
            monotonic=lambda: now[0], thread_time=lambda: 1e-3 * next(used), sleep=waits.append
        ),
    )
    debts, user = inbound.Debts(), f"user {STRANGERS}"
    subscribers = {caller: Subscriber(caller, debts) for caller in ("", "10.0.0.2", user)}
    debts.owed(user, settings.CALLER_CREDIT_S + settings.CALLER_SHARE)
    for at, said in ((0.0, b"first"), (10.0, b"second")):
        now[0] = at
        for each in subscribers.values():
            each.connection.write_data(said)
    heard = {caller: each.heard(b"second") for caller, each in subscribers.items()}
    assert heard == {"": b"firstsecond", "10.0.0.2": b"firstsecond", user: b"second"}
    assert {*debts._debts} == {user}  # the others are asked for nothing
    with pytest.raises(ConnectionAbortedError):  # rospy ends the connection then
        for _ in range(1000):
            subscribers[user].connection.write_data(b"more")
    for each in subscribers.values():
        each.close()


def test_nobody_pays_for_what_a_thread_did_for_our_own(monkeypatch: pytest.MonkeyPatch) -> None:
    used = [0.0]
    clock = SimpleNamespace(monotonic=lambda: 0.0, thread_time=lambda: used[0], sleep=used.append)
    monkeypatch.setattr(inbound, "time", clock)
    monkeypatch.setattr(inbound, "_charged", threading.local())
    debts = inbound.Debts()
    used[0] = 100.0
    debts.wait("")
    used[0] += 0.1
    debts.wait("user 4002")
    assert used == [100.1] and debts.owed("user 4002") == 0.0
