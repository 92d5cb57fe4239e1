"""Waiting ends in time, and processes are found by the mark that they inherit."""
import os
import subprocess
import sys
import uuid

import psutil
import pytest

from shsa_testing.processes import end_process, marked, running
from shsa_testing.waiting import wait_until


def test_waiting_returns_what_it_waited_for() -> None:
    answers = iter([None, 0, "there"])
    assert wait_until(lambda: next(answers), 5.0, "an answer") == "there"


def test_waiting_in_vain_says_for_what() -> None:
    with pytest.raises(AssertionError, match="0.01 s in vain: the moon"):
        wait_until(lambda: False, 0.01, "the moon")


def test_a_marked_process_is_found_until_it_has_ended() -> None:
    mark = uuid.uuid4().hex
    command = [sys.executable, "-c", "import time; time.sleep(60)"]
    process = subprocess.Popen(command, env={**os.environ, "SHSA_MARK": mark})
    handle = psutil.Process(process.pid)
    wait_until(lambda: marked("SHSA_MARK", mark) == [handle], 5.0, "it is found")
    assert running(handle) and not marked("SHSA_MARK", mark + "x")
    end_process(process)
    assert not marked("SHSA_MARK", mark) and not running(handle)
