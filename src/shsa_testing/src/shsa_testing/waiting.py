"""Waiting for a condition, with a deadline."""
import time
from typing import Callable, TypeVar

POLL_S = 0.005

Value = TypeVar("Value")


def wait_until(condition: Callable[[], Value], seconds: float, what: str) -> Value:
    """Wait until a condition is true; its value. Raises AssertionError if that takes longer."""
    end = time.monotonic() + seconds
    while True:
        value = condition()
        if value:
            return value
        if time.monotonic() > end:
            raise AssertionError(f"waited {seconds:g} s in vain: {what}")
        time.sleep(POLL_S)
