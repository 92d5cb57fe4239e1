"""Healing and the ROS master: in a process of its own, as rospy knows one master for good."""
import subprocess
import sys
from pathlib import Path

CASES = Path(__file__).resolve().parent / "master_cases.py"
TIMEOUT_S = 300.0


def test_master() -> None:
    done = subprocess.run(
        [sys.executable, "-m", "pytest", "-q", "-o", "addopts=", "--tb=short", str(CASES)],
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        universal_newlines=True,
        timeout=TIMEOUT_S,
    )
    assert done.returncode == 0, done.stdout
