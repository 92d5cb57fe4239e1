"""Runs a rostest, and looks for what it leaves behind. Each has a master of its own."""
import os
import signal
import subprocess
import tempfile
import uuid
from contextlib import suppress
from pathlib import Path
from typing import Dict, List
from xml.etree import ElementTree

import psutil

from shsa_testing.processes import marked, own_address
from shsa_testing.thorough import LONG
from shsa_testing.waiting import wait_until

ROOT = Path(__file__).resolve().parent.parent
TIMEOUT_S = 60.0  # s that a test may take whose file says nothing, by rostest
LEAVING_S = 15.0  # s that processes may take to end after the test
DUMP_S = 3.0
MARK = "SHSA_ROSTEST"
SELDOM: Dict[str, str] = {
    "calibration": "test_healing_calibrations.py",
    "flapping": "policies.test",
    "gates": "gate.test",
    "hang": "bridging.test",
    "heal_every_topic": "heal_amperemeter.test",
    "heal_repeatedly": "takeover.test",
    "hot_hosts": "test_sharing.py",
}
"""Rostests of `make test-long` alone, and what stands for each of them in `make test`."""
LONGEST = 40_000
"""The end of what a failed test has printed."""


def of_packages(*patterns: str) -> List[Path]:
    """Return the rostests of the packages whose folders match."""
    found = {path for each in patterns for path in ROOT.glob(f"{each}/test/rostest/*.test")}
    return sorted(path for path in found if LONG or path.stem not in SELDOM)


def check(path: Path) -> None:
    """Run a rostest, and see all that it started end. Raises AssertionError with what failed."""
    package = str(ElementTree.parse(str(path.parents[2] / "package.xml")).findtext("name"))
    tests = ElementTree.parse(str(path)).iter("test")
    # Before rostest ends what takes too long: then nobody can tell any more where it was stuck.
    limit = sum(float(each.get("time-limit", TIMEOUT_S)) for each in tests)
    mark = uuid.uuid4().hex
    environment = {**os.environ, MARK: mark, "PYTHONFAULTHANDLER": "1"}
    environment["PATH"] = f"{ROOT / 'test' / 'programs'}:{os.environ['PATH']}"
    if package in (
        "shsa_core",
        "shsa_gate",
    ):  # without roscpp, which listens at 127.0.0.1 alone of those
        environment.pop("ROS_HOSTNAME", None)
        environment["ROS_IP"] = own_address()
    # A file, not a pipe: that is at its end only when the last one who writes to it has ended.
    with tempfile.TemporaryFile("w+", errors="replace") as said:
        done = subprocess.Popen(
            ["rostest", package, path.name],
            stdout=said,
            stderr=subprocess.STDOUT,
            env=environment,
        )
        try:
            failed = _waited(done, mark, limit)
        finally:
            for process in marked(MARK, mark):
                process.kill()
            done.wait()
        said.seek(0)
        printed = said.read()[-LONGEST:]
    assert not failed and done.returncode == 0, printed + failed


def _waited(rostest: "subprocess.Popen[bytes]", mark: str, limit: float) -> str:
    """Wait for a rostest, and for all that it started; what took too long, or nothing."""
    try:
        rostest.wait(limit)
    except subprocess.TimeoutExpired:
        return _stuck(mark, limit)
    try:
        wait_until(lambda: not marked(MARK, mark), LEAVING_S, "all have ended")
    except AssertionError:
        return _stuck(mark, LEAVING_S)
    return ""


def _stuck(mark: str, seconds: float) -> str:
    """Name the processes that have not ended; those in Python print where their threads are."""
    there, named = marked(MARK, mark), ""
    for process in there:
        with suppress(psutil.NoSuchProcess):
            named += f"\n  {process.pid}: {' '.join(' '.join(process.cmdline()).split())}"
            process.send_signal(signal.SIGABRT)
    psutil.wait_procs(there, DUMP_S)
    return f"\nwaited {seconds:g} s in vain; these had not ended:{named}\n"
