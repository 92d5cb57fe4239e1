"""Runs every rostest of the workspace, each with a master of its own, and looks for what it leaves behind."""
import os
import subprocess
import time
import uuid
from pathlib import Path
from typing import List

import psutil
import pytest

ROOT = Path(__file__).resolve().parent.parent
TIMEOUT = 240.0
LEAVING = 15.0  # s that processes may take to end after the test
MARK = "SHSA_ROSTEST"
ROSTESTS = sorted(ROOT.glob("src/*/test/rostest/*.test"))


def marked(mark: str) -> List[str]:
    """The processes that inherited a mark."""
    found = []
    for process in psutil.process_iter():
        try:
            ended = process.status() == psutil.STATUS_ZOMBIE
            if not ended and process.environ().get(MARK) == mark:
                found.append(" ".join(process.cmdline()))
        except (psutil.Error, OSError):
            continue
    return found


@pytest.mark.parametrize("path", ROSTESTS, ids=lambda path: path.stem)
def test_rostest(path: Path) -> None:
    package = path.relative_to(ROOT / "src").parts[0]
    mark = uuid.uuid4().hex
    done = subprocess.run(
        ["rostest", package, path.name],
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        universal_newlines=True,
        timeout=TIMEOUT,
        env={**os.environ, MARK: mark},
    )
    assert done.returncode == 0, done.stdout[-8000:]
    end = time.monotonic() + LEAVING
    while marked(mark):
        assert time.monotonic() < end, f"left behind: {marked(mark)}"
        time.sleep(0.1)
