"""What a master knew, in a file: for the next reconfigurator, and for a minute."""
import os
import time
from pathlib import Path

import pytest

from shsa_core.analysis.registrations import NOTHING, Graph, Part
from shsa_core.ros import settings
from shsa_core.ros.succession import KnowledgeFile

KNOWN = (
    42,
    Graph(
        {
            Part.PUBLISHER: frozenset({("/x", "/a"), ("/x", "/b")}),
            Part.SUBSCRIBER: frozenset({("/x", "/c")}),
            Part.SERVICE: frozenset({("/a/get", "/a")}),
        },
        {"/a": "http://here:1/", "/b": "http://here:2/", "/c": "http://here:3/"},
        {"/a/get": "rosrpc://here:4"},
    ),
)


@pytest.fixture
def path(tmp_path: Path) -> str:
    return str(tmp_path / "robot.master")


def test_the_next_one_reads_what_was_written(path: str) -> None:
    assert KnowledgeFile(path, "a boot").read() == (0, NOTHING)
    KnowledgeFile(path, "a boot").write(*KNOWN)
    assert KnowledgeFile(path, "a boot").read() == KNOWN
    assert os.stat(path).st_mode & 0o777 == 0o600


def test_what_is_known_still_is_new_again_and_not_written_again(path: str) -> None:
    file = KnowledgeFile(path, "a boot")
    file.write(*KNOWN)
    written = os.stat(path).st_ino
    os.utime(path, (0.0, 0.0))
    file.write(*KNOWN)
    assert os.stat(path).st_ino == written
    assert file.read() == KNOWN
    file.write(43, KNOWN[1])
    assert file.read()[0] == 43


def test_what_is_old_or_of_another_boot_or_none_does_not_count(path: str) -> None:
    file = KnowledgeFile(path, "a boot")
    file.write(*KNOWN)
    for age in (settings.LONGEST_PAUSE_S + 1.0, -5.0):
        os.utime(path, (time.time() - age,) * 2)
        assert file.read() == (0, NOTHING)
    os.utime(path)
    assert KnowledgeFile(path, "another").read() == (0, NOTHING)
    for text in ("", "{", "[]", "{}", '{"boot": 1, "pid": 2}'):
        Path(path).write_text(text, "utf-8")
        assert file.read() == (0, NOTHING)


def test_what_cannot_be_written_is_written_later(path: str) -> None:
    os.mkdir(path + ".new")
    file = KnowledgeFile(path, "a boot")
    file.write(*KNOWN)
    assert file.read() == (0, NOTHING)
    os.rmdir(path + ".new")
    file.write(*KNOWN)
    assert file.read() == KNOWN
