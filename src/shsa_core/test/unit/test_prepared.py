"""Substitutes forked from a prepared process: real ones, without a ROS master."""
import errno
import os
import socket
import subprocess
import sys
import time
from contextlib import suppress
from pathlib import Path
from types import SimpleNamespace
from typing import Dict, Iterator, List
from unittest.mock import patch

import psutil
import pytest
import rospy
from roslib.packages import find_node

from shsa_core.healing.events import StartSubstitute
from shsa_core.model.service import Signal
from shsa_core.model.substitution import Program
from shsa_core.ros import settings
from shsa_core.ros.processes import kernel, prepared as prepared_process, starting as forking
from shsa_core.ros.processes.children import Started
from shsa_core.ros.processes.starting import Substitutes, Setup
from shsa_testing.waiting import wait_until

NAMESPACE = "/robot"
SETUP = Setup(f"{NAMESPACE}/substitute_")
START_S = 20.0


class Bench:
    """Substitutes, forked where that can be done, and what was told of their ends."""

    def __init__(self) -> None:
        self.ended: Dict[str, str] = {}
        self.ours = self.processes()

    def processes(self) -> Substitutes:
        """As a reconfigurator, or one that follows it, has them."""
        told = self.ended.__setitem__
        setup = SETUP._replace(forks=True, types=["std_msgs/Bool"])
        return Substitutes(told, lambda _: None, setup)

    @property
    def forking(self) -> forking.Forking:
        """Return the owner of the prepared process."""
        assert self.ours.forking is not None
        return self.ours.forking

    def ready(self, but: int = 0) -> psutil.Process:
        """Wait until there is a prepared process, and another one than `but`."""
        wait_until(lambda: self.pid not in (0, but), START_S, "a prepared process")
        return psutil.Process(self.pid)

    @property
    def pid(self) -> int:
        """Return the number of the prepared process; 0: there is none now."""
        process = self.forking._process
        return process.pid if process is not None and self.forking._line is not None else 0

    def close(self) -> None:
        """End all processes; without a master they would take their time to leave."""
        for process in list(self.ours.children._running.values()):
            with suppress(psutil.NoSuchProcess):
                process.kill()
        for node in self.ours.children.running():
            self.ours.children.stop(node)
        with patch.object(rospy, "is_shutdown", lambda: True):
            while self.forking._thread.is_alive():  # one may just come up
                if self.forking._process is not None:
                    self.forking._process.kill()
                self.forking._thread.join(0.05)

    def start(self, number: int = 1) -> psutil.Process:
        """Start an idle substitute."""
        node = f"{NAMESPACE}/substitute_a_{number}"
        self.ours.start(StartSubstitute(node, None))
        return self.ours.children._running[node]

    def is_forked(self, number: int = 1) -> bool:
        """Or was it started by rosrun?"""
        process = self.ours.children._running[f"{NAMESPACE}/substitute_a_{number}"]
        return not isinstance(process, Started)


@pytest.fixture
def bench(monkeypatch: pytest.MonkeyPatch) -> Iterator[Bench]:
    monkeypatch.setenv("ROS_MASTER_URI", "http://localhost:1")
    monkeypatch.setattr(settings, "FIRST_PAUSE_S", 0.01)
    made = Bench()
    yield made
    made.close()


def test_a_fork_is_a_process_of_its_own_as_rosrun_would_have_started_it(bench: Bench) -> None:
    prepared = bench.ready()
    assert prepared.num_threads() == 1 and prepared.cmdline()[2] == "--prepared"
    process = bench.start()
    assert bench.is_forked() and process.parent() == prepared
    assert os.getsid(process.pid) == os.getpgid(process.pid) == process.pid
    assert "__name:=substitute_a_1" in process.cmdline()
    (standby,) = find_node("shsa_core", "standby")[:1]
    assert process.cmdline()[1] == standby
    assert os.readlink(f"/proc/{process.pid}/fd/0") == os.devnull
    status = Path(f"/proc/{process.pid}/status").read_text()
    assert "NoNewPrivs:\t1" in status
    limits = {n: psutil.Process(process.pid).rlimit(n) for n in (psutil.RLIMIT_CORE,)}
    assert limits[psutil.RLIMIT_CORE] == (0, 0)


def test_a_fork_with_a_program_shows_its_name_however_long_its_code_is(bench: Bench) -> None:
    bench.ready()
    node = f"{NAMESPACE}/substitute_b_1"
    code = "y=" + "+".join(["x[0]"] * 3000)
    signals = [(Signal(t, "data", "std_msgs/Float64", "", 0.1, 0.5),) for t in ("/a", "/b")]
    program = Program(("/a/data",), code, ("/b/data",))
    bench.ours.start(StartSubstitute(node, program, signals[0], signals[1]))
    process = bench.ours.children._running[node]
    assert not isinstance(process, Started)
    assert "__name:=substitute_b_1" in process.cmdline()
    assert Substitutes(lambda *_: None, lambda _: None, SETUP).take_up() == [node]


def test_a_fork_that_nobody_can_look_after_is_ended(
    bench: Bench, monkeypatch: pytest.MonkeyPatch
) -> None:
    prepared = bench.ready()

    def lacking(pid: int) -> None:
        raise OSError(errno.EMFILE, "too many open files")

    errors = {"NoSuchProcess": psutil.NoSuchProcess, "Error": psutil.Error}
    with monkeypatch.context() as without:
        without.setattr(forking, "psutil", SimpleNamespace(Process=lacking, **errors))
        with pytest.raises(OSError):
            bench.start()
    wait_until(lambda: not prepared.children(), 5.0, "it is ended")


def test_the_end_of_a_fork_is_told_as_that_of_a_started_one(bench: Bench) -> None:
    bench.ready()
    process = bench.start()
    process.kill()
    wait_until(lambda: bench.ended, 5.0, "its end is told")
    assert bench.ended == {f"{NAMESPACE}/substitute_a_1": "exit status unknown"}
    wait_until(lambda: not psutil.pid_exists(process.pid), 5.0, "no zombie is left")


def test_a_ros_nodes_sockets_time_out_and_its_prepared_process_waits(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """As rospy sets it, though for a minute."""
    monkeypatch.setenv("ROS_MASTER_URI", "http://localhost:1")
    former = socket.getdefaulttimeout()
    socket.setdefaulttimeout(0.5)
    try:
        made = Bench()
        prepared = made.ready()
        for number in range(10):
            made.start(number)
        assert all(made.is_forked(number) for number in range(10))
        wait_until(lambda: time.time() > prepared.create_time() + 3.0, 10.0, "it had nothing to do")
        assert made.pid == prepared.pid and not made.ended
        made.close()
    finally:
        socket.setdefaulttimeout(former)


def test_twenty_at_once(bench: Bench) -> None:
    bench.ready()
    started = [bench.start(number) for number in range(1, 21)]
    assert all(bench.is_forked(number) for number in range(1, 21))
    assert len({process.pid for process in started}) == 20
    bench.ours.children.stop(f"{NAMESPACE}/substitute_a_3")
    wait_until(lambda: not started[2].is_running(), 5.0, "one has ended")
    assert all(each.is_running() for each in started if each != started[2])


def test_what_was_forked_goes_on_when_who_forked_it_is_killed_and_is_known(bench: Bench) -> None:
    prepared = bench.ready()
    process = bench.start()
    prepared.kill()
    again = bench.ready(but=prepared.pid)
    assert process.is_running() and not bench.ended
    follower = Substitutes(lambda *_: None, lambda _: None, SETUP)
    assert follower.take_up() == [f"{NAMESPACE}/substitute_a_1"]
    process.kill()
    wait_until(lambda: bench.ended, 5.0, "its end is told")
    assert bench.ended == {f"{NAMESPACE}/substitute_a_1": "exit status unknown"}
    bench.start(2)
    assert bench.is_forked(2) and again.is_running()


def test_one_that_is_stopped_is_passed_by_at_once_and_replaced(bench: Bench) -> None:
    prepared = bench.ready()
    prepared.suspend()
    wait_until(lambda: prepared.status() == psutil.STATUS_STOPPED, 5.0, "it is stopped")
    bench.start()
    assert not bench.is_forked()
    bench.ready(but=prepared.pid)
    bench.start(2)
    assert bench.is_forked(2)


def test_an_order_that_was_given_up_is_never_carried_out(
    bench: Bench, monkeypatch: pytest.MonkeyPatch
) -> None:
    """It stops after it was looked at, and hears the order when it is given up by then."""
    prepared = bench.ready()
    prepared.suspend()
    with monkeypatch.context() as patched:
        patched.setattr(kernel, "stopped", lambda process: False)
        patched.setattr(subprocess.Popen, "kill", lambda process: None)
        bench.start()
        assert not bench.is_forked()
        prepared.resume()
        wait_until(lambda: not prepared.is_running(), 5.0, "it hears that nobody waits")
    started = bench.ours.children._running[f"{NAMESPACE}/substitute_a_1"].pid

    def others() -> List[int]:
        name = "__name:=substitute_a_1"
        running = (each.process.pid for each in kernel.robot_processes() if name in each.words)
        return [pid for pid in running if pid != started]

    wait_until(lambda: not others(), 5.0, "the fork has ended without having begun")


def test_where_no_process_can_be_made_it_is_said(
    monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]
) -> None:
    def refuse() -> int:
        raise BlockingIOError(errno.EAGAIN, "Resource temporarily unavailable")

    monkeypatch.setattr(os, "fork", refuse)
    ours, its = socket.socketpair()
    assert not prepared_process._fork({"words": ["standby", "__name:=substitute_a_1"]}, its)
    assert ours.recv(100) == prepared_process.NOBODY
    assert "substitute_a_1 cannot be forked: [Errno 11]" in capfd.readouterr().err


def test_it_ends_with_who_gives_it_orders(bench: Bench) -> None:
    prepared, process = bench.ready(), bench.start()
    line = bench.forking._line
    assert line is not None
    line.shutdown(socket.SHUT_RDWR)
    wait_until(lambda: not prepared.is_running(), 5.0, "it has ended")
    assert process.is_running()


def test_in_a_sandbox_each_is_started_by_itself() -> None:
    none = Substitutes(lambda *_: None, lambda _: None, Setup("/", sandbox=["env"], forks=True))
    assert none.forking is None


def test_orders_come_on_a_socket_alone() -> None:
    (substitute,) = find_node("shsa_core", "substitute")[:1]
    done = subprocess.run(
        [sys.executable, substitute, "--prepared"],
        stdin=subprocess.DEVNULL,
        stderr=subprocess.PIPE,
        timeout=START_S,
    )
    assert done.returncode == 1 and b"it takes orders on a socket" in done.stderr
