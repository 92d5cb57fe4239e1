"""A guard takes a fault of a process back: at its deadline, or when whoever made it has ended.

It is a process of its own, in a session of its own, so that nothing stays stopped or dead because
the tool was killed. It is given one JSON line on its standard input; the end of that is the end of
the fault.
"""
import json
import os
import select
import signal
import subprocess
import sys
import time
from contextlib import suppress
from types import TracebackType
from typing import Any, Dict, List, Mapping, Optional, Sequence, Type

import psutil

READY = b"ready\n"
STARTER = "SHSA_INJECTION_STARTER"
"""The variable that tells who started a node first, where a guard has started it again."""
START_TIMEOUT_S = 20.0
END_TIMEOUT_S = 20.0
POLL_S = 0.5
LEAVING_S = 3.0


class Guard:
    """The handle of a guard. `order`: see `main`; it is ready once this is made.

    As a context it ends with the context.
    """

    def __init__(self, order: Mapping[str, Any]) -> None:
        environment = order.get("environment", dict(os.environ))
        self._process = subprocess.Popen(
            [sys.executable, os.path.abspath(__file__)],
            env=environment,
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            start_new_session=True,
        )
        self.told: Dict[str, Any] = {}
        assert self._process.stdin is not None and self._process.stdout is not None
        self._process.stdin.write(json.dumps(dict(order)).encode() + b"\n")
        self._process.stdin.flush()
        self._output = self._process.stdout
        if not select.select([self._output], [], [], START_TIMEOUT_S)[0]:
            self._process.kill()
        if self._output.readline() != READY:
            raise OSError("the guard that takes a fault back could not be started")

    def end(self) -> Dict[str, Any]:
        """Have the fault taken back, wait until it is, and tell what was done."""
        stdin = self._process.stdin
        if stdin is not None and not stdin.closed:
            stdin.close()
            if select.select([self._output], [], [], END_TIMEOUT_S)[0]:
                self.told = json.loads(self._output.readline() or b"{}")
            self._output.close()
        return self.told

    def __enter__(self) -> "Guard":
        return self

    def __exit__(
        self,
        kind: Optional[Type[BaseException]],
        error: Optional[BaseException],
        trace: Optional[TracebackType],
    ) -> None:
        self.end()


def main() -> None:
    """Wait, act once, tell what was done.

    The order has `seconds` or None and `action`: `continue` the process `pid`, which was made
    at `created`; or `start` `words` in `folder` once that process has ended, to end with the
    process `starter` that was made at `starter_created`, if any, unless it runs again already: a
    launch may have seen to that.
    """
    signal.signal(signal.SIGPIPE, signal.SIG_IGN)
    order = json.loads(sys.stdin.readline())
    os.write(1, READY)
    _wait(order["seconds"])
    if order["action"] == "start":
        _start(order)
        return
    process = _process(order["pid"], order["created"])
    if process is not None:
        process.send_signal(signal.SIGCONT)
    _tell({"done": process is not None})


def _wait(seconds: Optional[float]) -> None:
    """Until the deadline, or the end of the standard input."""
    end = None if seconds is None else time.monotonic() + seconds
    while True:
        left = None if end is None else end - time.monotonic()
        if left is not None and left <= 0.0:
            return
        if select.select([0], [], [], left)[0] and not os.read(0, 4096):
            return


def _start(order: Mapping[str, Any]) -> None:
    """Start a program as it was started before, and stay until it ends.

    It ends with whoever started it first, as a node does with its launch.
    """
    starter = None
    if order["starter"] is not None:
        starter = _process(order["starter"], order["starter_created"])
        if starter is None:  # the launch has ended meanwhile
            _tell({"done": False})
            return
    former = _process(order["pid"], order["created"]) if "pid" in order else None
    if former is not None:  # it was asked to leave
        with suppress(psutil.TimeoutExpired):
            former.wait(LEAVING_S)
    words: List[str] = order["words"]
    if _running(words):
        _tell({"done": False, "runs": True})
        return
    child = subprocess.Popen(
        words,
        cwd=order["folder"],
        env={**os.environ, STARTER: json.dumps([order["starter"], order["starter_created"]])},
        stdin=subprocess.DEVNULL,
        stdout=subprocess.DEVNULL,
        stderr=subprocess.DEVNULL,
    )
    _tell({"done": True, "pid": child.pid})
    devnull = os.open(os.devnull, os.O_RDWR)
    for descriptor in (0, 1, 2):  # whoever reads what the tool prints need not wait for us
        os.dup2(devnull, descriptor)
    while child.poll() is None:
        try:
            child.wait(POLL_S)
        except subprocess.TimeoutExpired:
            if starter is not None and not _lives(starter):
                _end(child)


def _running(words: Sequence[str]) -> bool:
    """Return whether this user's process, on the same master, was started by the same words."""
    for process in psutil.process_iter():
        try:
            same = process.uids().real == os.getuid() and process.cmdline() == words
            if same and _lives(process):
                master = process.environ().get("ROS_MASTER_URI")
                if master == os.environ.get("ROS_MASTER_URI"):
                    return True
        except (psutil.Error, OSError):
            continue  # it has ended meanwhile
    return False


def _end(child: "subprocess.Popen[bytes]") -> None:
    for number in (signal.SIGINT, signal.SIGKILL):
        child.send_signal(number)
        try:
            child.wait(LEAVING_S)
            return
        except subprocess.TimeoutExpired:
            continue


def _process(pid: int, created: float) -> Optional[psutil.Process]:
    """Return the process that has this number since then; None if it has ended."""
    try:
        process = psutil.Process(pid)
        return process if process.create_time() == created and _lives(process) else None
    except psutil.Error:
        return None


def _lives(process: psutil.Process) -> bool:
    try:
        return bool(process.is_running() and process.status() != psutil.STATUS_ZOMBIE)
    except psutil.NoSuchProcess:
        return False


def _tell(document: Mapping[str, Any]) -> None:
    try:
        os.write(1, json.dumps(dict(document)).encode() + b"\n")
    except OSError:
        return  # nobody reads it any more: the tool was killed


if __name__ == "__main__":
    main()
