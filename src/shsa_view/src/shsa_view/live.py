"""The state and whoever looks at it: facts come in, changes go out, questions are passed on."""
import asyncio
from dataclasses import dataclass
from typing import Any, Callable, Iterable, Mapping, Optional, Protocol

from shsa_core.ros.workers import Workers
from shsa_view import metrics
from shsa_view.errors import Refused
from shsa_view.facts import Fact
from shsa_view.state import State
from shsa_view.streams import Streams, encoded

TICK_S = 0.1
"""Changes within it are told together: at most 10 events a second."""
SECOND_S = 1.0
MOST_ASKED = 8
"""Questions and actions that are worked on at once."""
ANSWER_S = 20.0

Document = Mapping[str, Any]


class Answers(Protocol):
    """Questions that are answered in threads, and may take their time. Each raises ShsaError."""

    def graph(self) -> Document:
        """Return the drawing of the ontology."""

    def what_if(self, service: str, node: str) -> Document:
        """Return what healing would do without a service or a node; one of both is empty."""

    def act(self, action: str, body: Document, who: str) -> Document:
        """Do it; `who` is the address that asks."""


@dataclass(frozen=True)
class Settings:
    """The address of the page. `names`: names of this computer besides its addresses.

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
        """Return the whole state as JSON; made once a turn."""
        if not self._document:
            self._document = encoded(self.state.document(self._now()))
        return self._document

    def values(self, service: str, incident: str) -> str:
        """Return the values of a service as JSON: the newest, or those around an incident.

        Raises Refused if there is no such service.
        """
        if not self.state.knows(service):
            raise Refused(f"there is no service {service!a} here")
        return encoded(self.state.history.values(service, incident))

    def timeline(self) -> Document:
        """Return the states and incidents of the last hour."""
        return self.state.timeline(self._now())

    def metrics(self) -> str:
        """Return the state as text for Prometheus."""
        return metrics.text(self.state.document(self._now()))

    async def ask(self, question: Callable[[], Document]) -> str:
        """Return the answer to a question as JSON, from another thread. Raises ShsaError."""
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
                self.state.second(self._now())
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
