"""A publisher that fails on command: its silences, and how it hears of its faults."""
import socket
import tempfile
from itertools import groupby
from pathlib import Path

import pytest
import rospy

from shsa_testing.faulty_publisher import BETWEEN, FaultHandle, FaultyPublisher, Silences


def test_no_silence_unless_commanded() -> None:
    silences = Silences()
    assert not any(silences.skip() for _ in range(100))


def test_silences_are_as_long_as_commanded_with_messages_between_them() -> None:
    silences = Silences(3, 10)
    skipped = [silences.skip() for _ in range(5000)]
    runs = [(silent, len(list(group))) for silent, group in groupby(skipped)][:-1]
    assert {length for silent, length in runs if not silent} == {BETWEEN}
    # Who leaves out n - 1 messages is silent for n periods.
    assert {length + 1 for silent, length in runs if silent} == {*range(3, 11)}


def test_the_next_node_of_a_name_hears_its_faults_and_no_file_is_left(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(rospy, "get_name", lambda: "/tested_node")
    files = set(Path(tempfile.gettempdir()).glob("shsa_fault*"))
    first, second = (FaultyPublisher.__new__(FaultyPublisher) for _ in range(2))
    for node in (first, second):
        node.faults = socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM)
    assert first._bound() and not second._bound()
    first.faults.close()  # as the kernel does for a killed one
    assert second._bound()
    FaultHandle("/tested_node").fault("mute")
    assert second.faults.recv(100) == b"mute"
    second.faults.close()
    assert set(Path(tempfile.gettempdir()).glob("shsa_fault*")) == files
