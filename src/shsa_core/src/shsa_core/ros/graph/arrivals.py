"""What a substitute's threads have heard, told to its core once it matters.

Muted, most of it never does: to wake for each message would be most of what standing by costs.
"""
import sys
import threading
from typing import Dict, Iterable, List, Set, Tuple

from shsa_core.ros.graph import priority
from shsa_core.ros.graph.inbox import Inbox
from shsa_core.substitution.events import Event, InputArrived, OtherHeard


class Arrivals:
    """Events for one thread; inputs and what others publish wake it while they are waited for.

    `many`: the process may have hundreds of threads, which switch less often while it is calm.
    `lowered`: so is its priority, until what it does matters.
    """

    def __init__(self, many: bool = False, lowered: bool = False) -> None:
        self._inbox = Inbox()
        self._many, self._lowered = many, lowered
        self._hurries = True
        self._read: Set[str] = set()
        self._newest: Dict[Tuple[str, str], InputArrived] = {}
        self._unread: Set[int] = set()  # the threads that bring what nobody reads

    def read(self, topics: Iterable[str]) -> None:
        """These topics are read by a program, and not just prepared for."""
        self._read.update(topics)

    def put(self, event: Event) -> None:
        """Add an event and wake the reader; from any thread, as what follows."""
        self._inbox.put(event)

    def put_input(self, event: InputArrived) -> None:
        """Add an input; where nobody waits for it the newest of a publisher is kept."""
        if self._hurries and event.topic in self._read:
            if self._lowered:
                priority.restore()
            self._inbox.put(event)
        else:
            if self._lowered:
                self._unread.add(threading.get_native_id())
            self._newest[event.topic, event.publisher] = event

    def put_other(self, event: OtherHeard) -> None:
        """Add what somebody else has published."""
        self._inbox.put(event, wakes=self._hurries)

    def wait(self, timeout: float) -> None:
        """Sleep for at most `timeout` s, or until there is something that matters."""
        self._inbox.wait(timeout)
        self._inbox.ready()

    def take(self, reads: bool) -> List[Event]:
        """What has come so far, in order; inputs that were kept only if somebody `reads` them now.

        So it is if anything comes but what others publish.
        """
        taken: List[Event] = self._inbox.take()
        if not reads and all(isinstance(event, OtherHeard) for event in taken):
            return taken
        read = [key for key in list(self._newest) if key[0] in self._read]
        newest = [self._newest.pop(key) for key in read]
        return sorted([*newest, *taken], key=lambda event: event.time)

    def hurry(self, hurries: bool) -> None:
        """Whether what arrives is waited for from now on; told by the reader."""
        if hurries is self._hurries:
            return
        self._hurries = hurries
        if hurries and self._lowered:
            priority.restore_all(frozenset(self._unread))
        if self._many:
            interval = priority.SWITCH_INTERVAL_S if hurries else priority.CALM_INTERVAL_S
            sys.setswitchinterval(interval)
