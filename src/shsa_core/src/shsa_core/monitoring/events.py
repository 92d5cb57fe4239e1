"""What the monitor's core hears (events) and says (commands). Times in s on one monotonic clock."""
from dataclasses import dataclass
from typing import Optional, Tuple, Union

from shsa_core.model.kinds import Kind, Word
from shsa_core.model.som import Som
from shsa_core.model.substitution import Substitution

Key = Tuple[str, str]
"""A topic and one of its publishers: the unit of health and of blame."""


class PublisherState(Word):
    """How a publisher is doing; see shsa_msgs/PublisherHealth."""

    UNKNOWN = "unknown"
    HEALTHY = "healthy"
    FAILED = "failed"


@dataclass(frozen=True)
class PublisherHealth:
    """One row of the monitor's table: the state since `since`; `kind` of failure, if it failed."""

    topic: str
    publisher: str
    state: PublisherState
    since: float
    first_message: Optional[float] = None
    last_good: Optional[float] = None
    kind: Optional[Kind] = None
    detail: str = ""

    @property
    def key(self) -> Key:
        """What names the row."""
        return self.topic, self.publisher


@dataclass(frozen=True)
class SomChanged:
    """The services to watch are those of `som` now."""

    time: float
    som: Som


@dataclass(frozen=True)
class SubstitutionsChanged:
    """New and changed rows of the table of substitutions, and the nodes whose rows are gone.

    `whole`: all rows.
    """

    time: float
    rows: Tuple[Substitution, ...]
    removed: Tuple[str, ...] = ()
    whole: bool = False


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
    """A message came. `values` are those of `checked_provisions` of its service.

    None: they were not decoded.

    `error` says why a message could not be decoded. `age`: s since its stamp, None if it has none.
    `waited`: s that it may have waited at most for the monitor to read it.
    """

    time: float
    topic: str
    publisher: str
    values: Optional[Tuple[float, ...]] = None
    error: str = ""
    age: Optional[float] = None
    waited: float = 0.0


@dataclass(frozen=True)
class Tick:
    """Time passes; every message that came before `time` is handled.

    The monitor wanted to wake at `wanted` at the latest, and did at `woke`; None: it was awake.
    """

    time: float
    wanted: Optional[float] = None
    woke: Optional[float] = None

    @property
    def late(self) -> float:
        """The time in s that the monitor itself was not scheduled."""
        if self.wanted is None or self.woke is None:
            return 0.0
        return max(0.0, self.woke - self.wanted)


@dataclass(frozen=True)
class Ending:
    """The launch of the monitor is ending: what stops from now on stops on purpose."""

    time: float


Event = Union[SomChanged, SubstitutionsChanged, Connected, Disconnected, Message, Tick, Ending]


@dataclass(frozen=True)
class FailureDetected:
    """A publisher of a topic failed, once an episode.

    `service` is empty if it is nobody's, `publisher` if none was ever seen.
    """

    time: float
    service: str
    topic: str
    publisher: str
    kind: Kind
    detail: str
    last_good: Optional[float]


@dataclass(frozen=True)
class HealthChanged:
    """New and changed rows of the table of health, and those that are gone."""

    time: float
    rows: Tuple[PublisherHealth, ...]
    removed: Tuple[Key, ...] = ()


Command = Union[FailureDetected, HealthChanged]
