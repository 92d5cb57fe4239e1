"""A live robot is attacked as another user: the short form of `make redteam`."""
import subprocess
import sys
from pathlib import Path
from typing import Callable, Iterator, List

import psutil
import pytest
from tools_run import run_tool

from shsa_testing.thorough import LONG
from shsa_testing.waiting import wait_until

ROOT = Path(__file__).resolve().parent.parent
for package in ("shsa_injection", "shsa_core"):
    sys.path.insert(0, str(ROOT / "src" / package / "bench"))

from redteam import ROBOT, as_user, refusal, strange  # noqa: E402

TIMEOUT_S = 240.0
HERE = pytest.mark.skipif(bool(refusal()), reason=refusal())

Start = Callable[[], int]


@pytest.fixture
def start(tmp_path: Path) -> Iterator[Start]:
    """Start a server as the robot's user; return its pid."""
    server = (sys.executable, *"-m http.server 0 --bind 127.0.0.1".split())
    words = (*as_user(ROBOT, tmp_path), *server)
    made: List["subprocess.Popen[bytes]"] = []

    def begin() -> int:
        made.append(subprocess.Popen(words, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL))
        process = psutil.Process(made[-1].pid)
        wait_until(lambda: process.cmdline()[1:2] == ["-m"], 20.0, "it runs as the robot's user")
        return made[-1].pid

    yield begin
    for each in made:
        each.kill()
        each.wait()


@HERE
def test_what_an_earlier_run_has_left_is_no_stranger_s(start: Start) -> None:
    earlier = {start(), start()}
    before = {*psutil.process_iter()}
    assert earlier <= {each.pid for each in before}
    assert strange(before) == []
    new = start()
    assert [each.pid for each in strange(before)] == [new]


@HERE
@pytest.mark.skipif(not LONG, reason="make test-long; units and trust.test try each attack's way")
def test_short_form() -> None:
    done = run_tool(str(ROOT / "tools" / "redteam"), "--short", timeout=TIMEOUT_S)
    assert done.returncode == 0, done.stdout
