"""Substitutes that somebody left behind, known by what runs, not by its name."""
import os
import signal
import subprocess
import sys
import time
from pathlib import Path
from typing import Iterator, List

import psutil
import pytest

from shsa_core.ros import settings
from shsa_core.ros.processes import starting
from shsa_core.ros.processes.starting import Substitutes, Setup
from shsa_testing.waiting import wait_until

NODE = "/robot/substitute_a_7"
SETUP = Setup("/robot/substitute_")


@pytest.fixture
def ours(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A package with our executables, each of which only sleeps."""
    for name in ("substitute", "standby", "monitor"):
        (tmp_path / name).write_text("import time\nprint(flush=True)\ntime.sleep(60.0)\n")
    monkeypatch.setattr(starting, "find_node", lambda _, name: [str(tmp_path / name)])
    monkeypatch.setattr(starting, "get_pkg_dir", lambda _: str(tmp_path))
    return tmp_path


@pytest.fixture
def started() -> "Iterator[List[subprocess.Popen[bytes]]]":
    all_started: "List[subprocess.Popen[bytes]]" = []
    yield all_started
    for process in all_started:
        process.kill()
        process.wait()
        assert process.stdout is not None
        process.stdout.close()


@pytest.mark.parametrize(
    "executable, arguments, is_ours",
    [
        ("substitute", ["/x/data", "y=x[0]", "/y/data", "__name:=substitute_a_7"], True),
        ("standby", ["__name:=substitute_a_7"], True),
        ("standby", ["__name:=substitute_a_71"], False),
        ("standby", [], False),
        ("monitor", ["__name:=substitute_a_7"], False),
        ("monitor", ["substitute", "__name:=substitute_a_7"], False),
    ],
)
def test_a_process_is_known_by_its_executable_and_its_name(
    ours: Path,
    started: "List[subprocess.Popen[bytes]]",
    executable: str,
    arguments: List[str],
    is_ours: bool,
) -> None:
    words = [sys.executable, str(ours / executable), *arguments]
    started.append(subprocess.Popen(words, stdout=subprocess.PIPE))
    assert started[0].stdout is not None and started[0].stdout.readline()
    known = Substitutes(lambda node, detail: None, lambda node: None, SETUP)
    assert known.runs_ours(NODE, psutil.Process(started[0].pid)) is is_ours


def test_a_process_that_has_ended_is_not_known(ours: Path) -> None:
    with subprocess.Popen([sys.executable, "-c", "input()"], stdin=subprocess.PIPE) as process:
        ended = psutil.Process(process.pid)
        os.kill(process.pid, 9)
    known = Substitutes(lambda node, detail: None, lambda node: None, SETUP)
    assert not known.runs_ours(NODE, ended)


def test_what_was_left_behind_is_found_and_ended_as_our_own(
    ours: Path,
    started: "List[subprocess.Popen[bytes]]",
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setenv("ROS_MASTER_URI", "http://localhost:1")
    for name, namespace, master in (
        ("substitute_a_7", "/robot", "http://localhost:1"),
        ("substitute_a_8", "/other", "http://localhost:1"),
        ("substitute_a_9", "/robot", "http://localhost:2"),
        ("user_a_7", "/robot", "http://localhost:1"),
        ("substitute_a_6", "/robot", "http://127.0.0.1:1/"),
        ("substitute_a_5", "/robot", "http://localhost:none"),
    ):
        words = [sys.executable, str(ours / "standby"), f"__name:={name}"]
        environment = dict(os.environ, ROS_NAMESPACE=namespace, ROS_MASTER_URI=master)
        started.append(
            subprocess.Popen(words, env=environment, stdout=subprocess.PIPE, start_new_session=True)
        )
    for process in started:
        assert process.stdout is not None and process.stdout.readline()
    ended: List[str] = []
    known = Substitutes(lambda node, detail: ended.append(node), lambda node: None, SETUP)
    left = known.left_behind()
    other = "/robot/substitute_a_6"  # of the same master, which is spelled in another way
    found = {node: process.pid for node, process in left.items()}
    assert found == {NODE: started[0].pid, other: started[4].pid}
    known.take_up(NODE, left[NODE])
    assert list(known.left_behind()) == [other]
    started[0].send_signal(signal.SIGSTOP)
    is_stopped = lambda: left[NODE].status() == psutil.STATUS_STOPPED
    wait_until(is_stopped, 5.0, "it is stopped")
    began = time.monotonic()
    known.children.stop(NODE)
    assert started[0].poll() == -signal.SIGKILL and not ended
    assert time.monotonic() - began < settings.PATIENCE_S  # it was not asked


def test_the_end_of_one_that_was_left_behind_is_told(
    ours: Path, started: "List[subprocess.Popen[bytes]]"
) -> None:
    words = [sys.executable, str(ours / "standby"), "__name:=substitute_a_7"]
    started.append(subprocess.Popen(words, stdout=subprocess.PIPE, start_new_session=True))
    ended: List[str] = []
    known = Substitutes(lambda node, detail: ended.append(node), lambda node: None, SETUP)
    known.take_up(NODE, psutil.Process(started[0].pid))
    started[0].kill()
    started[0].wait()
    wait_until(lambda: ended == [NODE], 5.0, "its end is told")
