"""Several substitutes in one process: each has a core and a row of its own."""
import math
from collections import defaultdict
from typing import DefaultDict, Dict, Iterable, List, NamedTuple, Optional, Tuple

from shsa_core.dispatch import Table, table
from shsa_core.model.substitution import Substitution
from shsa_core.substitution import events
from shsa_core.substitution.events import Command, Event, Level, Log
from shsa_core.substitution.machine import Substitute

Services = Dict[str, None]


class _Wants(NamedTuple):
    """What a substitute waits for since its last event: when it wakes and reads inputs, in s."""

    wake: float
    hurries: bool
    reads_at: float


class Sharing:
    """The substitutes of a process, by the service of each; an event goes to those it concerns.

    One comes with its row, and leaves once that is taken out of the table. One that gives up says
    that it has no value, so that another takes its place; the others go on.
    """

    def __init__(self) -> None:
        self._node = Substitution("", "", (), "", ())
        self._cores: Dict[str, Substitute] = {}
        self._topics: Dict[str, str] = {}
        self._wants: Dict[str, _Wants] = {}
        self._advertised: Dict[str, Services] = {}  # topics, by service
        self._reads: DefaultDict[str, Services] = defaultdict(dict)  # services, by topic
        self._speaks: DefaultDict[str, Services] = defaultdict(dict)
        self._handlers: Table[List[Command]] = table(
            Event,
            {
                events.Started: self._started,
                events.RowChanged: self._row_changed,
                events.RowRemoved: self._row_removed,
                events.LeftAlone: self._left_alone,
                events.PlansChanged: lambda event: [],  # nobody here is idle
                events.InputArrived: lambda e: self._tell(e, self._reads.get(e.topic, ())),
                events.Advertised: self._of_topic,
                events.ConsumerJoined: self._of_topic,
                events.SubscribersFound: self._of_topic,
                events.CallFailed: self._call_failed,
                events.OriginalServes: lambda e: self._tell(e, self._of(e.look.topic)),
                events.OtherHeard: self._of_topic,
                events.OtherGone: self._of_topic,
                events.OthersStand: lambda e: self._tell(e, self._of(e.look.topic)),
                events.ReachChanged: lambda event: self._tell(event, self._cores),
                events.Tick: self._tick,
            },
        )

    def handle(self, event: Event) -> List[Command]:
        """The commands that an event calls for."""
        return self._handlers[type(event)](event)

    def next_deadline(self) -> Optional[float]:
        """When the next Tick is wanted; None: not before another event."""
        soonest = min((wants.wake for wants in self._wants.values()), default=math.inf)
        return None if soonest == math.inf else soonest

    @property
    def hurries(self) -> bool:
        """Whether what arrives is waited for by one of them."""
        return any(wants.hurries for wants in self._wants.values())

    @property
    def reads_at(self) -> float:
        """When one of them computes from its inputs next, in s."""
        return min((wants.reads_at for wants in self._wants.values()), default=math.inf)

    def validate(self) -> None:
        """Raises ShsaError if what must always hold of one of them does not."""
        for core in self._cores.values():
            core.validate()

    def _started(self, event: events.Started) -> List[Command]:
        self._node = event.row
        return []

    def _row_changed(self, event: events.RowChanged) -> List[Command]:
        name = event.row.service
        commands: List[Command] = []
        self._topics[name] = next(iter(event.row.topics), "")
        if name not in self._cores:
            self._cores[name] = Substitute()
            started = events.Started(event.time, event.row, event.unusable, event.ros_time)
            commands = self._tell(started, [name])
        return commands + (self._tell(event, [name]) if name in self._cores else [])

    def _row_removed(self, event: events.RowRemoved) -> List[Command]:
        if not event.ended:
            return self._tell(event, [event.service] if event.service in self._cores else [])
        return self._drop(event.service)

    def _left_alone(self, event: events.LeftAlone) -> List[Command]:
        """Those who publish go on; where nobody does, the process may end."""
        if any(core.publishing for core in self._cores.values()):
            return []
        return [events.GiveUp(events.LEFT_ALONE)]

    def _of_topic(self, event: events.OfTopic) -> List[Command]:
        return self._tell(event, self._of(event.topic))

    def _of(self, topic: str) -> Iterable[str]:
        return self._speaks.get(topic, ())

    def _call_failed(self, event: events.CallFailed) -> List[Command]:
        return [Log(Level.WARNING, f"{event.what}: {event.detail}")]

    def _tick(self, event: events.Tick) -> List[Command]:
        due = [name for name, wants in self._wants.items() if wants.wake <= event.time]
        return self._tell(event, due)

    def _tell(self, event: Event, names: Iterable[str]) -> List[Command]:
        """Have some substitutes handle an event, and note what follows for the next ones."""
        commands: List[Command] = []
        for name in list(names):
            core = self._cores[name]
            for command in core.handle(event):
                commands += self._heed(name, command)
            if name in self._cores:
                wake = core.next_deadline()
                wake = math.inf if wake is None else wake
                self._wants[name] = _Wants(wake, core.hurries, core.reads_at)
        return commands

    def _heed(self, name: str, command: Command) -> List[Command]:
        """What a substitute's command means for the process."""
        if isinstance(command, events.Listen):
            for signal in command.inputs:
                self._reads[signal.topic][name] = None
        elif isinstance(command, events.Advertise):
            self._advertised.setdefault(name, {})[command.topic] = None
            self._speaks[command.topic][name] = None
        elif isinstance(command, events.Withdraw):
            for topic in command.topics:
                self._forget(name, topic)
        elif isinstance(command, events.Log):
            return [Log(command.level, f"{name}: {command.text}")]
        elif isinstance(command, events.GiveUp):
            said = Log(Level.ERROR, f"{name}: {command.reason}")
            told = events.TellNoValue(name, self._topics[name])
            return [said, *self._drop(name), told]
        return [command]

    def _drop(self, name: str) -> List[Command]:
        """A substitute ends; what it has subscribed stays so."""
        if self._cores.pop(name, None) is None:
            return []
        self._wants.pop(name, None)
        del self._topics[name]
        for readers in self._reads.values():
            readers.pop(name, None)
        topics: Tuple[str, ...] = tuple(self._advertised.get(name, ()))
        for topic in topics:
            self._forget(name, topic)
        return [events.Withdraw(topics)] if topics else []

    def _forget(self, name: str, topic: str) -> None:
        self._advertised.get(name, {}).pop(topic, None)
        self._speaks[topic].pop(name, None)
