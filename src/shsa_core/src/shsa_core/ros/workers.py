"""Standing threads for calls that wait for others: none has to be made when work comes."""
import queue
import threading
import time
from typing import Any, Callable

import rospy

from shsa_core.ros import settings

Call = Callable[[], Any]


def _log(text: str) -> None:
    # At shutdown rospy closes the topics under the feet of whoever uses them.
    if not rospy.core.is_shutdown_requested():
        rospy.logerr("%s", text)


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
