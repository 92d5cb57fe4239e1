"""Runs every rostest of the workspace, and looks for what it leaves behind.

Each has a master of its own.
"""
import os
import subprocess
import uuid
from pathlib import Path

import pytest

from shsa_testing.processes import marked
from shsa_testing.waiting import wait_until

ROOT = Path(__file__).resolve().parent.parent
TIMEOUT_S = 240.0
LEAVING_S = 15.0  # s that processes may take to end after the test
MARK = "SHSA_ROSTEST"
ROSTESTS = sorted(ROOT.glob("src/*/test/rostest/*.test"))


@pytest.mark.parametrize("path", ROSTESTS, ids=lambda path: path.stem)
def test_rostest(path: Path) -> None:
    package = path.relative_to(ROOT / "src").parts[0]
    mark = uuid.uuid4().hex
    done = subprocess.run(
        ["rostest", package, path.name],
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        universal_newlines=True,
        timeout=TIMEOUT_S,
        env={**os.environ, MARK: mark},
    )
    assert done.returncode == 0, done.stdout[-8000:]
    started = [process.name() for process in marked(MARK, mark)]
    wait_until(lambda: not marked(MARK, mark), LEAVING_S, f"these have ended: {started}")
