"""Answers over HTTP: the page, the state, its changes, questions and actions."""
import asyncio
import json
import os
from contextlib import suppress
from typing import Any, Awaitable, Optional

import tornado.iostream
import tornado.web

from shsa_core.errors import ShsaError
from shsa_core.text import shown
from shsa_view.errors import Refused
from shsa_view.guard import HEADERS, host_allowed, token_given
from shsa_view.history import as_csv
from shsa_view.live import Document, View
from shsa_view.streams import encoded

PAGE = os.path.join(os.path.dirname(os.path.abspath(__file__)), "page")
SLOW_S = 5.0
"""A reader that takes nothing for so long is dropped."""
LONGEST_NAME = 256
ACTIONS = ("release", "substitute", "inject")


class _Handler(tornado.web.RequestHandler):
    """Base of all handlers."""

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
        """Return the whole state."""
        self.answer(self.view.document())


class _Events(_Handler):
    async def get(self) -> None:
        """Return the stream of events: the whole state first, then the changes."""
        stream = self.view.streams.open(self.view.document())
        if stream is None:
            raise Refused("too many look at this already", 503)
        self._stream = stream
        self.set_header("Content-Type", "text/event-stream; charset=utf-8")
        gone_or_slow = tornado.iostream.StreamClosedError, asyncio.TimeoutError
        try:
            with suppress(*gone_or_slow):
                while not stream.ended:
                    self.write(await stream.take())
                    await asyncio.wait_for(self.flush(), SLOW_S)
        finally:
            self.view.streams.close(stream)
            self.detach().close()

    def on_connection_close(self) -> None:
        """Called by tornado: the reader has gone."""
        if hasattr(self, "_stream"):
            self._stream.end()


class _Graph(_Handler):
    async def get(self) -> None:
        """Return the drawing of the ontology."""
        self.answer(await self.view.ask(self.view.answers.graph))


class _WhatIf(_Handler):
    async def get(self) -> None:
        """Answer what healing would do."""
        service, node = (str(self.get_query_argument(name, "")) for name in ("service", "node"))
        if bool(service) == bool(node) or len(service + node) > LONGEST_NAME:
            raise Refused("name one service or one node: ?service=NAME or ?node=/NAME")
        self.answer(await self.view.ask(lambda: self.view.answers.what_if(service, node)))


class _Values(_Handler):
    async def get(self) -> None:
        """Return the values of a service over time."""
        service, key = (str(self.get_query_argument(name, "")) for name in ("service", "incident"))
        if not service or len(service + key) > LONGEST_NAME:
            raise Refused("name a service: ?service=NAME, and &incident=KEY if you like")
        self.answer(self.view.values(service, key))


class _Timeline(_Handler):
    async def get(self, kind: str) -> None:
        """Return the last hour as JSON or as CSV."""
        timeline = self.view.timeline()
        if kind == "json":
            self.answer(encoded(timeline))
        else:
            self.set_header("Content-Type", "text/csv; charset=utf-8")
            self.finish(as_csv(timeline))


class _Metrics(_Handler):
    async def get(self) -> None:
        """Return the state as text for Prometheus."""
        self.set_header("Content-Type", "text/plain; version=0.0.4; charset=utf-8")
        self.finish(self.view.metrics())


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
        raise Refused("there is nothing here; docs/howto/see_what_happens.md has the API", 404)


def _object(body: bytes) -> Document:
    """Return the JSON object of a body. Raises Refused."""
    try:
        value = json.loads(body.decode("utf-8"))
    except (ValueError, RecursionError) as error:
        raise Refused(f"the body is no JSON: {shown(error, 100)}") from error
    if not isinstance(value, dict):
        raise Refused("the body must be a JSON object")
    return value


def application(view: View) -> tornado.web.Application:
    """Return the files that are served."""
    arguments = {"view": view}
    return tornado.web.Application(
        [
            (r"/api/state", _State, arguments),
            (r"/api/events", _Events, arguments),
            (r"/api/graph", _Graph, arguments),
            (r"/api/what_if", _WhatIf, arguments),
            (r"/api/values", _Values, arguments),
            (r"/api/timeline\.(json|csv)", _Timeline, arguments),
            (r"/metrics", _Metrics, arguments),
            (r"/api/actions/([a-z]+)", _Actions, arguments),
            (r"/static/(.+)", _File, arguments),
            (r"/()", _File, arguments),
        ],
        default_handler_class=_Nothing,
        default_handler_args=arguments,
        log_function=lambda handler: None,
        compress_response=False,
    )
