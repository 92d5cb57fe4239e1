"""The code stays small enough for one head: lines, files, constants, and words to set."""
import re
from pathlib import Path
from typing import Iterator, List

import pytest

SOURCE = Path(__file__).resolve().parent.parent / "src"
CORE = SOURCE / "shsa_core" / "src" / "shsa_core"
GATE = SOURCE / "shsa_gate" / "src" / "shsa_gate"
LINES = {"": 28562, "healing": 4435, "monitoring": 2453, "ros": 8441}
"""Lines at most, docstrings included, of a folder of the core package. To be lowered, not raised:
28,000, 4,500, 3,000 and 9,000 are wanted.
"""
FILES = {"healing": 19}
GATE_LINES = 524
"""The same of the package of the gate."""
CONSTANTS = 47
"""Constants of time in the cores and shells; 50 are wanted."""
CONSTANT = re.compile(r"^_?[A-Z_]+_S\b.* = ", re.MULTILINE)
RIDDLE = re.compile(r'^\s*"""(Whether|Who|What|How|When|Where|Which) ', re.MULTILINE)


def modules(folder: Path) -> Iterator[Path]:
    return folder.rglob("*.py")


def count(folder: Path) -> int:
    return sum(len(path.read_text("utf-8").splitlines()) for path in modules(folder))


@pytest.mark.parametrize("folder", LINES)
def test_a_folder_is_not_longer_than_agreed(folder: str) -> None:
    assert count(CORE / folder) <= LINES[folder]


def test_the_gate_is_not_longer_than_agreed() -> None:
    assert count(GATE) <= GATE_LINES


@pytest.mark.parametrize("folder", FILES)
def test_a_folder_has_no_more_files_than_agreed(folder: str) -> None:
    assert len(list(modules(CORE / folder))) <= FILES[folder]


def test_the_tests_are_not_much_longer_than_what_they_test() -> None:
    tests = sum(count(folder) for folder in SOURCE.glob("*/test"))
    assert tests <= 1.2 * sum(count(folder) for folder in SOURCE.glob("*/src"))


def test_constants_of_time_are_few() -> None:
    files = [*modules(CORE), *modules(GATE)]
    found = [name for path in files for name in CONSTANT.findall(path.read_text("utf-8"))]
    assert len(found) <= CONSTANTS


def test_docstrings_say_what_a_thing_does() -> None:
    riddles: List[str] = []
    for path in SOURCE.glob("*/src/**/*.py"):
        for found in RIDDLE.finditer(path.read_text("utf-8")):
            riddles.append(f"{path.relative_to(SOURCE)}: {found.group().strip()}")
    assert riddles == []
