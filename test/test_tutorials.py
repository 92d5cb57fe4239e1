"""The tutorials, followed word by word, show what they say.

learning.md has a test of its own, in shsa_rover: its drives take 24 minutes.
"""
import math
import re
from pathlib import Path

import pytest
from following import Follower, Tutorial, prepared
from listings import ROOT, Page, new_reader

from shsa_testing.computers import refusal
from shsa_testing.thorough import LONG

TUTORIALS = ROOT / "docs" / "tutorials"
ROVER = Tutorial(TUTORIALS / "heal_the_rover.md")
OWN_ROBOT = Tutorial(TUTORIALS / "any_robot.md")
INCIDENT = Tutorial(ROOT / "docs" / "howto" / "see_what_happens.md")
THREE = Tutorial(TUTORIALS / "three_computers.md")
LONGEST_S = 15 * 60.0
"""The longest time to heal a robot of one's own, reading included."""
WORDS_A_MINUTE = 200


def test_the_rover_is_healed(tmp_path: Path) -> None:
    follow(tmp_path, ROVER)


def test_a_robot_of_ones_own_is_healed_and_its_incident_read(tmp_path: Path) -> None:
    follow(tmp_path, OWN_ROBOT, INCIDENT)


@pytest.mark.skipif(not LONG, reason="make test-long; test_partition has two computers")
def test_the_rover_is_healed_on_three_computers(tmp_path: Path) -> None:
    if refusal(ssh=True):
        pytest.skip(refusal(ssh=True))
    follow(tmp_path, THREE)


def follow(folder: Path, *tutorials: Tutorial) -> None:
    """Follow them one after the other, on the same robot. Each looks for `.finished()` itself."""
    with new_reader(prepared(folder / "reader")) as reader:
        follower = Follower(reader)
        for tutorial in tutorials:
            seconds = follower.follow(tutorial)
            print(f"{tutorial.path.name}: {seconds:.0f} s")
            if tutorial is OWN_ROBOT:
                assert seconds + 60.0 * reading(tutorial) < LONGEST_S


def reading(tutorial: Tutorial) -> int:
    """Return the time to read it, in min."""
    return math.ceil(tutorial.words / WORDS_A_MINUTE)


def test_the_tutorial_states_what_it_takes() -> None:
    stated = re.search(
        r"(\d+) commands, (\d+) lines to write, (\d+) s of machine time, (\d+) minutes to read",
        OWN_ROBOT.text,
    )
    assert stated is not None
    commands = [each for each in OWN_ROBOT.commands if not each.startswith("source ")]
    found = len(commands), OWN_ROBOT.edited, reading(OWN_ROBOT)
    assert tuple(map(int, stated.group(1, 2, 4))) == found


def test_the_readmes_commands_are_those_of_the_tutorial() -> None:
    page = Page(ROOT / "README.md")
    start, kill = page.take("source"), page.take("source")
    page.finished()
    typed = [line.split("  #")[0].strip() for line in f"{start}\n{kill}".splitlines()]
    remaining = iter(ROVER.commands)
    assert all(command in remaining for command in typed), typed
