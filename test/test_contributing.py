"""The page on contributing names the files in which its examples stand, and no others."""
import re
from pathlib import Path
from typing import List, Set, Tuple

import pytest

ROOT = Path(__file__).resolve().parent.parent
PAGE = ROOT / "CONTRIBUTING.md"
PLACES = (
    "src/shsa_core/src/**/*.py",
    "src/shsa_gate/src/**/*.py",
    "src/shsa_learning/src/**/*.py",
    "src/shsa_msgs/*/*.msg",
    "docs/reference/*.md",
    "docs/howto/see_what_happens.md",
)


def rows() -> List[Tuple[str, Set[str], Set[str]]]:
    """Return each example, where it stands, and its tests."""
    found = []
    for line in PAGE.read_text().splitlines():
        cells = [re.findall(r"`([^`]+)`", cell) for cell in line.split("|")[1:-1]]
        if len(cells) == 4 and cells[1]:
            found.append((cells[1][0], set(cells[2]), set(cells[3])))
    return found


def mentions(word: str, path: Path) -> bool:
    """Return whether a file has the word, as code or as `code` in a page."""
    text = path.read_text()
    if path.suffix == ".md":
        return re.search(rf"`{word}\b", text) is not None or f"shsa {word}" in text
    return re.search(rf"\b{word}\b", text, re.IGNORECASE) is not None


def test_there_is_a_row_for_each_thing_that_can_be_added() -> None:
    assert [word for word, _, _ in rows()] == [
        *("future_stamp", "fault_tolerant_time", "lowpass", "Standby.HOT"),
        *("restart_and_substitute", "replay"),
    ]


@pytest.mark.parametrize("word, where, tests", rows(), ids=[row[0] for row in rows()])
def test_the_example_stands_there_and_nowhere_else(
    word: str, where: Set[str], tests: Set[str]
) -> None:
    assert all(mentions(word, ROOT / name) for name in where | tests)
    if word == "replay":  # a word that says more than the command
        return
    stands = {
        str(path.relative_to(ROOT))
        for place in PLACES
        for path in ROOT.glob(place)
        if mentions(word, path)
    }
    assert stands == where
