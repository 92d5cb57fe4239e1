"""A thread that makes calls one after the other, for those who must not wait."""
import queue
import threading
from typing import Any, Callable

import rospy


class Worker:
    """Makes the calls that are put, in order, in one thread."""

    def __init__(self, name: str) -> None:
        self._calls: "queue.SimpleQueue[Callable[[], Any]]" = queue.SimpleQueue()
        threading.Thread(target=self._work, name=name, daemon=True).start()

    def put(self, call: Callable[[], Any]) -> None:
        """Make this call after those before it; returns at once."""
        self._calls.put(call)

    def _work(self) -> None:
        while True:
            call = self._calls.get()
            try:
                call()
            except Exception as error:  # whatever it is, the calls after it are made
                # At shutdown rospy closes the topics under the feet of whoever uses them.
                if not rospy.core.is_shutdown_requested():
                    rospy.logerr("%s: %r", threading.current_thread().name, error)
