"""Carries what healing and an agent say: in order and each once, over topics that may lose it.

Both ends number what they say from 1, tell how much they have heard, and say again what the other
end has not. Commands and events are JSON; nothing else is read.
"""
import json
from collections import deque
from typing import Any, Deque, List, NamedTuple, Optional

from shsa_core.errors import ModelError
from shsa_core.journal.codec import Codec
from shsa_core.journal.machines import FORMS
from shsa_core.ros import settings
from shsa_core.ros.processes.host import HostCommand, HostEvent

COMMANDS = Codec(HostCommand, FORMS)
EVENTS = Codec(HostEvent, FORMS)


class Numbered(NamedTuple):
    """Something that was said, and its number."""

    number: int
    text: str


class Line:
    """One end of a conversation. Times in s, on one clock."""

    def __init__(self) -> None:
        self.heard = 0
        """So much of what the other end says has come."""
        self._number = 0
        self._open: Deque[Numbered] = deque()
        self._again_at = 0.0
        self.since: Optional[float] = None
        """Since when the other end owes an answer; None: it owes none."""

    def say(self, text: str, now: float) -> Numbered:
        """Number what is to be said, and keep it until the other end has heard it."""
        if not self._open:
            self.since, self._again_at = now, now + settings.SILENT_S
        self._number += 1
        self._open.append(Numbered(self._number, text))
        return self._open[-1]

    def hear(self, number: int, heard: int, now: float) -> bool:
        """Return whether what came is new, and the next in order; `heard`: so much has the other.

        What comes too early is said again; number 0 is nothing but `heard`.
        """
        if self._open and heard >= self._open[0].number:
            while self._open and self._open[0].number <= heard:
                self._open.popleft()
            self.since, self._again_at = now if self._open else None, now + settings.SILENT_S
        if number != self.heard + 1:
            return False
        self.heard = number
        return True

    def again(self, now: float) -> List[Numbered]:
        """Return what is to be said again now."""
        if not self._open or now < self._again_at:
            return []
        self._again_at = now + settings.SILENT_S
        return list(self._open)


def written(codec: Codec, told: object) -> str:
    """Write a command or an event as one line."""
    return json.dumps(codec.encode(told))


def read(codec: Codec, text: str, where: str) -> Any:
    """Return the command or event that a text is. Raises ModelError if it is none."""
    try:
        return codec.decode(json.loads(text), where, "what was said")
    except (ValueError, RecursionError) as error:
        raise ModelError(where, f"this is no JSON: {error}") from error
