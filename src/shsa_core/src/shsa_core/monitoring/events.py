"""The events that the monitor's core hears, and its commands. Times in s on one monotonic clock."""
from dataclasses import dataclass
from typing import Optional, Tuple, Union

from shsa_core.model.calibration import CalibrationsChanged
from shsa_core.model.health import Key, PublisherHealth
from shsa_core.model.log import Log
from shsa_core.model.samples import Parts
from shsa_core.model.service import Service
from shsa_core.model.som import Som
from shsa_core.model.substitution import Substitution


@dataclass(frozen=True)
class Event:
    """Something has happened: one of the classes below that no other is made of."""

    time: float


@dataclass(frozen=True)
class PublisherEvent(Event):
    """Something has happened at a publisher of a topic."""

    topic: str
    publisher: str


@dataclass(frozen=True)
class SomChanged(Event):
    """The services to watch are those of `som` now."""

    som: Som


@dataclass(frozen=True)
class Subscribed(Event):
    """A topic is subscribed: who publishes it can be heard from now on."""

    topic: str


@dataclass(frozen=True)
class SubstitutionsChanged(Event):
    """New rows of the table of substitutions, or its `whole`, and nodes whose rows are gone."""

    rows: Tuple[Substitution, ...]
    removed: Tuple[str, ...] = ()
    whole: bool = False


@dataclass(frozen=True)
class FormerlyHealthy(Event):
    """These publishers did well under a former monitor: they are given no time to come up."""

    publishers: Tuple[Key, ...]


@dataclass(frozen=True)
class Connected(PublisherEvent):
    """A connection to a publisher at `uri` was made, the first one or after an interruption."""

    uri: str = ""


@dataclass(frozen=True)
class Disconnected(PublisherEvent):
    """A publisher is gone; `certain`: its node is, else it may be cut off, or `left` the topic."""

    certain: bool = True
    left: bool = False


@dataclass(frozen=True)
class Interrupted(PublisherEvent):
    """The last connection was lost, but the node lives: a new one follows, or Disconnected."""


@dataclass(frozen=True)
class Message(PublisherEvent):
    """A message came."""

    values: Optional[Tuple[Optional[float], ...]] = None  # of checked_provisions; None: not read
    error: str = ""  # why it could not be decoded
    age: Optional[float] = None  # s since its stamp; None: it has none
    waited: float = 0.0  # s, at most, for the monitor to read it
    apart: Optional[float] = None  # s of simulated time from ours so far; None: there is none
    stamp: int = 0  # in ns, as it came; 0: it has none
    form: Parts = ()  # its frames and the lengths of its arrays
    foreign: str = ""  # why it is none of the topic's type, which no consumer hears


@dataclass(frozen=True)
class Tick(Event):
    """Time passes: all that came before is handled. The monitor woke `late`, by so many s."""

    late: float = 0.0


@dataclass(frozen=True)
class ClockTicked(Event):
    """ROS time was `ros_time` s."""

    ros_time: float
    simulated: bool = False  # it comes from /clock, and not from this computer
    waited: Tuple[Tuple[str, float], ...] = ()  # s for a processor so far, by node; "": of any here


@dataclass(frozen=True)
class Ending(Event):
    """The launch of these nodes ends: they are not missed. No nodes: the monitor's own launch."""

    nodes: Tuple[str, ...] = ()


@dataclass(frozen=True)
class HealthChanged:
    """New and changed rows of the table of health, and those that are gone."""

    time: float
    rows: Tuple[PublisherHealth, ...]
    removed: Tuple[Key, ...] = ()
    failed: Tuple[PublisherHealth, ...] = ()  # of new failures, also of who is forgotten at once


@dataclass(frozen=True)
class ChangeRefused:
    """Changed numbers of a service are refused, since a healthy publisher violates them."""

    service: Service  # with the numbers that count
    text: str  # what was to change, and what the publisher does


Command = Union[HealthChanged, ChangeRefused, CalibrationsChanged, Log]
