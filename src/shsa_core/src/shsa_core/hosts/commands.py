"""Commands to one computer, and its events; to an agent and back each is one line of JSON."""
import json
from typing import Any, Callable, Optional, Union

from shsa_core.errors import ModelError
from shsa_core.healing import events
from shsa_core.journal.codec import Codec

HostCommand = Union[events.NodeCommand, events.WatchNodes]
HostEvent = events.NodeEvent
COMMANDS, EVENTS = Codec(HostCommand), Codec(HostEvent)
Tell = Callable[[HostEvent], None]
"""Is told an event, from any thread; waits for nobody."""
CarryOut = Callable[[HostCommand], object]
"""Begins to carry out a command, and waits for nobody; what fails is answered by an event."""


def not_done(command: HostCommand, now: float, why: str) -> Optional[HostEvent]:
    """Return the answer to a command that cannot be carried out; None: it needs none."""
    if isinstance(command, events.LearnNode):
        return events.NodeLearned(now, command.node, False)
    if isinstance(command, (events.FindNode, events.AskToLeave, events.EndProcess)):
        return events.ProcessUntouchable(now, command.node, why)
    if isinstance(command, events.StartSubstitute):
        return events.ProcessExited(now, command.node, why, False)
    if isinstance(command, events.RestartNode):
        return events.RestartFailed(now, command.node, why)
    return None


def written(codec: Codec, told: object) -> str:
    """Write a command or an event as one line."""
    return json.dumps(codec.encode(told))


def read(codec: Codec, text: str, where: str) -> Any:
    """Return the command or event that a text is. Raises ModelError if it is none."""
    try:
        return codec.decode(json.loads(text), where, "what was said")
    except (ValueError, RecursionError) as error:
        raise ModelError(where, f"this is no JSON: {error}") from error
