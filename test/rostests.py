"""Runs a rostest, and looks for what it leaves behind.

Each has a master of its own. One that fails runs again, twice at most: they judge real time on
whatever machine this is. Each failure is shown as a warning, so that it is not forgotten.
"""
import os
import subprocess
import uuid
import warnings
from pathlib import Path
from typing import List
from xml.etree import ElementTree

from shsa_testing.processes import marked
from shsa_testing.waiting import wait_until

ROOT = Path(__file__).resolve().parent.parent
TIMEOUT_S = 240.0
LEAVING_S = 15.0  # s that processes may take to end after the test
MARK = "SHSA_ROSTEST"
ATTEMPTS = 3


def of_packages(*patterns: str) -> List[Path]:
    """The rostests of the packages whose folders match."""
    found = {path for each in patterns for path in ROOT.glob(f"{each}/test/rostest/*.test")}
    return sorted(found)


def check(path: Path) -> None:
    """Run a rostest until it passes, ATTEMPTS times at most. Raises AssertionError else."""
    for _ in range(ATTEMPTS):
        done = _run(path)
        if done.returncode == 0:
            return
        warnings.warn(f"{path.stem} failed: {done.stdout[-8000:]}")
    raise AssertionError(done.stdout[-8000:])


def _run(path: Path) -> "subprocess.CompletedProcess[str]":
    """Run a rostest once, and see all that it started end."""
    package = str(ElementTree.parse(str(path.parents[2] / "package.xml")).findtext("name"))
    mark = uuid.uuid4().hex
    done = subprocess.run(
        ["rostest", package, path.name],
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        universal_newlines=True,
        timeout=TIMEOUT_S,
        env={**os.environ, MARK: mark},
    )
    started = [process.name() for process in marked(MARK, mark)]
    wait_until(lambda: not marked(MARK, mark), LEAVING_S, f"these have ended: {started}")
    return done
