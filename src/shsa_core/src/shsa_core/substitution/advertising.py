"""Advertises the topics of a substitute, tells consumers of them, and takes them back.

A rospy subscriber that is told twice, by us and by the master, may connect twice at the same time.
Then each end drops a connection, now and then not the same one, and none is left: nobody but us
would ever tell it again. And the master tells nobody of anything while three subscribers hang.
"""
import math
from itertools import count
from typing import Collection, Dict, Iterable, List, Tuple

from shsa_core.agenda import Agenda
from shsa_core.model.service import Signal
from shsa_core.substitution.events import (
    Advertise,
    Announce,
    Command,
    Remind,
    Withdraw,
)
from shsa_core.substitution.settings import (
    ANNOUNCE_S,
    TOGETHER_S,
    WITHDRAW_DELAY_S,
    WITHDRAW_PAUSE_S,
)


class _Topic:
    """A topic that is advertised, or about to be. Times in s."""

    def __init__(self, type: str) -> None:
        self.type = type
        self.ready = False
        self.hurries = False  # else the master tells the consumers first
        self.reminders: List[float] = []  # of those who have not connected
        self.leaves = math.inf

    def remind_from(self, now: float) -> None:
        pauses = ANNOUNCE_S if self.ready else ()
        self.reminders = [now + each for each in pauses if self.hurries or each >= TOGETHER_S]


class Advertising:
    """The topics of a substitute that are not withdrawn."""

    def __init__(self) -> None:
        self._topics: Dict[str, _Topic] = {}
        self._due: Agenda[str] = Agenda()

    def _expect(self, name: str) -> None:
        """Look at a topic again when something of it is due."""
        topic = self._topics[name]
        self._due.set(name, min([*topic.reminders[:1], topic.leaves]))

    @property
    def topics(self) -> Tuple[str, ...]:
        """Return every topic that is not withdrawn."""
        return tuple(self._topics)

    def ready(self, topic: str) -> bool:
        """Return if messages can be published on a topic."""
        return topic in self._topics and self._topics[topic].ready

    def prepare(self, outputs: Iterable[Signal]) -> List[Command]:
        """Advertise the topics of `outputs`, without a hurry."""
        commands: List[Command] = []
        for each in outputs:
            if each.topic not in self._topics:
                self._topics[each.topic] = _Topic(each.type)
                commands.append(Advertise(each.topic, each.type, each.latched))
        return commands

    def leave_all_but(self, wanted: Collection[str], begin: float) -> None:
        """Withdraw all topics but those `wanted`, one after the other from a moment on."""
        moments = count(begin, WITHDRAW_PAUSE_S)
        for name, topic in self._topics.items():
            topic.leaves = math.inf if name in wanted else next(moments)
            self._expect(name)

    def hurry(self, output: Signal, now: float) -> List[Command]:
        """Advertise the topic of `output`, and soon no others."""
        commands = self.prepare([output])
        topic = self._topics[output.topic]
        topic.hurries = True
        topic.remind_from(now)
        self.leave_all_but([output.topic], now + WITHDRAW_DELAY_S)
        return commands

    def advertised(self, name: str, now: float) -> List[Command]:
        """A topic can be published on; where there is a hurry, tell everybody at once."""
        topic = self._topics.get(name)
        if topic is None or topic.ready:
            return []  # it was withdrawn meanwhile
        topic.ready = True
        topic.remind_from(now)
        self._expect(name)
        return [Announce(name, topic.type)] if topic.hurries else []

    def due(self, now: float) -> List[Command]:
        """Return the withdrawals and reminders that are due.

        With one go those without a hurry that would be due soon: one call to the master tells of
        all topics.
        """
        due = self._due.pop_due(now)
        leaving = tuple(name for name in due if self._topics[name].leaves <= now)
        for name in leaving:
            del self._topics[name]
        remind = []
        for name, topic in self._topics.items() if len(leaving) < len(due) else ():
            reached = now if topic.hurries else now + TOGETHER_S
            later = [each for each in topic.reminders if each > reached]
            remind += [name] if len(later) < len(topic.reminders) else []
            topic.reminders = later
            self._expect(name)
        commands: List[Command] = [Remind(tuple(remind))] if remind else []
        return commands + ([Withdraw(leaving)] if leaving else [])

    def next(self) -> float:
        """Return when something is due next; infinite: never."""
        due = self._due.next()
        return math.inf if due is None else due
