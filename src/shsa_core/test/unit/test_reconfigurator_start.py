"""The start of the reconfigurator's shell."""
from argparse import Namespace
from pathlib import Path
from types import SimpleNamespace
from typing import Any, List

import pytest

from shsa_core.errors import ModelError
from shsa_core.model.cost import Host
from shsa_core.model.som import Som

reconfigurator = pytest.importorskip("shsa_core.ros.reconfigurator")

SOM = Som([], [Host("board"), Host("pi")])


def test_agents_that_the_master_cannot_tell_of_us_are_told() -> None:
    """And we of them, though the master waits for subscribers that hang."""
    told: List[str] = []
    heard: List[Any] = []
    node = SimpleNamespace(
        _files=Namespace(host="board"),
        _hosts=SimpleNamespace(listen=lambda *arguments: heard.extend(arguments)),
        _master=SimpleNamespace(introduce=lambda *topics: told.extend(topics)),
    )
    reconfigurator.ReconfiguratorNode._listen(node, SOM, True)
    assert heard == [["pi"], True]
    assert told == ["shsa/hosts/pi/commands", "shsa/hosts/pi/events"]


def test_what_check_calls_invalid_is_refused_at_the_start(tmp_path: Path) -> None:
    ontology, som = tmp_path / "ontology.yaml", tmp_path / "som.yaml"
    ontology.write_text("properties: {a: {unit: A}}\n")
    service = (
        "{topic: t, type: std_msgs/Float64, node: n, period: 0.1, provides: {b: {field: data}}}"
    )
    som.write_text("services:\n  s: " + service + "\n")
    with pytest.raises(ModelError, match=r"som.yaml:2: s provides 'b', which is not in the ontol"):
        reconfigurator.read_models(str(ontology), str(som))
