"""What the monitor's core hears (events) and says (outputs). Times in s on one monotonic clock."""
from dataclasses import dataclass
from typing import Optional, Tuple, Union

from shsa_core.model.kinds import Kind, Word
from shsa_core.model.som import Som

class PublisherState(Word):
    UNKNOWN = "unknown"
    HEALTHY = "healthy"
    FAILED = "failed"


Key = Tuple[str, str]
"""A topic and one of its publishers: the unit of health and of blame."""


@dataclass(frozen=True)
class PublisherHealth:
    """One row of the monitor's table; `state` is unknown, healthy or failed, since `since`."""

    topic: str
    publisher: str
    state: str
    since: float
    first_message: Optional[float] = None
    last_good: Optional[float] = None
    kind: str = ""
    detail: str = ""


@dataclass(frozen=True)
class SomChanged:
    """The topics to watch are those of `som` now."""

    time: float
    som: Som


@dataclass(frozen=True)
class SubstitutionsChanged:
    """The substitutes that run now: topic, empty for an idle one, and node, and whether it speaks."""

    time: float
    speaking: Tuple[Tuple[Key, bool], ...]


@dataclass(frozen=True)
class Connected:
    """A connection to a publisher was made."""

    time: float
    topic: str
    publisher: str


@dataclass(frozen=True)
class Disconnected:
    """The last connection to a publisher was lost."""

    time: float
    topic: str
    publisher: str


@dataclass(frozen=True)
class Message:
    """A message came. `values` follow the services of the topic in the SOM; None: they were not decoded.

    `error` says why a message could not be decoded. `age`: s since its stamp, None if it has none. `waited`: s that it
    may have waited at most for the monitor to read it.
    """

    time: float
    topic: str
    publisher: str
    values: Optional[Tuple[float, ...]] = None
    error: str = ""
    age: Optional[float] = None
    waited: float = 0.0


@dataclass(frozen=True)
class Late:
    """The monitor itself was not scheduled: it woke `late` s after it wanted to."""

    time: float
    late: float


@dataclass(frozen=True)
class Tick:
    """Time passes; every message that came before `time` is handled."""

    time: float


HealthEvent = Union[SomChanged, SubstitutionsChanged, Connected, Disconnected, Message, Late, Tick]


@dataclass(frozen=True)
class FailureDetected:
    """A publisher of a topic failed; `publisher` is empty if none was ever seen. Once an episode."""

    time: float
    topic: str
    publisher: str
    kind: str
    detail: str
    last_good: Optional[float]


@dataclass(frozen=True)
class HealthChanged:
    """A state changed; this is the whole table."""

    time: float
    publishers: Tuple[PublisherHealth, ...]


HealthOutput = Union[FailureDetected, HealthChanged]
