"""What a substitute's core hears (events) and says (commands).

Times in s on one monotonic clock.
"""
from dataclasses import dataclass
from typing import FrozenSet, Tuple, Union

from shsa_core.model.kinds import Word
from shsa_core.model.service import Signal
from shsa_core.model.substitution import Substitution

Unusable = Tuple[Tuple[Signal, str], ...]
"""Signals of a row that cannot be read or written on this computer, each with the reason."""


@dataclass(frozen=True)
class Started:
    """The node has started as `row` says, which no table has named yet; idle without code."""

    time: float
    row: Substitution
    unusable: Unusable = ()


@dataclass(frozen=True)
class RowChanged:
    """The table of substitutions has a new row of this node."""

    time: float
    row: Substitution
    unusable: Unusable = ()


@dataclass(frozen=True)
class RowRemoved:
    """The table of substitutions has no row of this node any more."""

    time: float


@dataclass(frozen=True)
class PlansChanged:
    """The plans of warm services, for which an idle process prepares, that are new or changed.

    `removed`: the services that have none any more; `whole`: there are no others than `rows`.
    """

    time: float
    rows: Tuple[Substitution, ...]
    removed: Tuple[str, ...] = ()
    whole: bool = False
    unusable: Unusable = ()


@dataclass(frozen=True)
class InputArrived:
    """A message came from `publisher`; `values`: its fields that are listened to, each by name."""

    time: float
    topic: str
    publisher: str
    values: Tuple[Tuple[str, float], ...]


@dataclass(frozen=True)
class Advertised:
    """A topic that was to be advertised is registered at the master: messages can be published."""

    time: float
    topic: str


@dataclass(frozen=True)
class ConsumerJoined:
    """A consumer has connected to an advertised topic."""

    time: float
    topic: str
    consumer: str


@dataclass(frozen=True)
class SubscribersFound:
    """The answer to FindSubscribers: who subscribes a topic, and who of them is connected to us."""

    time: float
    topic: str
    subscribers: Tuple[str, ...]
    connected: FrozenSet[str]


@dataclass(frozen=True)
class CallFailed:
    """The master did not answer, or refused; `what` was asked of it."""

    time: float
    what: str
    detail: str


@dataclass(frozen=True)
class LookAtOriginal:
    """Ask the node `original` to whom it publishes a topic (OriginalServes).

    `asked` is the time of the question.
    """

    asked: float
    topic: str
    original: str


@dataclass(frozen=True)
class OriginalServes:
    """The answer to a look: the consumers to which the original has published already."""

    time: float
    look: LookAtOriginal
    consumers: FrozenSet[str]


@dataclass(frozen=True)
class Tick:
    """Time passes."""

    time: float


Event = Union[
    Started,
    RowChanged,
    RowRemoved,
    PlansChanged,
    InputArrived,
    Advertised,
    ConsumerJoined,
    SubscribersFound,
    CallFailed,
    OriginalServes,
    Tick,
]


class Level(Word):
    """How much a log line matters."""

    DEBUG = "debug"
    INFO = "info"
    WARNING = "warning"
    ERROR = "error"


@dataclass(frozen=True)
class Listen:
    """Send the values of these signals from now on, beside those of before."""

    inputs: Tuple[Signal, ...]


@dataclass(frozen=True)
class Advertise:
    """Register as a publisher, and say when that is done (Advertised)."""

    topic: str
    type: str


@dataclass(frozen=True)
class Withdraw:
    """Publish on these topics no more."""

    topics: Tuple[str, ...]


@dataclass(frozen=True)
class Publish:
    """Publish one message with `values` in the fields `outputs`.

    It goes to the consumer `only`, empty: to every consumer but those in `served`.
    """

    outputs: Tuple[Signal, ...]
    values: Tuple[float, ...]
    served: FrozenSet[str] = frozenset()
    only: str = ""


@dataclass(frozen=True)
class Announce:
    """Tell every subscriber of a topic at once that we publish it."""

    topic: str
    type: str


@dataclass(frozen=True)
class FindSubscribers:
    """Look who subscribes these topics (SubscribersFound)."""

    topics: Tuple[str, ...]


@dataclass(frozen=True)
class Tell:
    """Tell these subscribers of a topic who publishes it."""

    topic: str
    subscribers: Tuple[str, ...]


@dataclass(frozen=True)
class GiveUp:
    """End the node: it cannot do what it was started for."""

    reason: str


@dataclass(frozen=True)
class Log:
    """A line for people."""

    level: Level
    text: str


Command = Union[
    Listen,
    Advertise,
    Withdraw,
    Publish,
    Announce,
    FindSubscribers,
    Tell,
    LookAtOriginal,
    GiveUp,
    Log,
]
