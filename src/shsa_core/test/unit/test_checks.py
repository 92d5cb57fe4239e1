"""The registry of checks is complete: in words, in messages and in the documentation."""
import re
from pathlib import Path
from typing import Dict, List, Set

import pytest

from shsa_core.model.checks import LEARNED, OF_VALUE, REGISTRY, Checks, default_checks
from shsa_core.model.kinds import Kind

ROOT = Path(__file__).resolve().parents[4]
MESSAGE = ROOT / "src" / "shsa_msgs" / "msg" / "Failure.msg"
PAGE = ROOT / "docs" / "som.md"


def constants() -> Dict[str, str]:
    return dict(re.findall(r"^string ([A-Z_]+)=(\w+)$", MESSAGE.read_text(), re.MULTILINE))


def rows() -> Dict[str, List[str]]:
    """The rows of the table of checks in the documentation, by their first cell."""
    found: Dict[str, List[str]] = {}
    for line in PAGE.read_text().splitlines():
        cells = [cell.strip() for cell in line.strip("|").split("|")]
        if len(cells) == 4 and line.startswith("| `"):
            found[cells[0].strip("`")] = cells[1:]
    return found


def test_the_kinds_are_the_constants_of_the_message() -> None:
    assert {name: value for name, value in constants().items()} == {
        kind.name: kind.value for kind in Kind
    }


@pytest.mark.parametrize("name", sorted(REGISTRY))
def test_each_check_is_documented_with_what_it_tells_and_its_default(name: str) -> None:
    check = REGISTRY[name]
    assert check.kind.value == name
    place, tells, default = rows()[name]
    assert tells == check.tells
    assert place == ("property" if check in _of_values() else "service")
    words: Dict[object, str] = {None: "off", True: "on", LEARNED: "learned"}
    expected = words.get(check.default, f"{check.default:g}" if check.default else "")
    if check.default is None and check.usual is not None:
        expected += f"; `true`: {words.get(check.usual, check.usual)}"
    assert default == expected


def test_nothing_is_documented_that_there_is_not() -> None:
    assert set(rows()) == set(REGISTRY)


def test_what_holds_where_the_som_says_nothing() -> None:
    both = {check.kind.value for check in default_checks(True) + default_checks(False)}
    assert both == {name for name, check in REGISTRY.items() if check.default is not None}
    assert Checks().each == default_checks(of_values=False)


def _of_values() -> Set[type]:
    return {check for check in REGISTRY.values() if check.sample in OF_VALUE}
