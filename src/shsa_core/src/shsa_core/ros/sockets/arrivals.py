"""What a substitute's core is told, and when: what it hears, once it matters.

Muted, most of it never does: to wake for each message would be most of what standing by costs. So
it is read when the core wakes anyway, many at once, each with the time at which it had come; and of
what nobody reads yet the newest is kept. Nobody who publishes is held up by that: who sends large
messages is read at once.
"""
from typing import Dict, Iterable, List, Optional, Set, Tuple

from shsa_core.model.service import Signal
from shsa_core.ros import clock
from shsa_core.ros.processes import priority
from shsa_core.ros.sockets.arrival_times import ArrivalTimes
from shsa_core.ros.sockets.connections import Arrived, Happening, Lost
from shsa_core.ros.sockets.hearing import OF_CONNECTIONS, Hearing, Message
from shsa_core.ros.sockets.inbox import Inbox
from shsa_core.substitution.events import Event, OtherHeard

UNREAD_S = 0.02
"""What wakes nobody while other things are waited for is read by then."""


class Arrivals:
    """Events for one thread: what others put, and what that thread reads from the connections.

    `lowered`: the priority of the process is, until what it does matters.
    """

    def __init__(self, name: str, robot_clock: clock.RobotClock, lowered: bool = False) -> None:
        self._inbox = Inbox()
        self._times = ArrivalTimes(robot_clock.now)
        self._hearing = Hearing(name, self._inbox, self._times, self._wakes)
        self._lowered = lowered
        self._hurries = True
        self._read: Set[str] = set()
        self._newest: Dict[Tuple[str, str], Message] = {}

    # From any thread.

    def put(self, event: Event) -> None:
        """Add an event and wake the reader."""
        self._inbox.put(event)

    def read(self, topics: Iterable[str]) -> None:
        """These topics are read by a program, and not just prepared for."""
        new = set(topics) - self._read
        if new:
            self._read = self._read | new
            self._inbox.put(None)

    def listen(self, signal: Signal) -> None:
        """Hear a field of a topic; waits for the master."""
        self._hearing.listen(signal)

    def overhear(self, topic: str, kind: str) -> None:
        """Hear what others publish on a topic; waits for the master."""
        self._hearing.overhear(topic, kind)
        self._inbox.put(None)

    # From the reading thread.

    def wait(self, timeout: float) -> None:
        """Sleep for at most `timeout` s, or until there is something that matters."""
        waits = self._hurries and self._hearing.waits
        self._inbox.wait(min(timeout, UNREAD_S) if waits else timeout)

    def take(self, reads: bool) -> List[Event]:
        """What has come so far, in order; inputs that were kept only if somebody `reads` them now.

        So it is if anything comes but what others publish.
        """
        self._times.look()
        ready = self._inbox.ready()
        items = self._inbox.take()
        if None in items:
            self._hearing.wake()
        changes = [each for each in items if isinstance(each, OF_CONNECTIONS)]
        others = (each for each in items if not isinstance(each, OF_CONNECTIONS))
        events = [each for each in others if each is not None]
        for happening in self._hearing.read(changes, ready):
            events += self._events(happening)
        if reads or not all(isinstance(event, OtherHeard) for event in events):
            for key in [key for key in self._newest if key[0] in self._read]:
                arrived = self._hearing.input(self._newest.pop(key))
                events += [] if arrived is None else [arrived]
        return sorted(events, key=lambda event: event.time)

    def hurry(self, hurries: bool) -> None:
        """Whether what arrives is waited for from now on."""
        if hurries is self._hurries:
            return
        self._hurries = hurries
        self._hearing.wake()
        if self._lowered:
            (priority.restore_all if hurries else priority.lower_all)()

    def last(self, topic: str) -> bytes:
        """The last message of another one on a topic, serialized; empty: there is none."""
        return self._hearing.last(topic)

    def stands(self, topic: str, publisher: str) -> bool:
        """Whether a connection to a publisher stands; all that came on it was told."""
        return self._hearing.stands(topic, publisher)

    def _wakes(self, topic: str) -> bool:
        heard = topic in self._read or self._hearing.is_overheard(topic)
        return self._hurries and heard

    def _events(self, happening: Happening) -> List[Event]:
        if isinstance(happening, Lost):
            gone = self._hearing.gone(happening)
            return [] if gone is None else [gone]
        if not isinstance(happening, Arrived):
            return []
        message = self._hearing.message(happening)
        found: List[Optional[Event]] = [self._hearing.other(message)]
        if self._hearing.is_input(message):
            connection = message.connection
            if self._hurries and connection.topic in self._read:
                found.append(self._hearing.input(message))
            else:
                self._newest[connection.topic, connection.publisher] = message
        return [each for each in found if each is not None]
