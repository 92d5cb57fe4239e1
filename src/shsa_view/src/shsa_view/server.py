"""Serves a view over HTTP, in one loop of tornado, in the thread that calls `serve`."""
import asyncio
import errno
import socket
from typing import Any, Callable, Dict

import tornado.httpserver
import tornado.netutil

from shsa_core.errors import ShsaError
from shsa_view.handlers import application
from shsa_view.live import Settings, View

__all__ = ["Settings", "View", "serve"]

LONGEST_BODY_B = 4096
LONGEST_HEADER_B = 16384
BODY_S = 5.0
IDLE_S = 10.0
"""Without a whole header. An open page asks more often."""
MOST_CONNECTIONS = 100
ENDING_S = 0.3
RETRY_S = 2.0


class _Http(tornado.httpserver.HTTPServer):
    """Serves so many connections: the one that waits for longest to ask makes room for the next."""

    def initialize(self, *args: Any, **kwargs: Any) -> None:
        """Called by tornado."""
        super().initialize(*args, **kwargs)
        self._silent: Dict[Any, None] = {}

    def handle_stream(self, stream: Any, address: Any) -> Any:
        """Called by tornado for each connection."""
        self._silent = {each: None for each in self._silent if not each.closed()}
        if len(self._connections) >= MOST_CONNECTIONS:
            oldest = next(iter(self._silent), stream)
            oldest.close()
            self._silent.pop(oldest, None)
            if oldest is stream:
                return None
        self._silent[stream] = None
        return super().handle_stream(stream, address)

    def start_request(self, server_conn: object, request_conn: Any) -> Any:
        """Called by tornado before it reads the header of a request."""
        delegate: Any = super().start_request(server_conn, request_conn)
        received = delegate.headers_received

        def headers_received(*arguments: Any) -> Any:
            self._silent.pop(request_conn.stream, None)
            return received(*arguments)

        delegate.headers_received = headers_received
        return delegate


def serve(view: View, ended: Callable[[], bool], ready: Callable[[int], None]) -> None:
    """Serve until `ended`; `ready` is told the port. Raises ShsaError.

    While another program has the port, it is waited for.
    """
    asyncio.set_event_loop(asyncio.new_event_loop())
    asyncio.get_event_loop().run_until_complete(_serve(view, ended, ready))


async def _serve(view: View, ended: Callable[[], bool], ready: Callable[[int], None]) -> None:
    sockets = await _bound(view, ended)
    if not sockets:
        return
    server = _Http(
        application(view),
        max_body_size=LONGEST_BODY_B,
        max_buffer_size=LONGEST_BODY_B + LONGEST_HEADER_B,
        max_header_size=LONGEST_HEADER_B,
        idle_connection_timeout=IDLE_S,
        body_timeout=BODY_S,
    )
    server.add_sockets(sockets)
    ready(sockets[0].getsockname()[1])
    await view.run(ended)
    server.stop()
    view.streams.end()
    await asyncio.sleep(0)
    await asyncio.wait([asyncio.ensure_future(server.close_all_connections())], timeout=ENDING_S)


async def _bound(view: View, ended: Callable[[], bool]) -> Any:
    """Return the sockets, once the port is free. Raises ShsaError."""
    address, port = view.settings.address, view.settings.port
    said = False
    while not ended():
        try:
            return tornado.netutil.bind_sockets(port, address)
        except socket.gaierror as error:
            raise ShsaError(f"the address {address!a} is not known: {error.strerror}") from error
        except OSError as error:
            if error.errno != errno.EADDRINUSE:
                raise ShsaError(f"{address}:{port} cannot be served: {error.strerror}") from error
        if not said:
            view.failed(
                f"the port {port} of {address} is in use by another program: the view waits for "
                "it. Take another one (view_port:=8081), one for each robot"
            )
            said = True
        await asyncio.sleep(RETRY_S)
    return None
