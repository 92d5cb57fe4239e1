"""A failure walks through few rooms of healing, and seldom back: it can be followed by reading."""
import sys
from pathlib import Path
from types import FrameType
from typing import Any, List

import pytest
from core_robot import A, B, C, Robot, service

from shsa_core import healing
from shsa_core.healing import events
from shsa_core.model.kinds import Kind, Standby
from shsa_core.model.som import Som

ROOM = str(Path(healing.__file__).parent)
MOST_FILES = 15
MOST_REENTRIES = 40


def walked(robot: Robot, event: events.Event) -> List[str]:
    """The file of each call in healing that an event makes."""
    files: List[str] = []

    def note(frame: FrameType, what: str, _: Any) -> None:
        if what == "call" and frame.f_code.co_filename.startswith(ROOM):
            files.append(frame.f_code.co_filename)

    before = sys.getprofile()
    sys.setprofile(note)
    try:
        robot.core.handle(event)
    finally:
        sys.setprofile(before)
    return files


def reentries(files: List[str]) -> int:
    """Count how often a file is entered again from another one."""
    seen, count, last = set(), 0, ""
    for file in files:
        count += file != last and file in seen
        seen.add(file)
        last = file
    return count


@pytest.mark.parametrize("standby", Standby)
def test_a_failure_is_handled_in_few_files_that_are_seldom_entered_again(standby: Standby) -> None:
    som = Som([service("a", A, needed=True, standby=standby), service("b", B), service("c", C)])
    robot = Robot(som)
    for node in robot.core._processes.nodes:
        robot.handle(events.ProcessPulse(3.0, node, True))
    robot.idle(3.0)
    failure = events.FailureSeen(10.0, "", "/a", A, Kind.NODE_GONE, "it died.", 9.98)
    files = walked(robot, failure)
    assert robot.core.incident("a") is not None and len(files) > 100
    assert len(set(files)) <= MOST_FILES and reentries(files) <= MOST_REENTRIES


def test_the_count_sees_a_file_that_is_entered_again() -> None:
    assert reentries(["a", "a", "b", "a", "b", "b", "c"]) == 2
