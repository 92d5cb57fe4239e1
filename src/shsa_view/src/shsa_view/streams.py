"""The streams of server-sent events that are open: bounded in number, and each in what waits."""
import asyncio
import json
from collections import deque
from typing import Any, Deque, Mapping, Optional, Set

MOST_STREAMS = 20
MOST_WAITING = 50
"""Events that wait for a slow reader: 5 s of them. Beyond that it is dropped."""
KEEP_ALIVE_S = 5.0
KEEP_ALIVE = ": alive\n\n"


def encoded(document: Mapping[str, Any]) -> str:
    """Return a document as JSON on one line. Raises ValueError if a number in it is not finite."""
    return json.dumps(document, allow_nan=False, separators=(",", ":"))


def event_text(number: int, kind: str, data: str) -> str:
    """One event as it is sent; `data` is on one line."""
    return f"id: {number}\nevent: {kind}\ndata: {data}\n\n"


class Stream:
    """Changes that wait to be sent to one reader."""

    def __init__(self) -> None:
        self._waiting: Deque[str] = deque()
        self._news = asyncio.Event()
        self.ended = False

    def put(self, text: str) -> None:
        """Send this after what waits."""
        self._waiting.append(text)
        if len(self._waiting) > MOST_WAITING:
            self.ended = True
        self._news.set()

    def end(self) -> None:
        """Send no more."""
        self.ended = True
        self._news.set()

    async def take(self) -> str:
        """Return what to send next: all that waits, or a sign of life after KEEP_ALIVE_S."""
        if not self._waiting and not self.ended:
            self._news.clear()
            try:
                await asyncio.wait_for(self._news.wait(), KEEP_ALIVE_S)
            except asyncio.TimeoutError:
                return KEEP_ALIVE
        text = "".join(self._waiting)
        self._waiting.clear()
        return text


class Streams:
    """All that are open; each event is made once for all of them."""

    def __init__(self) -> None:
        self._open: Set[Stream] = set()
        self._number = 0

    def __len__(self) -> int:
        return len(self._open)

    def open(self, state: str) -> Optional[Stream]:
        """Return a new one, which begins with the whole state; None: there are enough."""
        if len(self._open) >= MOST_STREAMS:
            return None
        stream = Stream()
        stream.put(event_text(self._number, "state", state))
        self._open.add(stream)
        return stream

    def close(self, stream: Stream) -> None:
        """Its reader has gone."""
        self._open.discard(stream)

    def tell(self, change: Mapping[str, Any]) -> None:
        """Send a change to everybody."""
        self._number += 1
        if self._open:
            text = event_text(self._number, "change", encoded(change))
            for stream in self._open:
                stream.put(text)

    def end(self) -> None:
        """End all of them."""
        for stream in self._open:
            stream.end()
