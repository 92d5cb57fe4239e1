"""Lets one thread wait for items that others put and for sockets that become readable."""
import os
import select
from collections import deque
from contextlib import suppress
from typing import Any, Deque, List, Set

READABLE = select.EPOLLIN | select.EPOLLRDHUP


class Inbox:
    """Waits on the monotonic clock: a jump of the wall clock neither wakes nor holds its reader."""

    def __init__(self) -> None:
        self._items: Deque[Any] = deque()
        self._reader, self._writer = os.pipe()
        os.set_blocking(self._reader, False)
        self._waking, self._later, self._hung_up = (select.epoll() for _ in range(3))
        self._waking.register(self._reader, select.EPOLLIN)
        self._woken = False

    def put(self, item: Any) -> None:
        """Add an item and wake the reader; from any thread."""
        self._items.append(item)
        self.wake()

    def wake(self) -> None:
        """End the reader's sleep, or its next one; from any thread."""
        if not self._woken:
            self._woken = True
            os.write(self._writer, b"!")

    def watch(self, descriptor: int, wakes: bool = True) -> None:
        """Wait for this descriptor as well; it is forgotten when it is closed.

        One that does not wake is among the ready ones alone.
        """
        (self._waking if wakes else self._later).register(descriptor, READABLE)
        self._hung_up.register(descriptor, select.EPOLLRDHUP)

    def watch_otherwise(self, descriptor: int, wakes: bool) -> None:
        """Have a watched descriptor wake from now on, or not."""
        before, after = (self._later, self._waking) if wakes else (self._waking, self._later)
        before.unregister(descriptor)
        after.register(descriptor, READABLE)

    def wait(self, timeout: float) -> None:
        """Sleep for at most `timeout` s, or until there is something, or a descriptor hangs up."""
        _wait(timeout, self._waking, self._hung_up)

    def rest(self, timeout: float) -> None:
        """Sleep for `timeout` s whatever is sent, but no longer once a descriptor has hung up."""
        _wait(timeout, self._hung_up)

    def ready(self) -> Set[int]:
        """Return the watched descriptors that are readable now."""
        found = {
            descriptor for each in (self._waking, self._later) for descriptor, _ in each.poll(0)
        }
        found.discard(self._reader)
        return found

    def take(self) -> List[Any]:
        """Return what has been put so far, in order."""
        with suppress(BlockingIOError):  # whoever wakes us may be about to
            os.read(self._reader, 4096)
        self._woken = False
        return [self._items.popleft() for _ in range(len(self._items))]


def _wait(timeout: float, *polled: Any) -> None:
    """Wait as `epoll.poll(timeout)`, which rounds up to whole ms: too long at 1 kHz."""
    select.select(polled, (), (), max(0.0, timeout))
