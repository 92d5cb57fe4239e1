"""Which topics a substitute has advertised, to whom, and when it takes them back.

A rospy subscriber that is told twice, by us and by the master, may connect twice at the same time.
Then each end drops a connection, now and then not the same one, and none is left: nobody but us
would ever tell it again. And the master tells nobody of anything while three subscribers hang.
"""
import math
from typing import Collection, Dict, Iterable, List, Set, Tuple

from shsa_core.model.service import Signal
from shsa_core.substitution.events import (
    Advertise,
    Announce,
    Command,
    FindSubscribers,
    SubscribersFound,
    Tell,
    Withdraw,
)
from shsa_core.substitution.settings import Settings


class Advertising:
    """Topics that are advertised, or are about to be."""

    def __init__(self, settings: Settings) -> None:
        self._settings = settings
        self._ready: Dict[str, bool] = {}
        self._hurried: Dict[str, str] = {}  # and the type of each
        self._looks: Dict[str, List[float]] = {}
        self._prepared: Set[str] = set()  # those that are in no hurry
        self._withdrawals: Dict[str, float] = {}

    @property
    def topics(self) -> Tuple[str, ...]:
        """Every topic that is not withdrawn."""
        return tuple(self._ready)

    def ready(self, topic: str) -> bool:
        """Whether messages can be published on a topic."""
        return self._ready.get(topic, False)

    def prepare(self, outputs: Iterable[Signal]) -> List[Command]:
        """Advertise the topics of `outputs`.

        There is no hurry: the master tells the consumers first.
        """
        return [command for each in outputs for command in self._advertise(each)]

    def leave_all_but(self, wanted: Collection[str], now: float) -> None:
        """Withdraw all topics but those `wanted`."""
        self._withdrawals = {topic: now for topic in self._ready if topic not in wanted}

    def take(self, output: Signal, now: float) -> List[Command]:
        """Advertise the topic of `output`, and soon no others.

        Each that is withdrawn takes a call to the master.
        """
        commands = self._advertise(output)
        topic = output.topic
        if self._ready[topic]:
            self._looks[topic] = [now + pause for pause in self._settings.announce_s]
            self._prepared.discard(topic)
        else:
            self._hurried[topic] = output.type
        later = now + self._settings.withdraw_delay_s
        others = (other for other in self._ready if other != topic)
        pause = self._settings.withdraw_pause_s
        self._withdrawals = {other: later + n * pause for n, other in enumerate(others)}
        return commands

    def _advertise(self, output: Signal) -> List[Command]:
        if output.topic in self._ready:
            return []
        self._ready[output.topic] = False
        return [Advertise(output.topic, output.type, output.latched)]

    def advertised(self, topic: str, now: float) -> List[Command]:
        """A topic can be published on; where there is a hurry, everybody is told at once."""
        if topic not in self._ready:
            return []  # it was withdrawn meanwhile
        self._ready[topic] = True
        hurried = self._hurried.pop(topic, None)
        pauses = self._settings.prepare_s if hurried is None else self._settings.announce_s
        if hurried is None:
            self._prepared.add(topic)
        self._looks[topic] = [now + pause for pause in pauses]
        return [] if hurried is None else [Announce(topic, hurried)]

    def found(self, event: SubscribersFound) -> List[Command]:
        """Tell those subscribers again that have not connected."""
        missing = tuple(node for node in event.subscribers if node not in event.connected)
        return [Tell(event.topic, missing)] if missing and event.topic in self._ready else []

    def due(self, now: float) -> List[Command]:
        """What is due: looks, and withdrawals."""
        commands: List[Command] = []
        looking = self._due_looks(now)
        leaving = tuple(topic for topic, at in self._withdrawals.items() if at <= now)
        for topic in leaving:
            del self._ready[topic], self._withdrawals[topic]
            self._looks.pop(topic, None)
            self._prepared.discard(topic)
            self._hurried.pop(topic, None)
        self._looks = {topic: looks for topic, looks in self._looks.items() if looks}
        looking = tuple(topic for topic in looking if topic not in leaving)
        if looking:
            commands.append(FindSubscribers(looking))
        if leaving:
            commands.append(Withdraw(leaving))
        return commands

    def _due_looks(self, now: float) -> Tuple[str, ...]:
        """The topics that are looked at now: of what is prepared, those that soon would be as well.

        One look at the master tells of all of them, and takes long where there are many.
        """
        due = [topic for topic, looks in self._looks.items() if looks[0] <= now]
        if not due:
            return ()
        soon = now + self._settings.together_s
        prepared = [
            topic
            for topic, looks in self._looks.items()
            if topic in self._prepared and now < looks[0] <= soon
        ]
        for topic in due:
            self._looks[topic] = [look for look in self._looks[topic] if look > now]
        for topic in prepared:
            self._looks[topic] = self._looks[topic][1:]
        return (*due, *prepared)

    def next(self) -> float:
        """When something is due next; infinite: never."""
        looks = [looks[0] for looks in self._looks.values()]
        return min([*looks, *self._withdrawals.values()], default=math.inf)
