"""The run of a node."""
import gc
import signal
import subprocess
import sys
from pathlib import Path
from typing import Any, List

import pytest
import rospy

from shsa_core.ros import node
from shsa_testing.waiting import wait_until

NODE = Path(__file__).resolve().parents[2] / "nodes" / "substitute"


class Nothing:
    def __call__(self, *_: object) -> "Nothing":
        return self

    def close(self) -> None:
        pass


def test_what_is_loaded_before_a_node_works_is_not_looked_through_for_garbage(
    monkeypatch: Any,
) -> None:
    ours = ("say_failures_once", "keep_rospys_threads", "serve_each_by_itself")
    for name in (*ours, "ask_in_time", "ask_once_for_rosout", "LogQueue"):
        monkeypatch.setattr(node, name, Nothing())
    for name in ("init_node", "signal_shutdown"):
        monkeypatch.setattr(rospy, name, Nothing())
    interval, frozen = sys.getswitchinterval(), []  # type: float, List[int]
    try:
        node.run("node", lambda: frozen.append(gc.get_freeze_count()))
    finally:
        gc.unfreeze()
        sys.setswitchinterval(interval)
    assert frozen[0] > 10_000


def test_a_substitute_that_is_interrupted_before_rospy_heeds_it_just_ends() -> None:
    words = [sys.executable, str(NODE), "/a/data", "y=x[0]", "/b/data"]
    process = subprocess.Popen(words, stderr=subprocess.PIPE, universal_newlines=True)
    try:
        imports = lambda: "/_ssl" in Path(f"/proc/{process.pid}/maps").read_text()
        wait_until(imports, 30.0, "it loads what it needs")
        process.send_signal(signal.SIGINT)
        _, said = process.communicate(timeout=30.0)
    finally:
        process.kill()
    assert "Traceback" not in said


def test_a_node_that_starts_as_the_master_ends_says_so(
    monkeypatch: Any, capfd: Any, caplog: Any
) -> None:
    ours = ("say_failures_once", "keep_rospys_threads", "serve_each_by_itself", "ask_in_time")
    for name in (*ours, "ask_once_for_rosout", "LogQueue"):
        monkeypatch.setattr(node, name, Nothing())
    for name in ("init_node", "signal_shutdown"):
        monkeypatch.setattr(rospy, name, Nothing())

    def work() -> None:
        raise ConnectionRefusedError(111, "Connection refused")

    interval = sys.getswitchinterval()
    try:
        with pytest.raises(SystemExit):
            node.run("node", work)
    finally:
        gc.unfreeze()
        sys.setswitchinterval(interval)
    assert "The master does not answer: [Errno 111] Connection refused" in caplog.text
    assert "Traceback" not in capfd.readouterr().err
