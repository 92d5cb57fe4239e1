"""Healing and the ROS master: in a process of its own, as rospy knows one master for good."""
import subprocess
import sys
import warnings
from pathlib import Path

from rostests import ATTEMPTS

CASES = Path(__file__).resolve().parent / "master_cases.py"
TIMEOUT_S = 300.0


def run() -> "subprocess.CompletedProcess[str]":
    return subprocess.run(
        [sys.executable, "-m", "pytest", "-q", "-o", "addopts=", "--tb=short", str(CASES)],
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        universal_newlines=True,
        timeout=TIMEOUT_S,
    )


def test_master() -> None:
    """They judge real time on whatever machine this is: what fails runs again."""
    for _ in range(ATTEMPTS):
        done = run()
        if done.returncode == 0:
            return
        warnings.warn(f"failed: {done.stdout[-8000:]}")
    raise AssertionError(done.stdout[-8000:])
