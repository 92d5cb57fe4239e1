"""Callers of ours: how many connections each has, and the processor time that it costs us.

A caller is another user of this computer, or an address beyond; our own user and root are none.
"""
import os
import socket
import threading
import time
from collections import Counter
from contextlib import suppress
from typing import Any, Callable, Dict, Optional, Tuple

from shsa_core.ros import settings

Speaker = Callable[[socket.socket], Optional[int]]
EVERYBODY = "everybody"
USER = "user "
"""The begin of the name of a caller that is another user of this computer."""
_charged = threading.local()
"""Of each thread: `until`, the time of its own that was charged."""


def charge_also(spent: float) -> None:
    """Charge who is served by this thread with the time in s that another took for it, too."""
    _charged.until = getattr(_charged, "until", 0.0) - spent


class Debts:
    """The processor time in s that callers have had beyond their share. From any thread."""

    def __init__(self) -> None:
        self._debts: Dict[str, Tuple[float, float]] = {}  # and when that was

    def wait(self, caller: str, at_once: bool = False) -> None:
        """Charge a caller for this thread's time since; it waits if in debt, unless `at_once`."""
        took = time.thread_time()
        spent, _charged.until = took - getattr(_charged, "until", 0.0), took
        seconds = self.owed(caller, spent) if caller else 0.0
        if seconds and not at_once:
            time.sleep(seconds)

    def owed(self, caller: str, spent: float = 0.0) -> float:
        """Return how long a caller waits that has had so much more."""
        now = time.monotonic()
        debt, at = self._debts.get(caller, (0.0, now))
        debt = max(0.0, debt - settings.CALLER_SHARE * (now - at)) + spent
        if len(self._debts) >= settings.MOST_API_CONNECTIONS:  # who has many names clears no debt
            self._debts.pop(min(list(self._debts.items()), key=lambda each: each[1])[0], None)
        self._debts[caller] = debt, now
        return max(0.0, debt - settings.CALLER_CREDIT_S) / settings.CALLER_SHARE


class Inbound(socket.socket):
    """A connection to us: another `caller` waits wherever its thread would read or write on.

    `given` is read first. Of what comes to a buffer, `left` bytes are read; then it ends.
    """

    left = 0

    def __init__(
        self, connection: socket.socket, caller: str, debts: Debts, given: bytes = b""
    ) -> None:
        super().__init__(fileno=connection.detach())
        self.caller, self.debts, self._given = caller, debts, given

    def pay(self) -> None:
        """Charge the caller with what this thread did."""
        self.debts.wait(self.caller, at_once=True)

    def recv(self, size: int, flags: int = 0) -> bytes:
        """Return what comes next."""
        given, self._given = self._given[:size], self._given[size:]
        if not given:
            self.debts.wait(self.caller)
        return given or super().recv(size, flags)

    def recv_into(self, *arguments: Any) -> int:
        """Read what comes next."""
        self.debts.wait(self.caller)
        count = super().recv_into(*arguments) if self.left > 0 else 0
        self.left -= count
        return count

    def publish(self, write: Callable[[], Any]) -> Any:
        """Have a message written, unless another user of this computer would wait: it misses that.

        It pays for what that costs the thread that publishes. Raises OSError if it owes too much.
        """
        if not self.caller.startswith(USER):
            return write()
        began, owed = time.thread_time(), self.debts.owed(self.caller)
        if owed > settings.PATIENCE_S:
            raise ConnectionAbortedError(f"{self.caller} has us do too much")
        try:
            return True if owed else write()
        finally:
            self.debts.owed(self.caller, time.thread_time() - began)

    def sendall(self, *arguments: Any) -> None:
        """Write; a subscriber of another user of this computer pays for each message, and waits."""
        if self.caller.startswith(USER):
            self.debts.wait(self.caller)
        super().sendall(*arguments)


class Room:
    """Connections that are open at the same time, and whose each is."""

    def __init__(self, debts: Debts, speaker: Speaker) -> None:
        self._debts, self._speaker = debts, speaker
        self._open: Dict[Inbound, None] = {}  # in the order in which they came
        self._lock = threading.Lock()

    def admit(self, connection: socket.socket, most: int, serve: Callable[[Inbound], None]) -> None:
        """Serve one more, unless its caller has called too much; others pay together for that."""
        caller = self._look(connection)
        try:
            if caller and self._debts.owed(caller) > settings.PATIENCE_S:
                connection.close()
                return
            inbound = Inbound(connection, caller, self._debts)
            self.enter(inbound, most)
            serve(inbound)
        except (RuntimeError, MemoryError):  # no thread is left: whoever asks again may be served
            inbound.close()
            raise
        finally:
            self._debts.wait(EVERYBODY if caller else "")

    def enter(self, connection: Inbound, most: int) -> None:
        """Have one more, until it is closed or detached.

        Where these are more than `most`, the oldest is ended of the caller that has most of them.
        """
        with self._lock:
            self._open = {each: None for each in self._open if each.fileno() >= 0}
            self._open[connection] = None
            if len(self._open) <= most:
                return
            count = Counter(each.caller for each in self._open)
            oldest = max(self._open, key=lambda each: count[each.caller])
            del self._open[oldest]
        with suppress(OSError):  # it may have ended
            oldest.shutdown(socket.SHUT_RDWR)

    def _look(self, connection: socket.socket) -> str:
        """Return the other user, or the address beyond; empty: it is of our own, or of root."""
        try:
            user = self._speaker(connection)
            at = connection.getpeername()[0] if user is None else f"{USER}{user}"
        except OSError:
            return "a caller that has left"
        return "" if user in (0, os.geteuid()) else str(at)
