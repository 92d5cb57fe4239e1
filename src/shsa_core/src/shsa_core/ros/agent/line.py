"""Commands to an agent and its events, each as one line of JSON; nothing else is read."""
import json
from typing import Any

from shsa_core.errors import ModelError
from shsa_core.journal.codec import Codec
from shsa_core.ros.processes.host import HostCommand, HostEvent

COMMANDS = Codec(HostCommand)
EVENTS = Codec(HostEvent)


def written(codec: Codec, told: object) -> str:
    """Write a command or an event as one line."""
    return json.dumps(codec.encode(told))


def read(codec: Codec, text: str, where: str) -> Any:
    """Return the command or event that a text is. Raises ModelError if it is none."""
    try:
        return codec.decode(json.loads(text), where, "what was said")
    except (ValueError, RecursionError) as error:
        raise ModelError(where, f"this is no JSON: {error}") from error
