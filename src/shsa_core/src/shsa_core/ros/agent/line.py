"""What is said between healing and an agent: in order and each once, over topics that may lose it.

Both ends number what they say from 1, tell how much they have heard, and say again what the other
end has not.
"""
import json
from collections import deque
from typing import Any, Deque, List, NamedTuple, Optional, cast

from shsa_core.errors import ModelError
from shsa_core.journal.codec import Codec
from shsa_core.journal.machines import FORMS
from shsa_core.ros.processes.host import HostCommand, HostEvent

COMMANDS = Codec(HostCommand, FORMS)
EVENTS = Codec(HostEvent, FORMS)
RESEND_S = 0.2
"""Without an answer for so long, all that is not answered is said again."""


class Said(NamedTuple):
    """Something that was said, and its number."""

    number: int
    text: str


class Line:
    """One end of a conversation. Times in s, on one clock."""

    def __init__(self) -> None:
        self.heard = 0
        """So much of what the other end says has come."""
        self._number = 0
        self._open: Deque[Said] = deque()
        self._since = self._again_at = 0.0

    def say(self, text: str, now: float) -> Said:
        """Number what is to be said, and keep it until the other end has heard it."""
        if not self._open:
            self._since, self._again_at = now, now + RESEND_S
        self._number += 1
        self._open.append(Said(self._number, text))
        return self._open[-1]

    def take(self, number: int, heard: int, now: float) -> bool:
        """Whether what came is new, and the next in order; `heard`: so much has the other end.

        What comes too early is said again; number 0 is nothing but `heard`.
        """
        if self._open and heard >= self._open[0].number:
            while self._open and self._open[0].number <= heard:
                self._open.popleft()
            self._since, self._again_at = now, now + RESEND_S
        if number != self.heard + 1:
            return False
        self.heard = number
        return True

    def again(self, now: float) -> List[Said]:
        """What is to be said again now."""
        if not self._open or now < self._again_at:
            return []
        self._again_at = now + RESEND_S
        return list(self._open)

    def waiting(self, now: float) -> Optional[float]:
        """For how long the other end has owed an answer; None: it owes none."""
        return now - self._since if self._open else None


def command_text(command: HostCommand) -> str:
    """A command as one line."""
    return json.dumps(COMMANDS.encode(command))


def event_text(event: HostEvent) -> str:
    """An event as one line."""
    return json.dumps(EVENTS.encode(event))


def read_command(text: str, where: str) -> HostCommand:
    """The command that a text is. Raises ModelError if it is none."""
    return cast(HostCommand, COMMANDS.decode(_parsed(text, where), where, "the command"))


def read_event(text: str, where: str) -> HostEvent:
    """The event that a text is. Raises ModelError if it is none."""
    return cast(HostEvent, EVENTS.decode(_parsed(text, where), where, "the event"))


def _parsed(text: str, where: str) -> Any:
    try:
        return json.loads(text)
    except (ValueError, RecursionError) as error:
        raise ModelError(where, f"this is no JSON: {error}") from error
