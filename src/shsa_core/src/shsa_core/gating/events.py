"""The events that a gate's core hears, and its commands. Times in s on one monotonic clock."""
from dataclasses import dataclass
from typing import Optional, Union

from shsa_core.model.log import Log
from shsa_core.monitoring.events import Disconnected, Message, SubstitutionsChanged, Tick


@dataclass(frozen=True)
class Arrived:
    """A message came on the topic that the node publishes on, or on that which consumers hear.

    `newest`: no later one of its publisher has come yet.
    """

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
    """Consumers hear this, byte for byte; `stamp`: in ns, written into its header, None: as it is.

    `publisher`: whose message it is.
    """

    data: bytes
    publisher: str
    stamp: Optional[int] = None


Command = Union[Pass, Log]
