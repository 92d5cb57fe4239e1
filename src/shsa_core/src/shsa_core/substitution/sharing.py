"""Several substitutes in one process: each has a core and a row of its own."""
import math
from collections import defaultdict
from dataclasses import replace
from typing import Any, Callable, DefaultDict, Dict, Iterable, List

from shsa_core.dispatch import Table, table
from shsa_core.model.log import Level
from shsa_core.substitution import events
from shsa_core.substitution.events import Command, Event, Log
from shsa_core.substitution.machine import Substitute


class Sharing:
    """The substitutes of a process, by the service of each; an event goes to those it concerns.

    One comes with its row, and leaves once that is taken out of the table. One that gives up says
    that it has no value, so that another takes its place; the others go on.
    """

    def __init__(self) -> None:
        self._cores: Dict[str, Substitute] = {}
        self._concerned: DefaultDict[str, Dict[str, None]] = defaultdict(dict)  # by topic
        of_topic: Callable[[Any], List[Command]] = lambda e: self._tell(e, self._concerned[e.topic])
        self._handlers: Table[List[Command]] = table(
            Event,
            {
                events.RowChanged: self._row_changed,
                events.RowRemoved: self._row_removed,
                events.PlansChanged: lambda event: [],  # nobody here is idle
                events.InputArrived: of_topic,
                events.Advertised: of_topic,
                events.ConsumerJoined: of_topic,
                events.OriginalServes: lambda e: self._tell(e, self._concerned[e.look.topic]),
                events.OtherHeard: of_topic,
                events.OtherGone: of_topic,
                events.OthersStand: lambda e: self._tell(e, self._concerned[e.look.topic]),
                events.ReachChanged: self._reach_changed,
                events.FailureHeard: lambda event: [],
                events.Tick: self._tick,
            },
        )

    def handle(self, event: Event) -> List[Command]:
        """Return the commands that an event calls for."""
        return self._handlers[type(event)](event)

    @property
    def next_deadline(self) -> float:
        """Return when the next Tick is wanted; inf: not before another event."""
        return min((core.next_deadline for core in self._cores.values()), default=math.inf)

    @property
    def hurries(self) -> bool:
        """Return if what arrives is waited for by one of them."""
        return any(core.hurries for core in self._cores.values())

    @property
    def reads_at(self) -> float:
        """Return when one of them computes from its inputs next, in s."""
        return min((core.reads_at for core in self._cores.values()), default=math.inf)

    def _row_changed(self, event: events.RowChanged) -> List[Command]:
        name = event.row.service
        self._cores.setdefault(name, Substitute())
        return self._tell(event, [name])

    def _row_removed(self, event: events.RowRemoved) -> List[Command]:
        if event.ended:
            return self._drop(event.service)
        return self._tell(event, [event.service] if event.service in self._cores else [])

    def _reach_changed(self, event: events.ReachChanged) -> List[Command]:
        """Those who publish go on; alone, where nobody does, the process may end."""
        if event.alone and not any(core.publishing for core in self._cores.values()):
            return [events.GiveUp(events.LEFT_ALONE)]
        return self._tell(replace(event, alone=False), self._cores)

    def _tick(self, event: events.Tick) -> List[Command]:
        due = (name for name, core in self._cores.items() if core.next_deadline <= event.time)
        return self._tell(event, due)

    def _tell(self, event: Event, names: Iterable[str]) -> List[Command]:
        commands: List[Command] = []
        for name in list(names):
            for command in self._cores[name].handle(event):
                commands += self._heed(name, command)
        return commands

    def _heed(self, name: str, command: Command) -> List[Command]:
        """Return what a substitute's command means for the process."""
        if isinstance(command, events.Listen):
            self._concerned[command.signal.topic][name] = None
        elif isinstance(command, events.Advertise):
            self._concerned[command.topic][name] = None
        elif isinstance(command, events.Log):
            return [Log(command.level, f"{name}: {command.text}")]
        elif isinstance(command, events.GiveUp):
            said = Log(Level.ERROR, f"{name}: {command.reason}")
            told = events.TellNoValue(name, next(iter(self._cores[name].row.topics), ""))
            return [said, *self._drop(name), told]
        return [command]

    def _drop(self, name: str) -> List[Command]:
        """End a substitute; what it has subscribed stays so."""
        core = self._cores.pop(name, None)
        for concerned in self._concerned.values():
            concerned.pop(name, None)
        used = {topic for other in self._cores.values() for topic in other.topics}
        topics = core.topics if core else ()
        return [events.Withdraw(topic) for topic in topics if topic not in used]
