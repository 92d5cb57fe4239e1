"""Runs a rostest, and looks for what it leaves behind. Each has a master of its own."""
import os
import subprocess
import uuid
from pathlib import Path
from typing import List
from xml.etree import ElementTree

from attempts import attempt

from shsa_testing.processes import marked
from shsa_testing.waiting import wait_until

ROOT = Path(__file__).resolve().parent.parent
TIMEOUT_S = 240.0
LEAVING_S = 15.0  # s that processes may take to end after the test
MARK = "SHSA_ROSTEST"


def of_packages(*patterns: str) -> List[Path]:
    """The rostests of the packages whose folders match."""
    found = {path for each in patterns for path in ROOT.glob(f"{each}/test/rostest/*.test")}
    return sorted(found)


def check(path: Path) -> None:
    """Run a rostest until it passes. Raises AssertionError if it never does."""
    attempt(lambda: _failure(path))


def _failure(path: Path) -> str:
    """Run a rostest once, and see all that it started end; what failed."""
    package = str(ElementTree.parse(str(path.parents[2] / "package.xml")).findtext("name"))
    mark = uuid.uuid4().hex
    try:
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
    finally:
        for process in marked(MARK, mark):
            process.kill()
    return done.stdout if done.returncode else ""
