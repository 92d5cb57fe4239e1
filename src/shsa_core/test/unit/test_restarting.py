"""Nodes that were started again: known by their mark to who comes after who started them."""
import errno
import os
import signal
import subprocess
import sys
import time
from pathlib import Path
from typing import Any, Callable, Dict, Iterator, List

import psutil
import pytest
import rospy

from shsa_core.ros import settings
from shsa_core.ros.processes import kernel
from shsa_core.ros.processes.children import Children
from shsa_core.ros.processes.kernel import NOBODY, identity, robot_processes
from shsa_core.ros.processes.restarting import MARK, TICKS_HZ, Restarts, _Start
from shsa_testing.waiting import wait_until

NODE = "/driver"


@pytest.fixture(autouse=True)
def _alone(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(rospy, "get_namespace", lambda: "/")
    monkeypatch.setenv("ROS_MASTER_URI", "http://localhost:1")


def restarts(host: str = "pi", came: Callable[..., None] = lambda *_: None) -> Restarts:
    children = Children(lambda node, status: None)
    return Restarts(children, lambda node: None, came, host)


@pytest.fixture
def started(tmp_path: Path) -> Iterator[psutil.Process]:
    """A node that was started again by its agent; it was first started by us."""
    (tmp_path / "node").write_text("import time\ntime.sleep(60.0)\n")
    first = subprocess.Popen([sys.executable, str(tmp_path / "node")])
    agent, runs = restarts(), psutil.Process(first.pid)
    wait_until(runs.environ, 5.0, "it has begun")
    agent.learn(NODE, runs)
    first.kill()
    first.wait()
    process = agent.start(NODE)
    wait_until(process.environ, 5.0, "it has begun")
    yield process
    if process.is_running():
        process.kill()
    wait_until(lambda: agent._children.running() == [], 5.0, "its end is seen")


def test_a_node_that_was_started_again_is_known_by_what_runs(started: psutil.Process) -> None:
    heir = restarts()
    assert heir.take_up() == [NODE] and heir._children.running() == [NODE]
    assert heir.abandoned(ending=True) == []  # we have started it, and live
    heir._children.stop(NODE)
    wait_until(lambda: restarts().take_up() == [], 5.0, "it has ended")


def test_who_ends_while_it_is_looked_at_hides_nobody_and_a_look_without_means_is_none(
    started: psutil.Process, monkeypatch: pytest.MonkeyPatch
) -> None:
    look = psutil.Process.environ
    errors: List[OSError] = []

    def environ(process: psutil.Process) -> Any:
        if process.pid == os.getpid():
            raise errors[-1]
        return look(process)

    monkeypatch.setattr(psutil.Process, "environ", environ)
    for why in (errno.ENOENT, errno.ESRCH):
        errors.append(OSError(why, "it is not there"))
        assert started.pid in [each.process.pid for each in robot_processes()]
    errors.append(OSError(errno.EMFILE, "too many open files"))
    with pytest.raises(OSError):
        list(robot_processes())


def test_who_ends_with_us_is_whose_starter_has_started_us(
    started: psutil.Process, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(os, "getppid", os.getpid)
    heir = restarts()
    heir.take_up()
    assert heir.abandoned() == [] and heir.abandoned(ending=True) == [NODE]


@pytest.mark.parametrize("environment", [{"ROS_MASTER_URI": "http://localhost:2"}, {}])
def test_what_another_one_has_started_again_is_not_ours(
    started: psutil.Process, environment: Dict[str, str], monkeypatch: pytest.MonkeyPatch
) -> None:
    for name, value in environment.items():
        monkeypatch.setenv(name, value)
    assert restarts("pi" if environment else "other").take_up() == []


def test_what_a_node_has_started_is_not_the_node(
    started: psutil.Process, monkeypatch: pytest.MonkeyPatch
) -> None:
    words = [sys.executable, "-c", "print(flush=True); input()"]
    pipes = {"stdin": subprocess.PIPE, "stdout": subprocess.PIPE}
    with subprocess.Popen(words, env=started.environ(), **pipes) as child:  # type: ignore
        assert child.stdout is not None and child.stdout.readline()
        heir = restarts()
        assert heir.take_up() == [NODE]
        child.kill()
    assert heir._children.running() == [NODE]


def test_a_fork_is_looked_at_again_though_the_wall_clock_was_set(
    started: psutil.Process, monkeypatch: pytest.MonkeyPatch
) -> None:
    now = time.time()
    monkeypatch.setattr(time, "time", lambda: now + 3600.0)
    monkeypatch.setattr(settings, "LOOK_S", 600.0)
    agent = restarts()
    agent._starts[NODE] = _Start(["driver"], "", {}, NOBODY)
    agent._starters[NODE] = identity(os.getpid())
    assert agent._started_again(NODE) is None and started.pid not in agent._others[NODE]
    monkeypatch.setattr(settings, "LOOK_S", 0.0)
    assert agent._started_again(NODE) is None and started.pid in agent._others[NODE]


SIBLINGS = """
import os, subprocess, sys, time
def start(namespace, folder):
    own = {"ROS_NAMESPACE": namespace, "INVOCATION_ID": os.urandom(16).hex()}  # as of systemd
    print(subprocess.Popen(["sleep", "600"], env={**os.environ, **own}, cwd=folder).pid, flush=True)
for line in sys.stdin:
    start(*line.split())
"""


class Launching:
    """A launch whose nodes have one command line: each is started when that is said."""

    def __init__(self) -> None:
        pipes = {"stdin": subprocess.PIPE, "stdout": subprocess.PIPE, "start_new_session": True}
        words = [sys.executable, "-c", SIBLINGS]
        self.launch = subprocess.Popen(words, bufsize=0, **pipes)  # type: ignore[call-overload]

    def start(self, namespace: str, folder: str = "/") -> psutil.Process:
        ticks = lambda: time.clock_gettime(time.CLOCK_BOOTTIME) * TICKS_HZ
        before = ticks()
        wait_until(lambda: ticks() > before + 1.0, 5.0, "the kernel tells it from an earlier one")
        self.launch.stdin.write(f"{namespace} {folder}\n".encode())
        process = psutil.Process(int(self.launch.stdout.readline()))
        begun = lambda: process.cmdline() == ["sleep", "600"] and process.environ()
        wait_until(begun, 5.0, "it has begun")  # its words are there a moment before the rest
        return process


@pytest.fixture
def launching() -> Iterator[Launching]:
    launching = Launching()
    yield launching
    os.killpg(launching.launch.pid, signal.SIGKILL)
    launching.launch.communicate()


def test_a_sibling_with_the_same_command_is_not_the_node(launching: Launching) -> None:
    """It was adopted as the node, which is kept out, and ended."""
    agent, node = restarts(), launching.start("a")
    agent.learn("/a/cam", node)
    node.kill()
    launching.start("b")
    launching.start("a", folder="/tmp")
    assert agent._started_again("/a/cam") is None
    successor = launching.start("a")
    assert agent._started_again("/a/cam") == successor


def test_a_process_that_is_older_or_another_node_is_not_the_node(launching: Launching) -> None:
    agent, other, node = restarts(), launching.start("a"), launching.start("a")
    agent.learn("/cam_1", other)
    agent.learn("/cam_2", node)
    node.kill()
    assert agent._started_again("/cam_2") is None
    later = launching.start("a")
    agent.learn("/cam_1", later)
    assert agent._started_again("/cam_2") is None
    assert agent._started_again("/cam_1") is None  # it runs


@pytest.mark.parametrize("first, is_starter", [("/usr/bin/roslaunch", True), ("/sbin/init", False)])
def test_the_first_process_has_started_a_node_if_it_is_a_launch(
    monkeypatch: pytest.MonkeyPatch, first: str, is_starter: bool
) -> None:
    """It is in a container; elsewhere it adopts whose parent has ended."""
    monkeypatch.setattr(psutil.Process, "ppid", lambda process: int(process.pid != 1))
    words = psutil.Process.cmdline
    monkeypatch.setattr(
        psutil.Process, "cmdline", lambda each: [first] if each.pid == 1 else words(each)
    )
    assert kernel.started_by_launch(os.getpid()) == is_starter
    agent = restarts()
    agent.learn(NODE, psutil.Process())
    assert agent._starters[NODE] == (identity(1) if is_starter else NOBODY)
    assert kernel.never_to_end(psutil.Process(1))


def test_a_process_that_has_no_command_any_more_is_not_the_node(
    started: psutil.Process, monkeypatch: pytest.MonkeyPatch
) -> None:
    heir = restarts()
    heir.take_up()  # the command of the node is not known yet
    monkeypatch.setattr(psutil.Process, "cmdline", lambda process: [])  # as of one that has ended
    assert heir._started_again(NODE) is None


@pytest.mark.parametrize(
    "mark",
    [
        '["/ pi", "/driver", Infinity, 0]',
        f'["/ pi", "/driver", 1, {10 ** 400}]',
        '["/ pi", ["/driver"], 1, 0]',
        '["/ pi", 7, 1, 0]',
        "[" * 100_000,
    ],
    ids=["infinite", "huge", "a list", "a number", "too deep"],
)
def test_a_mark_that_makes_no_sense_is_none(mark: str) -> None:
    strange = {**os.environ, MARK: mark}
    words = [sys.executable, "-c", "print(flush=True); input()"]
    pipes = {"stdin": subprocess.PIPE, "stdout": subprocess.PIPE, "start_new_session": True}
    with subprocess.Popen(words, env=strange, **pipes) as child:  # type: ignore
        assert child.stdout is not None and child.stdout.readline()
        heir = restarts()
        taken = heir.take_up()
        child.kill()
    assert taken == [] and heir._children.running() == []


def test_the_watch_goes_on_whatever_goes_wrong(
    monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    """Healing would wait for nodes that were started again for good, and end none of its own."""
    rospy.rostime.set_rostime_initialized(True)
    tries, ours = [], psutil.Process()

    def fail_once(node: str, process: Any) -> None:
        tries.append(node)
        if len(tries) == 1:
            raise psutil.AccessDenied(process.pid)

    agent = restarts(came=fail_once)
    monkeypatch.setattr(agent, "_started_again", lambda node: ours if node == NODE else 1 / 0)
    agent.watch(["/other", NODE])
    wait_until(lambda: len(tries) == 2, 5.0, "it is told again")
    assert "/other could not handle something: ZeroDivisionError" in caplog.text
    assert f"{NODE} could not handle something: AccessDenied" in caplog.text
    wait_until(lambda: agent._told == {NODE: ours}, 5.0, "it is told")
