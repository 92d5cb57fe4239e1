"""One look at a robot: when all that runs has told of itself."""
from typing import Any, Dict

import pytest

from shsa_view.ros.watching import _is_whole


def document(**row: Any) -> Dict[str, Any]:
    told = {"state": "substituted", "rate": 50.0, "publisher": "/substitute_1", **row}
    healing = {"monitor": "alive", "reconfigurator": "alive"}
    return {"healing": healing, "services": {"amperemeter": told}}


def test_a_look_is_over_once_each_service_was_heard_of() -> None:
    assert _is_whole(document())
    assert _is_whole(document(publisher=None, rate=None, state="failed"))


@pytest.mark.parametrize("row", [{"state": "unknown", "publisher": None}, {"rate": None}])
def test_what_was_not_heard_yet_is_waited_for(row: Dict[str, Any]) -> None:
    assert not _is_whole(document(**row))
