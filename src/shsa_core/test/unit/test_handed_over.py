"""The monitor's side of a connection: nothing that rospy drops stays open."""
import gc
import socket
import time
import weakref
from typing import Any, List

import rospy
from rospy.impl.tcpros_base import TCPROSTransport
from rospy.impl.tcpros_pubsub import TCPROSSub

from shsa_core.ros.rospy_patches.subscribing import HandedOver
from shsa_core.ros.sockets.subscriptions import Looked, Subscriptions, _Closed, _Made

PUBLISHER = "http://localhost:1/"


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
    subscriptions._implementations["/topic"] = HandedOver("/topic", ignored, ignored)
    transport = connecting()
    transport.socket, other = socket.socketpair()
    transport.header = {"callerid": "/node"}
    with other:
        transport.socket.close()
        subscriptions._tell(_Made("/topic", transport))
        assert [type(each) for each in subscriptions.read()] == [Looked]
        assert not subscriptions._standing
        subscriptions._tell(_Closed("/topic", transport))
        assert [type(each) for each in subscriptions.read()] == [Looked]
