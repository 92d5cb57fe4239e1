"""The monitor's side of a connection: nothing that rospy drops stays open."""
import gc
import socket
import weakref
from typing import Any

import rospy
from rospy.impl.tcpros_base import TCPROSTransport
from rospy.impl.tcpros_pubsub import TCPROSSub

from shsa_core.ros.sockets.connections import Closed, Connections, Made, _Implementation
from shsa_core.ros.sockets.inbox import Inbox

PUBLISHER = "http://localhost:1/"


def connecting() -> Any:
    """A connection that rospy has begun to make."""
    transport = TCPROSTransport(TCPROSSub("/topic", rospy.AnyMsg), "/topic")
    transport.set_endpoint_id(PUBLISHER)
    return transport


def test_a_connection_that_is_replaced_while_it_is_made_is_freed_at_once() -> None:
    inbox = Inbox()
    implementation = _Implementation("/topic", inbox)
    gc.disable()
    try:
        replaced = connecting()
        implementation.add_connection(replaced)
        implementation.add_connection(connecting())
        assert [type(item) for item in inbox.take()] == [Closed]
        gone = weakref.ref(replaced)
        del replaced
        assert gone() is None
    finally:
        gc.enable()


def test_a_connection_that_stands_is_handed_over() -> None:
    inbox = Inbox()
    implementation = _Implementation("/topic", inbox)
    transport = connecting()
    implementation.add_connection(transport)
    transport.receive_loop(implementation.receive_callback)
    assert inbox.take() == [Made("/topic", transport)]


def test_a_connection_that_rospy_closes_before_it_is_taken_over_is_none() -> None:
    """Its thread closes the socket, and then says so."""
    inbox = Inbox()
    connections = Connections(inbox, 2.0, lambda *_: None)
    connections._implementations["/topic"] = _Implementation("/topic", inbox)
    transport = connecting()
    transport.socket, other = socket.socketpair()
    transport.header = {"callerid": "/node"}
    with other:
        transport.socket.close()
        assert list(connections.heed(Made("/topic", transport))) == []
        assert connections.standing() == set()
        assert list(connections.heed(Closed("/topic", transport))) == []
