"""The events that a substitute's core hears, and its commands. Times in s on one monotonic clock.

`stamp`: of a message's header, in ns; 0: none. `ros_time`: of an event, in ns; 0: not known.
"""
from dataclasses import dataclass
from typing import FrozenSet, Optional, Tuple, Union

from shsa_core.model.kinds import Others
from shsa_core.model.log import Log
from shsa_core.model.service import Signal
from shsa_core.model.substitution import Substitution

Unusable = Tuple[Tuple[Signal, str], ...]
"""Signals of a row that cannot be read or written on this computer, each with the reason."""


@dataclass(frozen=True)
class LastMessage:
    """The values in the last good message of a row: of the fields that it writes, each by name."""

    values: Tuple[Tuple[str, float], ...]
    stamp: int = 0


@dataclass(frozen=True)
class Act:
    """Something is to be done: one of the classes below that no other is made of."""


@dataclass(frozen=True)
class Event:
    """Something has happened: one of the classes below that no other is made of."""

    time: float


@dataclass(frozen=True)
class RowChanged(Event):
    """The table has a new row of this node; the first: it was started with that."""

    row: Substitution
    unusable: Unusable = ()
    last: Optional[LastMessage] = None  # None: it has none that can be read
    ros_time: int = 0


@dataclass(frozen=True)
class RowRemoved(Event):
    """The table of substitutions has no row of this node, or of this `service` in it, any more."""

    service: str = ""
    ended: bool = False  # it was taken out; else the table is of a new reconfigurator


@dataclass(frozen=True)
class PlansChanged(Event):
    """The plans of warm services, for which an idle process prepares, that are new or changed."""

    rows: Tuple[Substitution, ...]
    removed: Tuple[str, ...] = ()  # the services that have none any more
    whole: bool = False  # there are no others than `rows`
    unusable: Unusable = ()


@dataclass(frozen=True)
class InputArrived(Event):
    """A message came from `publisher`; `values`: its fields that are listened to, each by name."""

    topic: str
    publisher: str
    values: Tuple[Tuple[str, float], ...]
    stamp: int = 0
    ros_time: int = 0
    waited: float = 0.0  # in s, since the first of those that it is told instead of


@dataclass(frozen=True)
class Advertised(Event):
    """A topic that was to be advertised is registered at the master: messages can be published."""

    topic: str


@dataclass(frozen=True)
class ConsumerJoined(Event):
    """A consumer has connected to an advertised topic."""

    topic: str
    consumer: str


@dataclass(frozen=True)
class LookAtOriginal(Act):
    """Ask the node `original` to whom it publishes a topic (OriginalServes)."""

    asked: float
    topic: str
    original: str


@dataclass(frozen=True)
class OriginalServes(Event):
    """The answer to a look: to whom the original has published already; None: it has no answer."""

    look: LookAtOriginal
    consumers: Optional[FrozenSet[str]]


@dataclass(frozen=True)
class OtherHeard(Event):
    """Somebody else, `publisher`, has published on a topic that is overheard."""

    topic: str
    publisher: str = ""
    stamp: int = 0


@dataclass(frozen=True)
class OtherGone(Event):
    """The node of somebody else, `publisher`, is gone from a topic; all that it said is told."""

    topic: str
    publisher: str


@dataclass(frozen=True)
class LookAtOthers(Act):
    """Look whether the connection to a publisher of an overheard topic stands (OthersStand).

    What has come on it, but is not read yet, is told before that (OtherHeard).
    """

    asked: float
    topic: str
    publisher: str


@dataclass(frozen=True)
class OthersStand(Event):
    """The answer to a look: the connection stands or not."""

    look: LookAtOthers
    stands: bool
    alone: bool = False  # the reconfigurator, agent or monitor does not hear our heartbeats


@dataclass(frozen=True)
class ReachChanged(Event):
    """The reconfigurator is out of our agent's reach; `alone`: none has been there for a minute."""

    cut_off: bool
    alone: bool = False


@dataclass(frozen=True)
class FailureHeard(Event):
    """A failure on a topic is told; `kind`: as in its message; `last_message`: as a row has it."""

    topic: str
    kind: str
    last_message: bytes = b""


@dataclass(frozen=True)
class Tick(Event):
    """Time passes; the last sign of life of a reconfigurator came `unheard` s ago."""

    unheard: float = 0.0


LEFT_ALONE = "no reconfigurator has been there for a minute"


@dataclass(frozen=True)
class Listen(Act):
    """Send the values of this signal from now on, beside those of before."""

    signal: Signal


@dataclass(frozen=True)
class Overhear(Act):
    """Tell from now on of others who publish on a topic (OtherHeard), and are gone (OtherGone).

    Keep the newest message of the `provider`; empty: of whoever is heard.
    """

    topic: str
    type: str
    provider: str = ""


@dataclass(frozen=True)
class Advertise(Act):
    """Register as a publisher, of a `latched` topic or not; say when that is done (Advertised)."""

    topic: str
    type: str
    latched: bool = False


@dataclass(frozen=True)
class Withdraw(Act):
    """Publish on a topic no more."""

    topic: str


@dataclass(frozen=True)
class Compose(Act):
    """From now on messages on a topic start from `last_message`, serialized; empty: not known."""

    topic: str
    type: str
    written: Tuple[Tuple[str, Optional[float]], ...]  # what is computed, and its standard deviation
    others: Others = Others.UNKNOWN  # what stands in the other fields
    last_message: bytes = b""
    overheard: bool = False  # they start from the newest message that is kept, if any


@dataclass(frozen=True)
class Publish(Act):
    """Publish one message with `values` in the fields `outputs`."""

    outputs: Tuple[Signal, ...]
    values: Tuple[float, ...]
    served: FrozenSet[str] = frozenset()  # who does not get it
    only: str = ""  # who alone gets it; empty: everybody else
    stamp: int = 0  # 0: now


@dataclass(frozen=True)
class Remind(Act):
    """Tell those subscribers of these topics who have not connected who publishes them."""

    topics: Tuple[str, ...]


@dataclass(frozen=True)
class TakeOver(Act):
    """Follow this row as if it came from the table (RowChanged): no reconfigurator is there."""

    row: Substitution


@dataclass(frozen=True)
class TellNoValue(Act):
    """Tell the reconfigurator that the program has no value now: its law does not hold."""

    service: str
    topic: str


@dataclass(frozen=True)
class GiveUp(Act):
    """End the node: it cannot do what it was started for."""

    reason: str


Command = Union[Act, Log]
