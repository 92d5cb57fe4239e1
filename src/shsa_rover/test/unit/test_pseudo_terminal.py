"""The serial line in software, with a real pseudo-terminal and pyserial."""
import os
from pathlib import Path
from typing import Iterator

import pytest
import serial

from shsa_core.errors import ShsaError
from shsa_rover.pseudo_terminal import PseudoTerminal


@pytest.fixture(name="line")
def _line(tmp_path: Path) -> Iterator[PseudoTerminal]:
    line = PseudoTerminal(str(tmp_path / "uart"))
    yield line
    line.close()


def open_port(line: PseudoTerminal) -> serial.Serial:
    """Return the port as the amperemeter opens it."""
    return serial.Serial(line.link, 115200, timeout=1.0)


def test_bytes_arrive_unchanged(line: PseudoTerminal) -> None:
    everything = bytes(range(256))
    with open_port(line) as port:
        assert line.connected
        assert line.write(everything) == 256
        assert port.read(256) == everything


def test_nobody_reads_and_nothing_blocks_or_is_kept(line: PseudoTerminal) -> None:
    assert not line.connected
    for _ in range(1000):
        assert line.write(bytes(100)) == 0
    assert line.lost_bytes == 100000
    with open_port(line) as port:
        line.write(b"now")
        assert port.read(3) == b"now"
        assert port.in_waiting == 0


def test_a_reader_that_sleeps_loses_bytes_but_blocks_nobody(line: PseudoTerminal) -> None:
    with open_port(line) as port:
        for _ in range(5000):
            line.write(bytes(100))
        assert line.lost_bytes > 0
        backlog = port.read(100 * 5000 - line.lost_bytes)
        assert len(backlog) == 100 * 5000 - line.lost_bytes
        line.write(b"again")
        assert port.read(5) == b"again"


def test_the_port_can_be_opened_again(line: PseudoTerminal) -> None:
    for word in (b"one", b"two"):
        with open_port(line) as port:
            line.write(word)
            assert port.read(3) == word
        assert not line.connected


def test_unplugging_is_noticed_and_leaves_nothing(tmp_path: Path) -> None:
    line = PseudoTerminal(str(tmp_path / "uart"))
    with open_port(line) as port:
        line.close()
        with pytest.raises((serial.SerialException, OSError)):
            port.read(1)
    assert list(tmp_path.iterdir()) == []


def test_a_stale_link_is_replaced(tmp_path: Path) -> None:
    os.symlink("/nowhere", str(tmp_path / "uart"))
    line = PseudoTerminal(str(tmp_path / "uart"))
    with open_port(line):
        assert line.connected
    line.close()


def test_the_link_of_a_successor_is_left_alone(tmp_path: Path) -> None:
    first = PseudoTerminal(str(tmp_path / "uart"))
    second = PseudoTerminal(str(tmp_path / "uart"))
    first.close()
    with open_port(second):
        assert second.connected
    second.close()
    assert list(tmp_path.iterdir()) == []


def test_a_file_is_not_overwritten(tmp_path: Path) -> None:
    file = tmp_path / "uart"
    file.write_text("precious", encoding="utf-8")
    with pytest.raises(ShsaError, match="exists and is not a symbolic link"):
        PseudoTerminal(str(file))
    assert file.read_text(encoding="utf-8") == "precious"


def test_a_folder_that_does_not_exist_is_named(tmp_path: Path) -> None:
    with pytest.raises(ShsaError, match="uart: cannot be made: No such file or directory"):
        PseudoTerminal(str(tmp_path / "nowhere" / "uart"))
