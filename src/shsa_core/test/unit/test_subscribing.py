"""Connections that rospy makes for us: how much is read of them, and that none stays open."""
import gc
import socket
import threading
import time
import weakref
from contextlib import suppress
from typing import Any, Iterator, List

import psutil
import pytest
import rospy
from rospy.impl import masterslave, tcpros_base, tcpros_pubsub
from rospy.impl.tcpros import get_tcpros_handler
from rospy.impl.tcpros_base import TCPROSTransport
from rospy.impl.tcpros_pubsub import TCPROSSub
from std_msgs.msg import String

from shsa_core.errors import ShsaError
from shsa_core.ros import settings
from shsa_core.ros.rospy_patches.subscribing import HandedOver, ask_in_time, subscribe
from shsa_core.ros.settings import LARGEST_HEADER_B
from shsa_core.ros.sockets.subscriptions import Subscriptions, Tick
from shsa_testing.raw_publisher import RawPublisher
from shsa_testing.waiting import wait_until

PUBLISHER = "http://localhost:1/"
LARGEST_B = 1000
FOUR_GB = 0xFFFFFFFF
NUMBERS = iter(range(1000))


@pytest.fixture
def heard(monkeypatch: Any) -> Iterator[List[str]]:
    monkeypatch.setattr(tcpros_base, "_use_tcp_keepalive", False)  # else the master is asked
    told: List[str] = []
    topic = f"/bounded_{next(NUMBERS)}"
    subscriber = subscribe(topic, String, lambda message: told.append(message.data), LARGEST_B)
    told.append(topic)
    yield told
    subscriber.unregister()


def connect(topic: str, publisher: RawPublisher) -> None:
    """As rospy does when it is told of a publisher."""
    protocol = publisher._request_topic("", topic, [])[2]
    code, why, _ = get_tcpros_handler().create_transport(topic, publisher.uri, protocol)
    assert code == 1, why


def test_what_is_within_bounds_is_heard(heard: List[str]) -> None:
    publisher = RawPublisher(heard[0], "/well", String("x" * 900))
    connect(heard[0], publisher)
    wait_until(lambda: len(heard) > 3, 10.0, "messages")
    assert set(heard[1:]) == {"x" * 900}
    publisher.close()


@pytest.mark.parametrize("size", (LARGEST_B + 1, 1 << 30, FOUR_GB))
def test_who_announces_too_much_is_cut_off_before_it_is_read(heard: List[str], size: int) -> None:
    before = psutil.Process().memory_info().rss
    publisher = RawPublisher(heard[0], "/greedy", String("x"))
    publisher.claim_length(size)
    connect(heard[0], publisher)
    wait_until(lambda: publisher.ended, 10.0, "the connection is closed")
    assert len(heard) == 1
    assert psutil.Process().memory_info().rss - before < 64 << 20
    publisher.close()


def test_a_header_that_does_not_end_is_given_up(heard: List[str]) -> None:
    publisher = RawPublisher(heard[0], "/greedy", String("x"))
    publisher.claim_header(FOUR_GB)
    connect(heard[0], publisher)
    wait_until(lambda: publisher.ended, 20.0, "the connection is closed")
    assert publisher.sent < 64 * LARGEST_HEADER_B
    publisher.close()


def test_a_header_that_does_not_come_is_given_up(heard: List[str], monkeypatch: Any) -> None:
    monkeypatch.setattr(settings, "LONGEST_PAUSE_S", 0.2)
    with socket.create_server(("localhost", 0)) as server:
        protocol = ["TCPROS", "localhost", server.getsockname()[1]]
        assert get_tcpros_handler().create_transport(heard[0], PUBLISHER, protocol)[0] == 1
        server.settimeout(10.0)
        connection, _ = server.accept()
        with connection:
            connection.settimeout(10.0)
            while connection.recv(1 << 16):  # the header of the subscriber, and then the end
                pass


def connecting() -> Any:
    """A connection that rospy has begun to make."""
    transport = TCPROSTransport(TCPROSSub("/topic", rospy.AnyMsg), "/topic")
    transport.set_endpoint_id(PUBLISHER)
    return transport


def test_a_connection_that_is_replaced_while_it_is_made_is_freed_at_once() -> None:
    closed: List[Any] = []
    implementation = HandedOver("/topic", lambda _: None, closed.append)
    gc.disable()
    try:
        replaced = connecting()
        implementation.add_connection(replaced)
        implementation.add_connection(connecting())
        assert closed == [replaced]
        closed.clear()
        gone = weakref.ref(replaced)
        del replaced
        assert gone() is None
    finally:
        gc.enable()


def test_a_connection_that_is_dropped_before_it_has_a_socket_is_closed() -> None:
    """It sends no header, so a rospy publisher would wait for that, and serve nobody."""
    transport = connecting()
    HandedOver("/topic", lambda _: None, lambda _: None).add_connection(transport)
    transport.close()
    transport.socket, other = socket.socketpair()
    with other:
        other.settimeout(5.0)
        threading.Thread(target=read_quietly, args=(transport,), daemon=True).start()
        assert other.recv(1) == b""


def read_quietly(transport: Any) -> None:
    with suppress(OSError, ShsaError):
        transport.read_header()


def test_a_connection_that_stands_is_handed_over() -> None:
    made: List[Any] = []
    implementation = HandedOver("/topic", made.append, lambda _: None)
    transport = connecting()
    implementation.add_connection(transport)
    transport.receive_loop(implementation.receive_callback)
    assert made == [transport]


def test_a_connection_that_rospy_closes_before_it_is_taken_over_is_none() -> None:
    """Its thread closes the socket, and then says so."""
    rospy.rostime.set_rostime_initialized(True)
    subscriptions = Subscriptions(time.monotonic, lambda *_: None)
    ignored = lambda _: None
    subscriptions.topics["/topic"] = HandedOver("/topic", ignored, ignored)
    transport = connecting()
    transport.socket, other = socket.socketpair()
    transport.header = {"callerid": "/node"}
    with other:
        transport.socket.close()
        subscriptions._tell("/topic", lambda: subscriptions._take_over("/topic", transport))
        assert [type(each) for each in subscriptions.read()] == [Tick]
        assert not subscriptions._standing
        subscriptions._tell("/topic", lambda: subscriptions._closed("/topic", transport))
        assert [type(each) for each in subscriptions.read()] == [Tick]


def test_who_has_the_port_of_a_dead_publisher_is_held_up_for_a_moment_alone(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """A rospy publisher takes a call for a header, and serves nobody until it ends."""
    monkeypatch.setattr(masterslave, "xmlrpcapi", masterslave.xmlrpcapi)
    monkeypatch.setattr(tcpros_pubsub, "ServerProxy", tcpros_pubsub.ServerProxy)
    monkeypatch.setattr(settings, "PATIENCE_S", 0.3)
    ask_in_time()
    topic = f"/held_up_{next(NUMBERS)}"
    subscriber = subscribe(topic, String, print, LARGEST_B)
    with socket.create_server(("localhost", 0)) as there:
        uri = f"http://localhost:{there.getsockname()[1]}/"
        connect = masterslave.ROSHandler("/monitor", "")._connect_topic
        threading.Thread(target=connect, args=(topic, uri), daemon=True).start()
        caller, _ = there.accept()
        with caller:
            caller.settimeout(10.0)
            assert caller.recv(4) == b"POST"
            wait_until(lambda: not caller.recv(4096), 10.0, "the call has ended")
    subscriber.unregister()
