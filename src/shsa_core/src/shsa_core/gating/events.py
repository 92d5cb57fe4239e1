"""The events that a gate's core hears, and its commands. Times in s on one monotonic clock."""
from dataclasses import dataclass
from typing import Optional, Union

from shsa_core.model.log import Log
from shsa_core.monitoring.events import Disconnected, Message, SubstitutionsChanged, Tick


@dataclass(frozen=True)
class Arrived:
    """A message came on the topic that the node publishes on.

    `stamp`: of its header in ns, 0: none. `newest`: no later one of its publisher has come yet.
    """

    message: Message
    data: bytes
    stamp: int = 0
    newest: bool = True

    @property
    def time(self) -> float:
        """Return the time at which it came."""
        return self.message.time


@dataclass(frozen=True)
class Overheard:
    """Somebody else published on the topic that consumers hear; `stamp` as above."""

    time: float
    publisher: str
    stamp: int = 0


Event = Union[SubstitutionsChanged, Arrived, Overheard, Disconnected, Tick]


@dataclass(frozen=True)
class Pass:
    """Consumers hear this, byte for byte; `stamp`: in ns, written into its header, None: as it is.

    `publisher`: whose message it is.
    """

    data: bytes
    publisher: str
    stamp: Optional[int] = None


Command = Union[Pass, Log]
