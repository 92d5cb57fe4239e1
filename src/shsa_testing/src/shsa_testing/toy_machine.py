"""A tiny machine of the shape of the three, for tests of the journal."""
from dataclasses import dataclass
from enum import Enum
from typing import Any, Callable, Dict, FrozenSet, List, Mapping, Optional, Tuple, Union

from shsa_core.errors import ShsaError
from shsa_core.journal.machines import MachineKind
from shsa_core.model.checks import Check
from shsa_core.model.som import Som


class Colour(Enum):
    RED = 1
    BLUE = 2


@dataclass(frozen=True)
class Point:
    x: float
    y: float = 0.0


@dataclass(frozen=True)
class Added:
    """A number to add, and one of everything that an event may hold."""

    time: float
    number: float = 0.0
    point: Optional[Point] = None
    points: Tuple[Point, ...] = ()
    key: Tuple[str, bool] = ("", False)
    colour: Colour = Colour.RED
    either: Union[None, bool, float] = None
    check: Optional[Check] = None
    named: Optional[Mapping[str, int]] = None
    text: str = ""
    names: FrozenSet[str] = frozenset()


@dataclass(frozen=True)
class SomChanged:
    time: float
    som: Som


@dataclass(frozen=True)
class Tick:
    time: float


@dataclass(frozen=True)
class Show:
    total: float


@dataclass(frozen=True)
class Log:
    text: str


Event = Union[Added, SomChanged, Tick]
Command = Union[Show, Log]


class Adder:
    """Adds up numbers and shows the sum.

    A sum above `limit` breaks its invariant, a number of 13 raises.
    """

    def __init__(self, som: Som, step: float = 1.0, limit: float = 100.0) -> None:
        self.som = som
        self.step = step
        self.limit = limit
        self.total = 0.0

    def handle(self, event: Event) -> List[Command]:
        """Do what the event says."""
        handlers: Dict[type, Callable[[Any], List[Command]]] = {
            Added: self._added,
            SomChanged: lambda changed: [Log(f"{len(changed.som)} services")],
            Tick: lambda tick: [],
        }
        return handlers[type(event)](event)

    def validate(self) -> None:
        """Raises ShsaError if the sum is too large."""
        if self.total > self.limit:
            raise ShsaError(f"the sum {self.total:g} is above {self.limit:g}")

    def _added(self, event: Added) -> List[Command]:
        if event.number == 13.0:
            raise ValueError("13 is not added")
        self.total += event.number * self.step
        return [Show(self.total), Log(f"added {event.number:g} {event.text}")]


ADDER = MachineKind("adder", Adder, Event, Command)
