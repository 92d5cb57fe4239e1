"""The events that a gate's core hears, and its commands. Times in s on one monotonic clock."""
from dataclasses import dataclass
from typing import Optional, Union

from shsa_core.model.log import Log
from shsa_core.monitoring.events import Disconnected, Message, SubstitutionsChanged, Tick


@dataclass(frozen=True)
class Arrived:
    """A message came, of the node or to consumers; `newest`: no later one of its publisher."""

    message: Message
    data: bytes
    newest: bool = True

    @property
    def time(self) -> float:
        """Return the time at which it came."""
        return self.message.time


Event = Union[SubstitutionsChanged, Arrived, Disconnected, Tick]


@dataclass(frozen=True)
class Pass:
    """Consumers hear this of `publisher`, byte for byte; `stamp`: in ns, None: as it is."""

    data: bytes
    publisher: str
    stamp: Optional[int] = None


Command = Union[Pass, Log]
