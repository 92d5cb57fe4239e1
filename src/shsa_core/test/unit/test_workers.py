"""Threads that make calls, wait for processes and write the log: real ones, at their limits."""
import errno
import logging
import logging.handlers
import os
import signal
import subprocess
import sys
import threading
import time
from pathlib import Path
from types import SimpleNamespace
from typing import Any, Dict, List, Optional

import psutil
import pytest
import rospy

from shsa_core.ros.processes.children import Children, Started, end, ending
from shsa_core.ros.rospy_patches import log_queue
from shsa_core.ros.rospy_patches.log_queue import say_failures_once
from shsa_core.ros.settings import LOG_LINES
from shsa_core.ros.master import announce
from shsa_core.ros.workers import UrgentFirst, Workers
from shsa_testing.waiting import wait_until


def test_calls_are_made_side_by_side_and_no_more_than_are_allowed() -> None:
    go, lock = threading.Event(), threading.Lock()
    running: List[int] = []
    most: List[int] = []

    def call() -> None:
        with lock:
            running.append(1)
            most.append(len(running))
        go.wait(10.0)
        with lock:
            running.pop()

    workers = Workers("test", 6, lambda text: None)
    for _ in range(20):
        workers.put(call)
    wait_until(lambda: len(running) == 6, 5.0, "six calls at a time")
    go.set()
    wait_until(lambda: len(most) == 20 and not running, 5.0, "all calls are made")
    assert max(most) == 6


def test_what_is_urgent_waits_for_no_call_that_is_not() -> None:
    made: List[str] = []
    calls = UrgentFirst("test", pause=3600.0)
    calls.put("/first", lambda: made.append("/first"))
    for number in range(2000):
        calls.put("/other", lambda: made.append("/other"))
    calls.put("/needed", lambda: made.append("advertise"))
    calls.put("/needed", lambda: made.append("withdraw"))
    wait_until(lambda: made == ["/first"], 5.0, "the others rest after the first")
    calls.urge(["/needed"])
    wait_until(lambda: len(made) >= 3, 5.0, "what has become urgent is called")
    assert made[1:3] == ["advertise", "withdraw"]
    calls.put("/needed", lambda: made.append("again"))
    wait_until(lambda: "again" in made, 5.0, "what comes later is called")
    assert made.count("/other") <= 2, "one may have its turn after what was urgent"


def test_what_is_registered_is_read_while_another_thread_registers(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    read = threading.Event()

    class Master:
        registerPublisher = registerSubscriber = None

        def getSystemState(self) -> List[object]:
            read.set()
            return [[], [], []]

    monkeypatch.setattr(announce, "master_api", Master)
    with rospy.topics.get_topic_manager().lock:
        threading.Thread(target=announce.register_again, daemon=True).start()
        assert not read.wait(0.2), "a dictionary that changes cannot be read"
    assert read.wait(5.0)


def test_who_registers_again_is_told_of_publishers_that_did_so_before(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """The master tells only of those that come later."""
    told: List[Any] = []
    served: List[str] = []
    manager = SimpleNamespace(
        lock=threading.Lock(),
        get_publications=lambda: [("/ours", "x/Y")],
        get_subscriptions=lambda: [("/lost", "x/Y"), ("/known", "x/Y")],
    )
    master = SimpleNamespace(
        getSystemState=lambda: [[], [["/known", ["/me"]]], [["/me/known", ["/me"]]]],
        registerPublisher=lambda *_: ["http://consumer:1/"],
        registerSubscriber=lambda topic, *_: [f"http://publisher:1{topic}"],
        registerService=lambda service, *_: served.append(service),
    )
    services = SimpleNamespace(get_services=lambda: [("/me/known", ""), ("/me/lost", "")])
    hear = lambda uri: SimpleNamespace(publisherUpdate=lambda *what: told.append((uri, *what)))
    monkeypatch.setattr(announce, "master_api", lambda: master)
    monkeypatch.setattr(announce, "node_api", hear)
    monkeypatch.setattr(rospy, "get_name", lambda: "/me")
    monkeypatch.setattr(rospy, "get_node_uri", lambda: "http://me:1/")
    monkeypatch.setattr(rospy.topics, "get_topic_manager", lambda: manager)
    monkeypatch.setattr(rospy.impl.registration, "get_service_manager", lambda: services)
    announce.register_again()
    assert served == ["/me/lost"], "whoever has followed us under our name would lose its own"
    assert told == [("http://me:1/", "/master", "/lost", ["http://publisher:1/lost"])]


def test_a_call_that_raises_is_said_and_the_next_is_made() -> None:
    said: List[str] = []
    done = threading.Event()
    workers = Workers("test", 2, said.append)

    def fails() -> None:
        raise MemoryError("no memory")

    for _ in range(10):
        workers.put(fails)
    workers.put(done.set)
    assert done.wait(5.0)
    assert said == ["test: MemoryError: no memory"]


def test_where_no_thread_can_be_started_calls_are_still_made() -> None:
    """Memory for their stacks is what lacks: the limit on processes does not count for root."""
    script = """
import resource, sys, threading, time
from shsa_core.ros.master import announce
from shsa_core.ros.workers import UrgentFirst, Workers
said, made = [], []
workers = Workers("test", 50, said.append)
used = int(open("/proc/self/statm").read().split()[0]) * resource.getpagesize()
resource.setrlimit(resource.RLIMIT_AS, (used + (4 << 20), -1))
try:
    threading.Thread(target=time.sleep, args=(1.0,), daemon=True).start()
    sys.exit(77)
except RuntimeError:
    pass
for number in range(30):
    workers.put(lambda number=number: (time.sleep(0.01), made.append(number)))
end = time.monotonic() + 10.0
while len(made) < 30 and time.monotonic() < end:
    time.sleep(0.01)
assert sorted(made) == list(range(30)), made
assert len(said) == 1 and "no thread" in said[0], said
"""
    assert subprocess.run([sys.executable, "-c", script], timeout=60.0).returncode == 0


def test_the_end_of_each_process_is_told_by_one_thread() -> None:
    ended: Dict[str, Any] = {}
    children = Children(ended.__setitem__)
    before = threading.active_count()
    for status in range(5):
        process = Started([sys.executable, "-c", f"raise SystemExit({status})"], env=os.environ)
        children.keep(f"/{status}", process)
    wait_until(lambda: len(ended) == 5, 20.0, "all have ended")
    assert ended == {f"/{status}": f"exit status {status}" for status in range(5)}
    assert threading.active_count() == before


def test_the_end_of_a_process_is_told_though_a_look_has_failed(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    failures = [RuntimeError("no memory")]

    def look(process: psutil.Process) -> str:
        if failures:
            raise failures.pop()
        return ending(process)

    monkeypatch.setattr("shsa_core.ros.processes.children.ending", look)
    monkeypatch.setattr(rospy.rostime, "_rostime_initialized", True)
    ended: List[str] = []
    kept = Children(lambda node, how: ended.append(node))
    kept.keep("/short", Started(["true"]))
    wait_until(lambda: ended == ["/short"], 10.0, "its end was told")


def test_a_process_that_leads_no_group_is_ended_all_the_same() -> None:
    """As a substitute that was taken up, in a sandbox that forks."""
    words = ["sh", "-c", "sleep 600 & echo $!; wait"]
    with subprocess.Popen(words, stdout=subprocess.PIPE, start_new_session=True) as sandbox:
        assert sandbox.stdout is not None
        substitute = psutil.Process(int(sandbox.stdout.readline()))
        end(substitute)
        alive = not ending(substitute)
        os.killpg(sandbox.pid, signal.SIGKILL)
    assert not alive


def test_a_process_that_nobody_can_look_after_is_ended(monkeypatch: pytest.MonkeyPatch) -> None:
    started: List[int] = []
    made, us = psutil.Process.__init__, threading.get_ident()

    def lacking(process: psutil.Process, pid: Optional[int] = None) -> None:
        if threading.get_ident() != us:  # a thread that another test has left
            made(process, pid)
            return
        started.append(pid or 0)
        raise OSError(errno.EMFILE, "too many open files")

    with monkeypatch.context() as without:
        without.setattr(psutil.Process, "__init__", lacking)
        with pytest.raises(OSError):
            Started([sys.executable, "-c", "import time; time.sleep(60.0)"], env=os.environ)
    assert len(started) == 1 and not psutil.pid_exists(started[0])


class Stuck(logging.Handler):
    """A handler that stands still until it may go on."""

    def __init__(self) -> None:
        super().__init__()
        self.go = threading.Event()
        self.lines: List[str] = []

    def emit(self, record: logging.LogRecord) -> None:
        self.go.wait(20.0)
        self.lines.append(record.getMessage())


def test_whoever_says_something_does_not_wait_for_the_log(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    logger, stuck = logging.getLogger("test_stuck"), Stuck()
    logger.propagate = False
    logger.addHandler(stuck)
    monkeypatch.setattr(log_queue, "LOGGERS", ["test_stuck"])
    log = log_queue.LogQueue()
    begin = time.monotonic()
    for number in range(LOG_LINES + 500):
        logger.warning("line %d", number)
    assert time.monotonic() - begin < 2.0
    stuck.go.set()
    log.close()
    wait_until(lambda: len(stuck.lines) >= LOG_LINES, 5.0, "the lines that waited")
    assert stuck.lines[:2] == ["line 0", "line 1"]


def test_a_log_that_cannot_be_written_is_said_once(
    capfd: "pytest.CaptureFixture[str]", monkeypatch: pytest.MonkeyPatch
) -> None:
    """/dev/full is a disk that is full."""
    monkeypatch.setattr(logging.Handler, "handleError", logging.Handler.handleError)
    monkeypatch.setattr(logging.FileHandler, "_open", logging.FileHandler._open)
    say_failures_once()
    logger = logging.getLogger("test_full")
    logger.propagate = False
    logger.addHandler(logging.FileHandler("/dev/full"))
    lines: List[str] = []
    second = Stuck()
    second.go.set()
    second.lines = lines
    logger.addHandler(second)
    monkeypatch.setattr(log_queue, "LOGGERS", ["test_full"])
    log = log_queue.LogQueue()
    for number in range(50):
        logger.warning("line %d", number)
    log.close()
    said = capfd.readouterr().err.splitlines()
    assert len(said) == 1 and "/dev/full cannot be written" in said[0]
    assert len(lines) == 50


@pytest.mark.parametrize("kind", ["symlink", "fifo"])
def test_a_log_is_not_written_where_somebody_has_put_a_link_or_a_pipe(
    kind: str, tmp_path: Path, capfd: "pytest.CaptureFixture[str]", monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(logging.Handler, "handleError", logging.Handler.handleError)
    monkeypatch.setattr(logging.FileHandler, "_open", logging.FileHandler._open)
    say_failures_once()
    path, other = tmp_path / "monitor-1.log", tmp_path / "other"
    other.write_text("mine")
    path.symlink_to(other) if kind == "symlink" else os.mkfifo(path)
    handler = logging.handlers.RotatingFileHandler(str(path), "a", 50_000_000, 4)
    handler.emit(logging.makeLogRecord({"msg": "line"}))
    handler.close()
    assert other.read_text() == "mine"
    assert f"The log {path} cannot be written" in capfd.readouterr().err
