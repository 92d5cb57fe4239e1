"""What one thread waits for: items that other threads put, and sockets that become readable."""
import os
import select
from collections import deque
from typing import Any, Deque, List, Set


class Inbox:
    """Waits on the monotonic clock: a jump of the wall clock neither wakes nor holds its reader."""

    def __init__(self) -> None:
        self._items: Deque[Any] = deque()
        self._reader, self._writer = os.pipe()
        self._poll = select.epoll()
        self._poll.register(self._reader, select.EPOLLIN)
        self._hung_up = select.epoll()
        self._woken = False

    def put(self, item: Any, wakes: bool = True) -> None:
        """Add an item and wake the reader, unless it is in no hurry for it; from any thread."""
        self._items.append(item)
        if wakes and not self._woken:
            self._woken = True
            os.write(self._writer, b"!")

    def watch(self, descriptor: int) -> None:
        """Wait for this descriptor as well; it is forgotten when it is closed."""
        self._poll.register(descriptor, select.EPOLLIN | select.EPOLLRDHUP)
        self._hung_up.register(descriptor, select.EPOLLRDHUP)

    def wait(self, timeout: float) -> None:
        """Sleep for at most `timeout` s, or until there is something."""
        _wait(self._poll, timeout)

    def rest(self, timeout: float) -> None:
        """Sleep for `timeout` s whatever comes, but no longer once a descriptor has hung up."""
        _wait(self._hung_up, timeout)

    def ready(self) -> Set[int]:
        """The watched descriptors that are readable now."""
        found = {descriptor for descriptor, _ in self._poll.poll(0)}
        if self._reader in found:
            found.remove(self._reader)
            os.read(self._reader, 4096)
            self._woken = False
        return found

    def take(self) -> List[Any]:
        """What has been put so far, in order."""
        return [self._items.popleft() for _ in range(len(self._items))]


def _wait(poll: "select.epoll", timeout: float) -> None:
    """As `poll.poll(timeout)`, which rounds up to whole ms: too long for what is due at 1 kHz."""
    select.select((poll,), (), (), max(0.0, timeout))
