"""The end of our launch, told by the log of the process that started us."""
import errno
import os
import subprocess
import sys
import time
from pathlib import Path
from typing import Iterator, List
from unittest.mock import Mock

import psutil
import pytest

from shsa_core.ros.processes import kernel, launch as launching
from shsa_core.ros.processes.launch import Launches
from shsa_testing.waiting import wait_until

PARENT = """
import os, signal, subprocess, sys
log = open(os.path.join(sys.argv[1], "roslaunch-host-%d.log" % os.getpid()), "w", buffering=1)
log.write(sys.argv[2] + "\\n")
child = subprocess.Popen([sys.executable, "-c", sys.argv[3]], start_new_session=True)
os.close(1)
for line in sys.stdin:
    log.write(line)
os.killpg(child.pid, signal.SIGKILL)
child.wait()
"""
CHILD = """
import time
from shsa_core.ros.processes.launch import Launch
launch = Launch()
while True:
    print(launch.ending(), flush=True)
    time.sleep(0.01)
"""
EXIT = "[roslaunch.pmon][INFO] 2026-01-01 10:00:00,000: ProcessMonitor._post_run <ProcessMonitor>"
SIGNAL = EXIT.replace("_post_run", "shutdown")


class Launched:
    """A node, and what stands for the roslaunch that started it.

    `wrapped`: through another process.
    """

    def __init__(self, folder: Path, before: str = "started", wrapped: bool = False) -> None:
        child = CHILD
        if wrapped:
            child = f"import subprocess, sys; subprocess.run([sys.executable, '-c', {CHILD!r}])"
        self.process = subprocess.Popen(
            [sys.executable, "-c", PARENT, str(folder), before, child],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            universal_newlines=True,
            bufsize=1,
        )

    def log(self, line: str) -> None:
        assert self.process.stdin
        self.process.stdin.write(line + "\n")

    def answers(self, count: int) -> List[str]:
        assert self.process.stdout
        return [self.process.stdout.readline().strip() for _ in range(count)]

    def ends(self) -> bool:
        """Return whether the node sees an end within 10 s."""
        end = time.monotonic() + 10.0
        while time.monotonic() < end:
            if self.answers(1) == ["True"]:
                return True
        return False


@pytest.fixture
def launched(tmp_path: Path) -> Iterator[List[Launched]]:
    made: List[Launched] = []
    yield made
    for each in made:
        each.process.communicate(timeout=10.0)


@pytest.mark.parametrize("line", [EXIT, SIGNAL])
@pytest.mark.parametrize("wrapped", [False, True])
def test_the_log_of_roslaunch_tells(
    launched: List[Launched], tmp_path: Path, line: str, wrapped: bool
) -> None:
    launched.append(Launched(tmp_path, wrapped=wrapped))
    launch = launched[0]
    assert launch.answers(3) == ["False"] * 3
    launch.log("[roslaunch][INFO] [x-1] restarting process")
    launch.log("[rosout][INFO] ProcessMonitor.shutdown is only talked about")
    assert launch.answers(20) == ["False"] * 20
    launch.log(line)
    assert launch.ends()
    assert launch.answers(3) == ["False"] * 3, "it is told once"


def test_what_was_logged_before_we_came_does_not_count(
    launched: List[Launched], tmp_path: Path
) -> None:
    launched.append(Launched(tmp_path, before=EXIT))
    launch = launched[0]
    assert launch.answers(3) == ["False"] * 3
    launch.log("[roslaunch][INFO] something else")
    assert launch.answers(20) == ["False"] * 20


def test_a_log_that_cannot_be_read_tells_nothing(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """As on a disk that fails: each event of the reconfigurator looks there first."""
    log = tmp_path / "roslaunch.log"
    log.touch()
    read = launching._LaunchLog(str(log))
    monkeypatch.setattr(launching, "_find_log", lambda pid: (1, read))
    ours, file = launching.Launch(), read._file
    failing = Mock(read=Mock(side_effect=OSError(errno.ESTALE, "Stale file handle")))
    monkeypatch.setattr(read, "_file", failing)
    assert not ours.ending() and failing.read.called
    monkeypatch.setattr(read, "_file", file)
    log.write_text(EXIT + "\n")
    assert ours.ending()


def test_a_node_of_the_same_name_on_another_master_is_another(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setenv("ROS_MASTER_URI", "http://localhost:12345")
    name = f"node_{os.getpid()}"
    processes = [
        subprocess.Popen(
            [sys.executable, "-c", "input()", f"__name:={name}"],
            env={**os.environ, "ROS_MASTER_URI": uri},
            stdin=subprocess.PIPE,
        )
        for uri in ("http://127.0.0.1:12345/", "http://localhost:12346", "nonsense:x")
    ]
    try:
        found = [each.process.pid for each in kernel.robot_processes() if each.node == f"/{name}"]
        assert found == [processes[0].pid]
    finally:
        for process in processes:
            process.communicate(b"\n")


def test_a_node_is_looked_for_again_where_the_means_lacked(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    failures = [OSError(errno.EMFILE, "too many open files")]

    def look() -> Iterator[kernel.Running]:
        if failures:
            raise failures.pop()
        yield kernel.Running(psutil.Process(), ["__name:=node"], {})

    monkeypatch.setattr(kernel, "robot_processes", look)
    launches = Launches()
    launches.learn("/node")
    wait_until(lambda: launches._known, 10.0, "it is found")
    assert not failures and launches._known["/node"][0] == os.getpid()


def test_a_healer_elsewhere_may_have_our_process_number(monkeypatch: pytest.MonkeyPatch) -> None:
    """As the second process of each container."""
    uri = "http://198.51.100.7:4321/"
    monkeypatch.setattr(launching, "uri_of", lambda node: uri)
    monkeypatch.setattr(launching, "pid_of", lambda uri: os.getpid())
    assert launching.find_other("/monitor") == f"process {os.getpid()} at {uri}"


def test_it_is_told_how_long_a_node_waits_for_a_processor() -> None:
    name = f"node_{os.getpid()}"
    busy = [sys.executable, "-c", "while True: pass", f"__name:={name}"]
    others = (os.cpu_count() or 1) + 2
    processes = [subprocess.Popen(busy[: 4 - (i > 0)]) for i in range(1 + others)]
    try:
        launches = Launches()
        launches.learn(f"/{name}")
        waited = lambda: dict(launches.waited()).get(f"/{name}", 0.0)
        before = wait_until(waited, 20.0, "it is known, and has waited")
        wait_until(lambda: waited() > before, 10.0, "it waits on")
    finally:
        for process in processes:
            process.kill()
            process.wait()
