"""The registry of checks is complete: in words, in messages and in the documentation."""
import re
from pathlib import Path
from typing import Dict

import pytest

from shsa_core.model.checks import REGISTRY, Checks, default_checks
from shsa_core.model.kinds import Kind

ROOT = Path(__file__).resolve().parents[4]
MESSAGE = ROOT / "src" / "shsa_msgs" / "msg" / "Failure.msg"


def constants() -> Dict[str, str]:
    return dict(re.findall(r"^string ([A-Z_]+)=(\w+)$", MESSAGE.read_text(), re.MULTILINE))


def test_the_kinds_are_the_constants_of_the_message() -> None:
    assert {name: value for name, value in constants().items()} == {
        kind.name: kind.value for kind in Kind
    }


@pytest.mark.parametrize("name", sorted(REGISTRY))
def test_each_check_has_its_name_and_says_what_it_tells(name: str) -> None:
    assert REGISTRY[name].kind.value == name and REGISTRY[name].tells


def test_what_holds_where_the_som_says_nothing() -> None:
    both = {check.kind.value for check in default_checks(True) + default_checks(False)}
    assert both == {name for name, check in REGISTRY.items() if check.default is not None}
    assert Checks().each == default_checks(of_values=False)
