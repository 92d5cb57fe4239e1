"""Which connections wake the thread that reads them, and which are read when it is awake anyway."""
from typing import Callable, Iterable, Set

from shsa_core.ros.sockets.inbox import Inbox
from shsa_core.ros.sockets.stream import Connection


class Waking:
    """A connection wakes if its topic `wakes`, or if it is large: who sends that would wait."""

    def __init__(self, inbox: Inbox, wakes: Callable[[str], bool]) -> None:
        self._inbox, self._wakes = inbox, wakes
        self._waiting: Set[int] = set()
        self._large: Set[int] = set()

    @property
    def waits(self) -> bool:
        """Whether there are connections that wake nobody, and are to be read all the same."""
        return bool(self._waiting)

    def add(self, connection: Connection) -> None:
        """Watch a new connection."""
        wakes = self._wakes(connection.topic)
        try:
            self._inbox.watch(connection.descriptor, wakes)
        except OSError:
            return  # it has just been closed, which we are told next
        if not wakes:
            self._waiting.add(connection.descriptor)

    def drop(self, connection: Connection) -> None:
        """A connection has ended."""
        self._waiting.discard(connection.descriptor)
        self._large.discard(connection.descriptor)

    def was_read(self, connection: Connection) -> None:
        """A part of a message is left: the rest of it, and what follows, is read as it comes."""
        if connection.descriptor in self._waiting and len(connection.frames):
            self._large.add(connection.descriptor)
            self.ask([connection])

    def ask(self, connections: Iterable[Connection]) -> None:
        """Ask of each connection's topic again whether it wakes."""
        for connection in connections:
            descriptor = connection.descriptor
            wakes = descriptor in self._large or self._wakes(connection.topic)
            if wakes is (descriptor not in self._waiting):
                continue
            try:
                self._inbox.watch_otherwise(descriptor, wakes)
            except OSError:
                continue  # it has just been closed, which we are told next
            (self._waiting.discard if wakes else self._waiting.add)(descriptor)
