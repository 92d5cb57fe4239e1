"""Records that outlive a process: written, read again, refused if they cannot be ours."""
import os
from pathlib import Path
from typing import Callable, List

import pytest

from shsa_core.errors import ModelError
from shsa_core.healing.records import Counters, Healthy, Record
from shsa_core.journal.codec import Codec
from shsa_core.journal.record_file import RecordFile, read_records
from shsa_core.planning.pool import IdleProcess

CODEC = Codec(Record)
OWNER = {"boot": "b", "run": "r"}
ONE, TWO = Healthy("/a", "/n", 1.5), IdleProcess("/substitute_standby_1", 2.0)


@pytest.fixture
def path(tmp_path: Path) -> str:
    return str(tmp_path / "robot.records")


def write(path: str, warned: List[str]) -> RecordFile:
    file = RecordFile(path, CODEC, OWNER, warned.append)
    file.write([Counters(1, 2), ONE])
    file.write([Counters(2, 2), TWO])
    file.write([], [ONE.key])
    return file


def make_fifo(path: Path) -> None:
    path.unlink()
    os.mkfifo(path)


def test_the_newest_of_each_is_read_again(path: str) -> None:
    warned: List[str] = []
    write(path, warned)
    former = read_records(path, CODEC)
    assert former.owner == OWNER and not warned
    assert set(former.records) == {Counters(2, 2), TWO}
    assert os.stat(path).st_mode & 0o777 == 0o600


def test_there_are_none_at_first(path: str) -> None:
    assert read_records(path, CODEC).records == ()


def test_a_last_line_that_was_cut_is_left_out(path: str) -> None:
    write(path, [])
    with open(path, "ab") as file:
        file.write(b'{"class":"Counters","incid')
    assert set(read_records(path, CODEC).records) == {Counters(2, 2), TWO}


def test_the_former_file_stays_until_something_is_written(path: str) -> None:
    write(path, []).close()
    new = RecordFile(path, CODEC, OWNER, print)
    assert set(read_records(path, CODEC).records) == {Counters(2, 2), TWO}
    new.write([ONE])
    assert read_records(path, CODEC).records == (ONE,)


def test_it_does_not_grow_for_ever(path: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("shsa_core.journal.record_file.GROWTH_BYTES", 1000)
    file = RecordFile(path, CODEC, OWNER, print)
    for number in range(1000):
        file.write([Counters(number, 1), ONE])
    assert os.stat(path).st_size < 3000
    assert set(read_records(path, CODEC).records) == {Counters(999, 1), ONE}


@pytest.mark.parametrize(
    "spoil",
    [
        lambda path: path.write_bytes(b"x\n"),
        lambda path: path.write_bytes(b'{"journal":1}\n'),
        lambda path: path.write_bytes(path.read_bytes() + b'{"class":"Shell","words":["rm"]}\n'),
        lambda path: path.write_bytes(path.read_bytes() + b'{"removed":[1]}\n'),
        lambda path: path.write_bytes(path.read_bytes() + b"\xff\n"),
        lambda path: path.chmod(0o644),
        lambda path: path.chmod(0o620),
        lambda path: (path.rename(str(path) + "x"), path.symlink_to(str(path) + "x")),
        make_fifo,
        lambda path: (path.unlink(), path.mkdir()),
    ],
)
def test_what_cannot_be_ours_is_refused(path: str, spoil: Callable[[Path], object]) -> None:
    write(path, []).close()
    spoil(Path(path))
    with pytest.raises(ModelError):
        read_records(path, CODEC)


def test_what_cannot_be_written_is_told_once_and_written_later(tmp_path: Path) -> None:
    warned: List[str] = []
    path = str(tmp_path / "folder" / "robot.records")
    file = RecordFile(path, CODEC, OWNER, warned.append)
    file.write([ONE])
    file.write([TWO])
    assert len(warned) == 1 and "cannot be written" in warned[0]
    (tmp_path / "folder").mkdir()
    file.write([Counters(1, 1)])
    assert set(read_records(path, CODEC).records) == {ONE, TWO, Counters(1, 1)}
    assert len(warned) == 2 and "can be written again" in warned[1]
