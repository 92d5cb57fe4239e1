"""Hears what a substitute computes from, and what others publish on its topics.

Muted, most of it never matters: to wake for each message would be most of what standing by costs.
So it is read when the core wakes anyway, many at once, each with the time at which it had come; and
of what nobody reads yet the newest is kept, and decoded once somebody does.
"""
from typing import Callable, Dict, Iterable, List, Optional, Set, Tuple

import rospy

from shsa_core.errors import ShsaError
from shsa_core.model.service import Signal
from shsa_core.monitoring.events import Disconnected
from shsa_core.ros import clock
from shsa_core.ros.messages.fields import stamp
from shsa_core.ros.processes import priority
from shsa_core.ros.sockets.subscriptions import Arrived, Subscriptions
from shsa_core.substitution.events import Event, InputArrived, OtherGone, OtherHeard, Overhear


class Inputs:
    """Events for one thread: what others put, and what that thread reads from the connections.

    `rests`: the priority of the process while what it does does not matter; None: as it is.
    """

    def __init__(self, robot_clock: clock.RobotClock, rests: Optional[int] = None) -> None:
        self._rests = rests
        self._subscriptions = Subscriptions(robot_clock.now, _refused, self._wakes)
        self._inbox = self._subscriptions.inbox
        self.put: Callable[[Event], None] = self._inbox.put  # from any thread
        self.wait = self._inbox.wait  # of the one that reads
        self._hurries = True
        self._types: Dict[str, str] = {}
        self._fields: Dict[str, Tuple[str, ...]] = {}
        self._read: Set[str] = set()
        self._overheard: Dict[str, str] = {}  # by topic: whose message is kept
        self._newest: Dict[Tuple[str, str], Tuple[float, Arrived]] = {}  # since when one is kept
        self._last: Dict[str, Tuple[str, bytes]] = {}  # by topic: from whom, and what

    # From any thread.

    def read(self, topics: Iterable[str]) -> None:
        """Have these topics read by a program, and not just prepared for."""
        if not self._read.issuperset(topics):
            self._read = self._read.union(topics)
            self._inbox.put(None)

    # From the one thread that may wait for the master.

    def listen(self, signal: Signal) -> None:
        """Hear a field of a topic; what was subscribed once stays so."""
        fields = self._fields.get(signal.topic, ())
        if signal.field not in fields:
            self._fields[signal.topic] = (*fields, signal.field)
        self._subscribe(signal.topic, signal.type)

    def overhear(self, command: Overhear) -> None:
        """Hear what others publish on a topic; keep the last message of one, or of any."""
        topic, provider = command.topic, command.provider
        self._overheard[topic] = provider
        if provider not in ("", self._last.get(topic, ("", b""))[0]):
            self._last.pop(topic, None)
        self._subscribe(topic, command.type)
        self._inbox.put(None)

    def _subscribe(self, topic: str, kind: str) -> None:
        if topic not in self._types:
            self._types[topic] = kind
            self._subscriptions.subscribe(topic)

    # From the reading thread.

    def take(self, reads: bool) -> List[Event]:
        """Return what has come so far, in order; inputs that were kept only if it `reads` now.

        It does so as well if anything comes but what others publish.
        """
        items = self._inbox.take()
        if None in items:
            self._subscriptions.choose_waking()
        events: List[Event] = [each for each in items if each is not None]
        for happening in self._subscriptions.read():
            if isinstance(happening, Arrived):
                events += self._arrived(happening)
            elif isinstance(happening, Disconnected):
                gone = happening.topic, happening.publisher
                if happening.topic not in self._read and (happening.certain or happening.left):
                    self._newest.pop(gone, None)
                if happening.topic in self._overheard:
                    events.append(OtherGone(happening.time, *gone))
        if reads or not all(isinstance(event, OtherHeard) for event in events):
            for key in [key for key in self._newest if key[0] in self._read]:
                events += self._input(*self._newest.pop(key))
        return sorted(events, key=lambda event: event.time)

    def hurry(self, hurries: bool) -> None:
        """Have what arrives waited for from now on, or not."""
        if hurries is self._hurries:
            return
        self._hurries = hurries
        self._subscriptions.choose_waking()
        if self._rests is not None:
            priority.set_all(priority.HURRIES if hurries else self._rests)

    def last(self, topic: str) -> bytes:
        """Return the last message that was kept on a topic, serialized; empty: there is none."""
        return self._last.get(topic, ("", b""))[1]

    def stands(self, topic: str, publisher: str) -> bool:
        """Return whether a connection to a publisher stands; all that came on it was told."""
        return publisher in self._subscriptions.publishers(topic)

    def _wakes(self, topic: str) -> bool:
        return self._hurries and (topic in self._read or topic in self._overheard)

    def _arrived(self, arrived: Arrived) -> List[Event]:
        connection, topic = arrived.connection, arrived.connection.topic
        events = self._other(arrived) if topic in self._overheard else []
        if topic in self._fields:
            if self._hurries and topic in self._read:
                events += self._input(arrived.time, arrived)
            else:
                key = topic, connection.publisher
                since, _ = self._newest.get(key, (arrived.time, arrived))
                self._newest[key] = since, arrived
        return events

    def _other(self, arrived: Arrived) -> List[Event]:
        """Keep what somebody else has published on a topic that is overheard."""
        time, connection, data, _, ros_time, _ = arrived
        topic = connection.topic
        decoder = connection.decoder(self._types[topic], self._fields.get(topic, ()))
        if decoder is None:
            return []
        if self._overheard[topic] in ("", connection.publisher):
            self._last[topic] = connection.publisher, data
        stamped = min(stamp(data), ros_time) if decoder.has_stamp else 0
        return [OtherHeard(time, topic, connection.publisher, stamped)]

    def _input(self, since: float, arrived: Arrived) -> List[Event]:
        """Read the fields of a message; none if it cannot be read, and a warning."""
        time, connection, data, _, ros_time, _ = arrived
        topic, publisher = connection.topic, connection.publisher
        fields = self._fields[topic]
        decoder = connection.decoder(self._types[topic], fields)
        if decoder is None:
            return []
        try:
            values = decoder.values(data)
        except ShsaError as error:
            connection.warn(error)
            return []
        known = tuple((name, each) for name, each in zip(fields, values) if each is not None)
        stamped = stamp(data) if decoder.has_stamp else 0
        return [InputArrived(time, topic, publisher, known, stamped, ros_time, time - since)]


def _refused(topic: str, claim: str, why: str) -> None:
    text = f"A publisher of {topic} claims to be {claim} and is ignored: {why}"
    rospy.logwarn_throttle_identical(60.0, text)
