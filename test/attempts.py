"""Tests on real processes judge real time, on whatever machine this is: one that fails runs again.

First beside whatever else is tested, then alone: it waits for the other tests on real processes to
end, and they wait for it. Each failure is shown as a warning, so that it is not forgotten.
"""
import fcntl
import os
import subprocess
import tempfile
import warnings
from contextlib import contextmanager
from pathlib import Path
from typing import Callable, Iterator

ATTEMPTS = 3
LOCK = Path(tempfile.gettempdir()) / f"shsa_tests_of_{os.getuid()}.lock"
GATE = LOCK.with_suffix(".gate")
LONGEST = 8000
"""The end of what a failed test has said."""


@contextmanager
def machine(alone: bool) -> Iterator[None]:
    """Hold the machine, together with other tests or alone."""
    with open(LOCK, "w") as lock, open(GATE, "w") as gate:
        fcntl.flock(gate, fcntl.LOCK_EX)  # who waits to be alone lets nobody else in meanwhile
        fcntl.flock(lock, fcntl.LOCK_EX if alone else fcntl.LOCK_SH)
        fcntl.flock(gate, fcntl.LOCK_UN)
        yield


def attempt(run: Callable[[], str]) -> None:
    """Call `run`, which says what failed, until nothing has; ATTEMPTS times at most.

    Raises AssertionError with what failed last.
    """
    said = ""
    for number in range(ATTEMPTS):
        with machine(alone=number > 0):
            said = _said(run)[-LONGEST:]
        if not said:
            return
        warnings.warn(f"failed: {said}")
    raise AssertionError(said)


def _said(run: Callable[[], str]) -> str:
    try:
        return run()
    except (AssertionError, subprocess.TimeoutExpired) as error:
        return f"{type(error).__name__}: {error}"
