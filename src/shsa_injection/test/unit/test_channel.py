"""The socket of an injectable node is its user's alone, and knows who is at the other end."""
import os
import socket
import subprocess
import sys
import threading
import time
from pathlib import Path
from typing import Dict

import psutil
import pytest

from shsa_core.errors import ShsaError
from shsa_injection import channel
from shsa_injection.inside.injectable import is_python
from shsa_injection.ros.guard import Guard

LONG = "a_folder_whose_name_is_too_long_for_the_address_of_a_unix_socket" * 2


def home(path: Path) -> Dict[str, str]:
    return {"ROS_HOME": str(path)}


def test_documents_go_both_ways_however_long_the_path_is(tmp_path: Path) -> None:
    environment = home(tmp_path / LONG)
    listening, path = channel.listen(environment)
    assert os.stat(os.path.dirname(path)).st_mode & 0o777 == 0o700

    def answer() -> None:
        connection, _ = listening.accept()
        assert channel.peer(connection) == (os.getpid(), os.getuid())
        channel.send(connection, {"heard": channel.receive(connection)})
        connection.close()

    thread = threading.Thread(target=answer)
    thread.start()
    with channel.connect(os.getpid(), environment, 5.0) as connection:
        channel.send(connection, {"fault": "stuck"})
        assert channel.receive(connection) == {"heard": {"fault": "stuck"}}
        assert channel.receive(connection) == {}
    thread.join()
    listening.close()


def test_a_folder_that_others_can_reach_is_refused(tmp_path: Path) -> None:
    (tmp_path / channel.FOLDER).mkdir(mode=0o755)
    with pytest.raises(ShsaError, match="0700"):
        channel.folder(home(tmp_path))


def test_a_link_in_the_place_of_the_folder_is_refused(tmp_path: Path) -> None:
    (tmp_path / "elsewhere").mkdir(mode=0o700)
    (tmp_path / channel.FOLDER).symlink_to(tmp_path / "elsewhere")
    with pytest.raises(ShsaError, match="0700"):
        channel.folder(home(tmp_path))


def test_a_process_that_answers_in_the_place_of_another_is_refused(tmp_path: Path) -> None:
    listening, path = channel.listen(home(tmp_path))
    os.rename(path, os.path.join(os.path.dirname(path), "1.socket"))
    with pytest.raises(ShsaError, match="another process than 1 answers"):
        channel.connect(1, home(tmp_path), 1.0)
    listening.close()


def test_sockets_of_the_dead_are_cleared(tmp_path: Path) -> None:
    _, path = channel.listen(home(tmp_path))
    dead = os.path.join(os.path.dirname(path), "999999999.socket")
    socket.socket(socket.AF_UNIX).bind(dead) if len(dead) < 100 else Path(dead).touch()
    channel.clear(home(tmp_path))
    assert os.listdir(os.path.dirname(path)) == [os.path.basename(path)]


@pytest.mark.parametrize("line", [b"[1]\n", b"{\n", b"\xff\n", b"9" * 70000 + b"\n"])
def test_what_is_no_document_is_refused(line: bytes) -> None:
    ours, theirs = socket.socketpair()
    theirs.sendall(line)
    with pytest.raises(ShsaError):
        channel.receive(ours)
    ours.close()
    theirs.close()


def test_a_python_program_is_told_from_another(tmp_path: Path) -> None:
    script, other = tmp_path / "script", tmp_path / "other"
    script.write_text("#!/usr/bin/env python3\n")
    other.write_text("#!/bin/sh\n")
    assert is_python(str(script)) and not is_python(str(other))


@pytest.mark.parametrize("seconds", [None, 0.2])
def test_a_guard_continues_a_process_at_its_deadline_or_when_it_is_told(seconds: float) -> None:
    child = subprocess.Popen([sys.executable, "-c", "import time; time.sleep(60)"])
    process = psutil.Process(child.pid)
    order = {"action": "continue", "pid": child.pid, "created": process.create_time()}
    process.suspend()
    with Guard({**order, "seconds": seconds}) as guard:
        if seconds is not None:
            deadline = time.monotonic() + 10.0
            while process.status() == psutil.STATUS_STOPPED and time.monotonic() < deadline:
                time.sleep(0.01)
            assert process.status() != psutil.STATUS_STOPPED
    assert guard.told == {"done": True}
    assert process.status() != psutil.STATUS_STOPPED
    child.kill()
    child.wait()


def test_a_guard_leaves_alone_whoever_has_the_same_number() -> None:
    child = subprocess.Popen([sys.executable, "-c", "import time; time.sleep(60)"])
    created = psutil.Process(child.pid).create_time() - 100.0
    psutil.Process(child.pid).suspend()
    order = {"action": "continue", "pid": child.pid, "created": created}
    with Guard({**order, "seconds": None}) as guard:
        pass
    assert guard.told == {"done": False}
    assert psutil.Process(child.pid).status() == psutil.STATUS_STOPPED
    child.kill()
    child.wait()
