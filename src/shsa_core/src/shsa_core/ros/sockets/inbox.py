"""What one thread waits for: items that other threads put, and sockets that become readable."""
import os
import select
from collections import deque
from contextlib import suppress
from typing import Any, Deque, List, Set


class Inbox:
    """Waits on the monotonic clock: a jump of the wall clock neither wakes nor holds its reader."""

    def __init__(self) -> None:
        self._items: Deque[Any] = deque()
        self._reader, self._writer = os.pipe()
        os.set_blocking(self._reader, False)
        self._poll = select.epoll()
        self._poll.register(self._reader, select.EPOLLIN)
        self._later = select.epoll()
        self._hung_up = select.epoll()
        self._woken = False

    def put(self, item: Any, wakes: bool = True) -> None:
        """Add an item and wake the reader, unless it is in no hurry for it; from any thread."""
        self._items.append(item)
        if wakes and not self._woken:
            self._woken = True
            os.write(self._writer, b"!")

    def watch(self, descriptor: int, wakes: bool = True) -> None:
        """Wait for this descriptor as well; it is forgotten when it is closed.

        One that does not wake is among the ready ones alone.
        """
        poll = self._poll if wakes else self._later
        poll.register(descriptor, select.EPOLLIN | select.EPOLLRDHUP)
        self._hung_up.register(descriptor, select.EPOLLRDHUP)

    def watch_otherwise(self, descriptor: int, wakes: bool) -> None:
        """Have a watched descriptor wake from now on, or not."""
        before, after = (self._later, self._poll) if wakes else (self._poll, self._later)
        before.unregister(descriptor)
        after.register(descriptor, select.EPOLLIN | select.EPOLLRDHUP)

    def wait(self, timeout: float) -> None:
        """Sleep for at most `timeout` s, or until there is something, or a descriptor hangs up."""
        _wait(timeout, self._poll, self._hung_up)

    def rest(self, timeout: float) -> None:
        """Sleep for `timeout` s whatever is sent, but no longer once a descriptor has hung up."""
        _wait(timeout, self._hung_up)

    def ready(self) -> Set[int]:
        """The watched descriptors that are readable now."""
        polled = [*self._poll.poll(0), *self._later.poll(0)]
        found = {descriptor for descriptor, _ in polled}
        found.discard(self._reader)
        return found

    def take(self) -> List[Any]:
        """What has been put so far, in order."""
        with suppress(BlockingIOError):  # whoever wakes us may be about to
            os.read(self._reader, 4096)
        self._woken = False
        return [self._items.popleft() for _ in range(len(self._items))]


def _wait(timeout: float, *polled: Any) -> None:
    """As `epoll.poll(timeout)`, which rounds up to whole ms: too long for what is due at 1 kHz."""
    select.select(polled, (), (), max(0.0, timeout))
