"""Commands and events of a host as JSON, and back; nothing else is read."""
import json
from typing import Any, cast

from shsa_core.errors import ModelError
from shsa_core.journal.codec import Codec
from shsa_core.journal.machines import FORMS
from shsa_core.ros.host.host import HostCommand, HostEvent

COMMANDS = Codec(HostCommand, FORMS)
EVENTS = Codec(HostEvent, FORMS)


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
