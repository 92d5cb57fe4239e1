"""Serves the page, the state as JSON, and its changes as server-sent events.

One loop of tornado, in the thread that calls `serve`. What takes long is asked of `Answers` in
other threads, never in the loop.
"""
import asyncio
import errno
import json
import os
import socket
from dataclasses import dataclass
from typing import Any, Awaitable, Callable, Iterable, Mapping, Optional, Protocol

import tornado.httpserver
import tornado.iostream
import tornado.netutil
import tornado.web

from shsa_core.errors import ShsaError
from shsa_core.ros.graph.workers import Workers
from shsa_core.text import shown
from shsa_view.errors import Refused
from shsa_view.facts import Fact
from shsa_view.guard import HEADERS, host_allowed, token_given
from shsa_view.state import State
from shsa_view.streams import Streams, encoded

PAGE = os.path.join(os.path.dirname(os.path.abspath(__file__)), "page")
TICK_S = 0.1
"""What changed within it is told together: at most 10 events a second."""
SECOND_S = 1.0
SLOW_S = 5.0
"""A reader that takes nothing for so long is dropped."""
LONGEST_BODY_B = 4096
LONGEST_HEADER_B = 16384
LONGEST_NAME = 256
MOST_CONNECTIONS = 100
MOST_ASKED = 8
"""Questions and actions that are worked on at once."""
ANSWER_S = 20.0
ENDING_S = 0.3
RETRY_S = 2.0
ACTIONS = ("release", "substitute", "inject")

Document = Mapping[str, Any]


class Answers(Protocol):
    """What is asked in threads, where it may take its time. Each raises ShsaError."""

    def graph(self) -> Document:
        """The drawing of the ontology."""

    def what_if(self, service: str, node: str) -> Document:
        """What healing would do without a service, or without a node; one of both is empty."""

    def act(self, action: str, body: Document, who: str) -> Document:
        """Do it; `who` is the address that asks."""


@dataclass(frozen=True)
class Settings:
    """Where the page is served. `names`: what this computer is called besides its addresses.

    `token`: who has it may act; empty: nobody may.
    """

    address: str = "127.0.0.1"
    port: int = 8080
    token: str = ""
    names: Iterable[str] = ()


class View:
    """The state and whoever looks at it.

    `take` gives the facts that have come since it was asked last; `now` tells ROS time in s.
    """

    def __init__(
        self,
        settings: Settings,
        state: State,
        answers: Answers,
        take: Callable[[], Iterable[Fact]],
        now: Callable[[], float],
        failed: Callable[[str], None],
    ) -> None:
        self.settings, self.state, self.answers = settings, state, answers
        self.streams = Streams()
        self._take, self._now, self.failed = take, now, failed
        self._workers = Workers("answers", MOST_ASKED, failed)
        self._asked = 0
        self._document = ""

    def document(self) -> str:
        """The whole state as JSON; made once a turn."""
        if not self._document:
            self._document = encoded(self.state.document(self._now()))
        return self._document

    async def ask(self, question: Callable[[], Document]) -> str:
        """The answer to a question as JSON, from another thread. Raises ShsaError."""
        if self._asked >= MOST_ASKED:
            raise Refused("too much is asked at once; ask again", 503)
        loop = asyncio.get_event_loop()
        answer: "asyncio.Future[str]" = loop.create_future()
        self._asked += 1

        def work() -> None:
            try:
                text = encoded(question())
            except Exception as error:  # whatever it is, whoever asked hears of it
                loop.call_soon_threadsafe(self._settle, answer, error, "")
            else:
                loop.call_soon_threadsafe(self._settle, answer, None, text)

        self._workers.put(work)
        try:
            return await asyncio.wait_for(asyncio.shield(answer), ANSWER_S)
        except asyncio.TimeoutError:
            answer.cancel()
            raise Refused(f"no answer within {ANSWER_S:g} s", 504) from None

    def _settle(self, answer: "asyncio.Future[str]", error: Optional[Exception], text: str) -> None:
        self._asked -= 1
        if answer.cancelled():
            return
        if error is not None:
            answer.set_exception(error)
        else:
            answer.set_result(text)

    async def run(self, ended: Callable[[], bool]) -> None:
        """Heed facts and tell changes until `ended`."""
        loop = asyncio.get_event_loop()
        second = loop.time() + SECOND_S
        while not ended():
            self._turn()
            if loop.time() >= second:
                second = max(second + SECOND_S, loop.time())
                self.state.second()
            await asyncio.sleep(TICK_S)

    def _turn(self) -> None:
        try:
            for fact in self._take():
                self.state.handle(fact)
            change = self.state.changes(self._now())
        except Exception as error:  # whatever it is, the view goes on
            self.failed(f"{type(error).__name__}: {error}")
            return
        self._document = ""
        if change is not None:
            self.streams.tell(change)


class _Handler(tornado.web.RequestHandler):
    """What all answers have in common."""

    SUPPORTED_METHODS = ("GET", "POST")  # type: ignore[assignment]

    def initialize(self, view: View) -> None:
        """Called by tornado."""
        self.view = view

    def set_default_headers(self) -> None:
        """Called by tornado."""
        for name, value in HEADERS.items():
            self.set_header(name, value)
        self.clear_header("Server")

    def prepare(self) -> Optional[Awaitable[None]]:
        """Called by tornado before each request."""
        if not host_allowed(self.request.headers.get("Host", ""), tuple(self.view.settings.names)):
            raise Refused("this is not the name of this server; use its address", 403)
        return None

    def write_error(self, status_code: int, **kwargs: Any) -> None:
        """Called by tornado: every refusal is a JSON document."""
        error = kwargs.get("exc_info", (None, None, None))[1]
        if isinstance(error, ShsaError):
            status_code = error.status if isinstance(error, Refused) else 400
            self.set_status(status_code)
            text = str(error)
        else:
            text = self._reason
        self.answer(encoded({"error": shown(text)}))

    def log_exception(self, typ: Any, value: Any, tb: Any) -> None:
        """Called by tornado: what is refused is no fault of ours."""
        if not isinstance(value, (ShsaError, tornado.web.HTTPError)):
            super().log_exception(typ, value, tb)

    def answer(self, text: str) -> None:
        """Answer with a JSON document."""
        self.set_header("Content-Type", "application/json; charset=utf-8")
        self.finish(text)


class _State(_Handler):
    async def get(self) -> None:
        """The whole state."""
        self.answer(self.view.document())


class _Events(_Handler):
    async def get(self) -> None:
        """The stream of events: the whole state first, then the changes."""
        stream = self.view.streams.open(self.view.document())
        if stream is None:
            raise Refused("too many look at this already", 503)
        self._stream = stream
        self.set_header("Content-Type", "text/event-stream; charset=utf-8")
        try:
            while not stream.ended:
                self.write(await stream.take())
                await asyncio.wait_for(self.flush(), SLOW_S)
        except (tornado.iostream.StreamClosedError, asyncio.TimeoutError):
            pass  # it has gone, or is too slow
        finally:
            self.view.streams.close(stream)
            self.detach().close()

    def on_connection_close(self) -> None:
        """Called by tornado: the reader has gone."""
        if hasattr(self, "_stream"):
            self._stream.end()


class _Graph(_Handler):
    async def get(self) -> None:
        """The drawing of the ontology."""
        self.answer(await self.view.ask(self.view.answers.graph))


class _WhatIf(_Handler):
    async def get(self) -> None:
        """What healing would do."""
        service, node = (str(self.get_query_argument(name, "")) for name in ("service", "node"))
        if bool(service) == bool(node) or len(service + node) > LONGEST_NAME:
            raise Refused("name one service or one node: ?service=NAME or ?node=/NAME")
        self.answer(await self.view.ask(lambda: self.view.answers.what_if(service, node)))


class _Actions(_Handler):
    async def post(self, action: str) -> None:
        """Do something, for who has the token."""
        if not self.view.settings.token:
            raise Refused("the view was not started with actions:=true", 403)
        given = self.request.headers.get("Authorization", "")
        if not token_given(given, self.view.settings.token):
            raise Refused("the token is missing or wrong; open the address that was printed", 403)
        if action not in ACTIONS:
            raise Refused(f"there is no such action; these are: {', '.join(ACTIONS)}", 404)
        body, who = _object(self.request.body), self.request.remote_ip or ""
        self.answer(await self.view.ask(lambda: self.view.answers.act(action, body, who)))


class _File(_Handler, tornado.web.StaticFileHandler):
    def initialize(self, view: View) -> None:  # type: ignore[override]
        """Called by tornado."""
        self.view = view
        tornado.web.StaticFileHandler.initialize(self, PAGE, "index.html")


class _Nothing(_Handler):
    def prepare(self) -> None:
        """Called by tornado: there is nothing at this path."""
        super().prepare()
        raise Refused("there is nothing here; docs/view.md names what there is", 404)


def _object(body: bytes) -> Document:
    """The JSON object of a body. Raises Refused."""
    try:
        value = json.loads(body.decode("utf-8"))
    except (ValueError, RecursionError) as error:
        raise Refused(f"the body is no JSON: {shown(error, 100)}") from error
    if not isinstance(value, dict):
        raise Refused("the body must be a JSON object")
    return value


class _Http(tornado.httpserver.HTTPServer):
    """Serves so many connections, and cuts off those beyond."""

    def handle_stream(self, stream: Any, address: Any) -> Any:
        """Called by tornado for each connection."""
        if len(self._connections) >= MOST_CONNECTIONS:
            stream.close()
            return None
        return super().handle_stream(stream, address)


def application(view: View) -> tornado.web.Application:
    """What is served."""
    arguments = {"view": view}
    return tornado.web.Application(
        [
            (r"/api/state", _State, arguments),
            (r"/api/events", _Events, arguments),
            (r"/api/graph", _Graph, arguments),
            (r"/api/what_if", _WhatIf, arguments),
            (r"/api/actions/([a-z]+)", _Actions, arguments),
            (r"/static/(.+)", _File, arguments),
            (r"/()", _File, arguments),
        ],
        default_handler_class=_Nothing,
        default_handler_args=arguments,
        log_function=lambda handler: None,
        compress_response=False,
    )


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
        idle_connection_timeout=60.0,
        body_timeout=SLOW_S,
    )
    server.add_sockets(sockets)
    ready(sockets[0].getsockname()[1])
    await view.run(ended)
    server.stop()
    view.streams.end()
    await asyncio.sleep(0)
    await asyncio.wait([asyncio.ensure_future(server.close_all_connections())], timeout=ENDING_S)


async def _bound(view: View, ended: Callable[[], bool]) -> Any:
    """The sockets, once the port is free. Raises ShsaError."""
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
