"""Calls to a node's own XML-RPC interface, with a timeout."""
import xmlrpc.client

TIMEOUT = 0.5


class _TimeoutTransport(xmlrpc.client.Transport):
    """A hung node accepts the connection and never answers: give up after TIMEOUT."""

    def make_connection(self, host):  # type: ignore[no-untyped-def]
        connection = super().make_connection(host)
        connection.timeout = TIMEOUT
        return connection


def node_api(uri: str) -> xmlrpc.client.ServerProxy:
    """The interface of the node at `uri`; its calls raise OSError or xmlrpc.client.Error."""
    return xmlrpc.client.ServerProxy(uri, transport=_TimeoutTransport())
