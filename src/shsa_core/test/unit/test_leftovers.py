"""Substitutes that somebody left behind, known by what runs, not by its name."""
import os
import signal
import subprocess
import sys
import time
from pathlib import Path
from typing import Callable, Iterator, List

import psutil
import pytest
from rospkg import RosPack

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
    monkeypatch.setattr(starting, "find_node", lambda _, name, packages: [str(tmp_path / name)])
    monkeypatch.setattr(RosPack, "get_path", lambda *_: str(tmp_path))
    return tmp_path


Start = Callable[..., "subprocess.Popen[bytes]"]


@pytest.fixture
def start(ours: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Start]:
    """Return what starts an executable with words, and an environment beside ours."""
    monkeypatch.setenv("ROS_MASTER_URI", "http://localhost:1")
    monkeypatch.setenv("ROS_NAMESPACE", "/robot")
    started: "List[subprocess.Popen[bytes]]" = []

    def begin(executable: str, *words: str, **variables: str) -> "subprocess.Popen[bytes]":
        command = [sys.executable, str(ours / executable), *words]
        how = {"stdout": subprocess.PIPE, "env": {**os.environ, **variables}}
        started.append(subprocess.Popen(command, start_new_session=True, **how))  # type: ignore
        assert started[-1].stdout is not None and started[-1].stdout.readline()
        return started[-1]

    yield begin
    for process in started:
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
    start: Start, executable: str, arguments: List[str], is_ours: bool
) -> None:
    start(executable, *arguments)
    known = Substitutes(lambda node, detail: None, lambda node: None, SETUP)
    assert (NODE in known.take_up()) is is_ours


def test_what_was_left_behind_is_found_and_ended_as_our_own(start: Start) -> None:
    started = [
        start("standby", f"__name:={name}", ROS_NAMESPACE=namespace, ROS_MASTER_URI=master)
        for name, namespace, master in (
            ("substitute_a_7", "/robot", "http://localhost:1"),
            ("substitute_a_8", "/other", "http://localhost:1"),
            ("substitute_a_9", "/robot", "http://localhost:2"),
            ("user_a_7", "/robot", "http://localhost:1"),
            ("substitute_a_6", "/robot", "http://127.0.0.1:1/"),
            ("substitute_a_5", "/robot", "http://localhost:none"),
        )
    ]
    ended: List[str] = []
    known = Substitutes(lambda node, detail: ended.append(node), lambda node: None, SETUP)
    other = "/robot/substitute_a_6"  # of the same master, which is spelled in another way
    assert set(known.take_up()) == {NODE, other} and known.take_up() == []
    started[0].send_signal(signal.SIGSTOP)
    is_stopped = lambda: psutil.Process(started[0].pid).status() == psutil.STATUS_STOPPED
    wait_until(is_stopped, 5.0, "it is stopped")
    began = time.monotonic()
    known.children.stop(NODE)
    assert started[0].poll() == -signal.SIGKILL and not ended
    assert time.monotonic() - began < settings.PATIENCE_S  # it was not asked


def test_the_end_of_one_that_was_left_behind_is_told(start: Start) -> None:
    process = start("standby", "__name:=substitute_a_7")
    ended: List[str] = []
    known = Substitutes(lambda node, detail: ended.append(node), lambda node: None, SETUP)
    known.take_up()
    process.kill()
    process.wait()
    wait_until(lambda: ended == [NODE], 5.0, "its end is told")
