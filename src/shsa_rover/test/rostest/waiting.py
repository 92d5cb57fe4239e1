"""Waiting for a condition, with a deadline."""
import time
from typing import Any, Callable


def wait_for(condition: Callable[[], Any], seconds: float, what: str) -> None:
    """Waits until `condition()` is true; raises AssertionError with `what` went wrong after `seconds`."""
    deadline = time.monotonic() + seconds
    while not condition():
        if time.monotonic() > deadline:
            raise AssertionError(f"after {seconds:g} s: {what}")
        time.sleep(0.01)
