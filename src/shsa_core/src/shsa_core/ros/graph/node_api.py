"""Calls to a node's own XML-RPC interface, and to the master's, with a timeout."""
import http.client
import xmlrpc.client

import rosgraph
import rospy

TIMEOUT_S = 0.5
FAILURES = (rosgraph.MasterException, OSError, xmlrpc.client.Error, http.client.HTTPException)
"""What a call raises if there is no answer, or a refusal."""


class _TimeoutTransport(xmlrpc.client.Transport):
    """A hung node accepts the connection and never answers: give up after TIMEOUT_S."""

    def make_connection(self, host):  # type: ignore[no-untyped-def]
        connection = super().make_connection(host)
        connection.timeout = TIMEOUT_S
        return connection


def node_api(uri: str) -> xmlrpc.client.ServerProxy:
    """The interface of the node at `uri`; its calls raise one of FAILURES."""
    return xmlrpc.client.ServerProxy(uri, transport=_TimeoutTransport())


def master_api() -> rosgraph.Master:
    """The interface of the master; its calls raise one of FAILURES."""
    master = rosgraph.Master(rospy.get_name())
    master.handle = node_api(master.master_uri)
    return master
