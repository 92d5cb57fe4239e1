"""Standing threads for calls that wait for others: none has to be made when work comes."""
import queue
import threading
import time
from typing import Any, Callable, FrozenSet, Iterable, List, Tuple

import rospy

from shsa_core.ros import settings

Call = Callable[[], Any]


def _log(text: str) -> None:
    # At shutdown rospy closes the topics under the feet of whoever uses them.
    if not rospy.core.is_shutdown_requested():
        rospy.logerr("%s", text)


def guarded(who: str, handle: Callable[..., object], *what: Any) -> None:
    """Handle something; whatever goes wrong with it, the rest is still handled."""
    try:
        handle(*what)
    except Exception as error:  # whatever it is, the node goes on
        if not rospy.core.is_shutdown_requested():
            text = f"{who} could not handle something: {type(error).__name__}: {error}"
            rospy.logerr_throttle_identical(10.0, text)


def repeating(name: str, pause: float, call: Call) -> threading.Thread:
    """Return a thread that makes a call for good, with a pause in s after each; not started yet.

    It goes on whatever goes wrong: what it watches would go unnoticed.
    """

    def repeat() -> None:
        while True:
            guarded(f"The thread {name}", call)
            time.sleep(pause)

    return threading.Thread(target=repeat, name=name, daemon=True)


class Workers:
    """Makes the calls that are put, up to `most` at a time; one alone makes them in order.

    `failed(text)` is told, from any thread and at most every LONGEST_PAUSE_S, what a call
    has raised, and that no thread could be started.
    """

    def __init__(self, name: str, most: int = 1, failed: Callable[[str], None] = _log) -> None:
        self._name, self._most, self._failed = name, most, failed
        self._calls: "queue.Queue[Call]" = queue.Queue()
        self._lock = threading.Lock()
        self._threads = self._busy = 0
        self._said = float("-inf")
        for _ in range(min(settings.STANDING_WORKERS, most)):
            self._start()

    def put(self, call: Call) -> None:
        """Make a call as soon as a thread is free; returns at once."""
        self._calls.put(call)
        with self._lock:
            more = self._threads < self._most and self._busy + self._calls.qsize() > self._threads
        if more:
            try:
                self._start()
            except (RuntimeError, MemoryError) as error:
                self._say(f"no thread for {self._name}, its calls wait for one another: {error}")

    def join(self) -> None:
        """Wait until all calls that were put have been made."""
        self._calls.join()

    def _start(self) -> None:
        threading.Thread(target=self._work, name=self._name, daemon=True).start()
        with self._lock:
            self._threads += 1

    def _work(self) -> None:
        while True:
            call = self._calls.get()
            with self._lock:
                self._busy += 1
            try:
                call()
            except Exception as error:  # whatever it is, the calls after it are made
                self._say(f"{self._name}: {type(error).__name__}: {error}")
            finally:
                del call
                with self._lock:
                    self._busy -= 1
                self._calls.task_done()

    def _say(self, text: str) -> None:
        now = time.monotonic()
        if now >= self._said + settings.LONGEST_PAUSE_S:
            self._said = now
            self._failed(text)


class UrgentFirst:
    """Makes calls about topics in order, one at a time; those about an urgent one before others.

    After each other call it rests for `pause` s, or until an urgent one comes.
    """

    def __init__(self, name: str, pause: float) -> None:
        self._workers = Workers(name)
        self._changed = threading.Condition()
        self._first: List[Tuple[str, Call]] = []
        self._rest: List[Tuple[str, Call]] = []
        self._urgent: FrozenSet[str] = frozenset()
        self._pause = pause

    def urge(self, topics: Iterable[str]) -> None:
        """Take these topics to be urgent from now on."""
        with self._changed:
            self._urgent = self._urgent.union(topics)
            self._first += [each for each in self._rest if each[0] in self._urgent]
            self._rest = [each for each in self._rest if each[0] not in self._urgent]
            self._changed.notify()

    def put(self, topic: str, call: Call) -> None:
        """Make a call as soon as it is its turn; returns at once."""
        with self._changed:
            (self._first if topic in self._urgent else self._rest).append((topic, call))
            self._changed.notify()
        self._workers.put(self._make)

    def _make(self) -> None:
        with self._changed:
            topic, call = (self._first or self._rest).pop(0)
        try:
            call()
        finally:
            with self._changed:
                if topic not in self._urgent:
                    self._changed.wait_for(lambda: bool(self._first), self._pause)
