"""Advertises the topics of a substitute, tells consumers of them, and takes them back.

A rospy subscriber that is told twice, by us and by the master, may connect twice at the same time.
Then each end drops a connection, now and then not the same one, and none is left: nobody but us
would ever tell it again. And the master tells nobody of anything while three subscribers hang.
"""
from itertools import count
from typing import Collection, Dict, Iterable, List, Tuple

from shsa_core.agenda import Agenda
from shsa_core.model.service import Signal
from shsa_core.substitution import settings
from shsa_core.substitution.events import Advertise, Command, Remind, Withdraw


class Advertising:
    """The topics of a substitute that are not withdrawn. Times in s."""

    def __init__(self) -> None:
        self._topics: Dict[str, bool] = {}  # if messages can be published on each
        self._leaving: Agenda[str] = Agenda()
        self._hurried = ""  # of this topic we tell the consumers first, of others the master does
        self._reminders: List[float] = []  # of those who have not connected

    @property
    def topics(self) -> Tuple[str, ...]:
        """Return every topic that is not withdrawn."""
        return tuple(self._topics)

    def ready(self, topic: str) -> bool:
        """Return if messages can be published on a topic."""
        return self._topics.get(topic, False)

    def prepare(self, outputs: Iterable[Signal]) -> List[Command]:
        """Advertise the topics of `outputs`, without a hurry."""
        commands: List[Command] = []
        for each in outputs:
            if each.topic not in self._topics:
                self._topics[each.topic] = False
                commands.append(Advertise(each.topic, each.type, each.latched))
        return commands

    def leave_all_but(self, wanted: Collection[str], begin: float) -> None:
        """Withdraw all topics but those `wanted`, one after the other from a moment on."""
        self._hurried = ""
        moments = count(begin, settings.WITHDRAW_PAUSE_S)
        for name in self._topics:
            self._leaving.set(name, None if name in wanted else next(moments))

    def hurry(self, output: Signal, now: float) -> List[Command]:
        """Advertise the topic of `output`, and soon no others."""
        commands = self.prepare([output])
        self.leave_all_but([output.topic], now + settings.WITHDRAW_DELAY_S)
        self._hurried = output.topic
        self._remind_from(now)
        return commands

    def advertised(self, name: str, now: float) -> None:
        """A topic can be published on; where there is a hurry, tell everybody at once."""
        if self._topics.get(name, True):
            return  # it was withdrawn meanwhile
        self._topics[name] = True
        if self._hurried in ("", name):
            self._remind_from(now)
            self._reminders[:0] = [now] if self._hurried else []

    def _remind_from(self, now: float) -> None:
        """Remind all at once: one call to the master tells of all topics, and may take long."""
        pauses = settings.ANNOUNCE_S if self._hurried else settings.ANNOUNCE_S[3:]
        self._reminders = [now + each for each in pauses]

    def due(self, now: float) -> List[Command]:
        """Return the withdrawals and reminders that are due."""
        leaving = self._leaving.pop_due(now)
        for name in leaving:
            del self._topics[name]
        commands: List[Command] = []
        if self._reminders and self._reminders[0] <= now:
            self._reminders = [each for each in self._reminders if each > now]
            wanted = [self._hurried] if self._hurried else sorted(self._topics)
            named = tuple(filter(self.ready, wanted))
            commands += [Remind(named)] if named else []
        return commands + [Withdraw(name) for name in leaving]

    def next(self) -> float:
        """Return when something is due next; infinite: never."""
        return min([self._leaving.next(), *self._reminders[:1]])
