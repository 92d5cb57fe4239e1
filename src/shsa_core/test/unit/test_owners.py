"""The kernel's word on sockets: real ones, of one address family each."""
import os
import socket
from typing import Iterator, List

import psutil
import pytest

from plain_node import PlainNode
from shsa_core.ros.master.node_api import Address, pid, resolved
from shsa_core.ros.processes import nodes
from shsa_core.ros.trust.owners import listener, listening, speaker

HOST = "127.0.0.1"
IPV6 = pytest.mark.skipif(not socket.has_ipv6, reason="there is no IPv6 here")


@pytest.fixture
def node() -> Iterator[PlainNode]:
    made = PlainNode("/speed")
    yield made
    made.end()


@IPV6
@pytest.mark.parametrize("host", ["::1", "::"])
def test_an_address_is_that_of_its_own_family_alone(node: PlainNode, host: str) -> None:
    """Create a listener of IPv6, whose port another process has in IPv4."""
    with socket.create_server((host, node.port), family=socket.AF_INET6):
        assert listener(Address(HOST, node.port)) == psutil.Process(node.process.pid)
        assert listener(Address("::1", node.port)) == psutil.Process()
        assert listener(Address(HOST, node.port), os.getpid()) != psutil.Process()
        node.end()
        assert listener(Address(HOST, node.port)) is None


def test_the_very_address_counts_before_the_wildcard(node: PlainNode) -> None:
    assert listener(Address("127.0.0.2", node.port)) is None
    with socket.create_server(("0.0.0.0", 0)) as server:
        port = server.getsockname()[1]
        assert listener(Address("127.0.0.2", port)) == psutil.Process()


def test_several_that_match_are_nobody() -> None:
    servers: List[socket.socket] = []
    for port in (0, -1):
        servers.append(socket.socket())
        servers[-1].setsockopt(socket.SOL_SOCKET, socket.SO_REUSEPORT, 1)
        servers[-1].bind((HOST, port and servers[0].getsockname()[1]))
        servers[-1].listen()
    at = Address(*servers[0].getsockname())
    assert listening(at) is None and listener(at, os.getpid()) is None
    servers.pop().close()
    assert listener(at) == psutil.Process()
    servers.pop().close()


@pytest.mark.parametrize("user", ["", "nobody"])
def test_who_speaks_is_the_user_at_the_other_end(user: str) -> None:
    if user and os.geteuid() != 0:
        pytest.skip("only root starts processes of others")
    node = PlainNode("/speed", "nothing", user=user)
    with socket.create_connection((HOST, node.port)) as connected:
        owned = listening(Address(HOST, node.port))
        found = psutil.Process(node.process.pid).uids().effective
        assert owned is not None and owned.user == speaker(connected) == found
    node.end()


def test_a_name_stands_for_one_address(monkeypatch: pytest.MonkeyPatch) -> None:
    row = lambda family, host: (family, socket.SOCK_STREAM, 6, "", (host, 80))
    rows = [row(socket.AF_INET6, "2001:db8::1"), row(socket.AF_INET, HOST)]
    monkeypatch.setattr(socket, "getaddrinfo", lambda *_, **__: rows)
    assert resolved("http://robot:80/") == Address(HOST, 80)
    monkeypatch.setenv("ROS_IPV6", "on")
    assert resolved("http://robot:80/") == Address("2001:db8::1", 80)


def test_who_ends_between_two_questions_is_dead_and_no_stranger(
    node: PlainNode, monkeypatch: pytest.MonkeyPatch
) -> None:
    def answered(at: str) -> int:
        number = pid(at)
        node.end()
        return number

    monkeypatch.setattr(nodes, "uri_of", lambda _: node.uri)
    monkeypatch.setattr(nodes, "pid", answered)
    known = nodes.Nodes().look("/driver")
    assert known is not None and known.dead
