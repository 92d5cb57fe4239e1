"""The order of the tests, in conftest.py at the top, names files and rostests that there are."""
from pathlib import Path

import conftest

ROOT = Path(__file__).resolve().parent.parent


def test_the_files_that_have_their_turn_are_there() -> None:
    files = {path.stem for folder in ("src", "test") for path in (ROOT / folder).rglob("test_*.py")}
    assert {*conftest.FIRST, *conftest.ROBOTS} <= files
    assert {*conftest.ALONE} <= {*conftest.ROBOTS}


def test_the_rostests_to_begin_with_are_there() -> None:
    assert {*conftest.LONGEST} <= {path.stem for path in ROOT.glob("src/*/test/rostest/*.test")}
