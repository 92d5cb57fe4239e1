"""The examples are valid."""
import json
import subprocess
import sys
from pathlib import Path
from typing import Any, Iterator
from xml.etree import ElementTree

import pytest
from listings import ROOT

from shsa_core import message_types
from shsa_core.files.som_file import read_som
from shsa_learning.check import check_files

EXAMPLES = sorted(path.parent for path in ROOT.glob("examples/*/README.md"))


@pytest.mark.parametrize("example", EXAMPLES, ids=lambda path: path.name)
def test_an_example_is_valid(example: Path) -> None:
    models = str(example / "robot.yaml"), str(example / "robot_som.yaml")
    assert check_files(*models, message_types) == []
    for launch in example.glob("*.launch"):
        given = [each.get("value", "") for each in ElementTree.parse(str(launch)).iter("arg")]
        given += [each.get("file", "") for each in ElementTree.parse(str(launch)).iter("include")]
        files = [name for name in given if name.startswith("$(dirname)")]
        assert files
        assert all(Path(name.replace("$(dirname)", str(example))).is_file() for name in files)


def test_the_current_of_the_example_is_replaced() -> None:
    example = ROOT / "examples" / "battery"
    shsa = ROOT / "src" / "shsa_core" / "scripts" / "shsa"
    command = [sys.executable, str(shsa), "find", "current"]
    command += ["--ontology", str(example / "robot.yaml"), "--som", str(example / "robot_som.yaml")]
    done = subprocess.run(command, stdout=subprocess.PIPE, universal_newlines=True)
    assert done.returncode == 0
    assert "inputs  /power/data,/voltage/data\noutput  /current/data" in done.stdout


ROVER = ROOT / "src" / "shsa_rover" / "ontology" / "rover_som.yaml"
SHOWN = {"/diagnostics": "diagnostic_msgs/DiagnosticArray", "/rosout": "rosgraph_msgs/Log"}
OF_HEALING = {"/shsa/incidents": "shsa_msgs/Incident", **SHOWN}
NUMBERS = ("float32", "float64", "int32", "uint32")


def type_of(path: str) -> str:
    """Return the type of a field of a topic of the rover. Raises KeyError if there is none."""
    types = {**{each.topic: each.type for each in read_som(str(ROVER))}, **OF_HEALING}
    topic = max((each for each in types if path.startswith(each)), key=len, default="")
    kind = types[topic]
    for name in filter(None, path[len(topic) :].replace("/", ".").split(".")):
        message = message_types.message_class(kind)
        kind = dict(zip(message.__slots__, message._slot_types))[name]
    return kind


def panels(layout: Any) -> Iterator[str]:
    """Yield the panels that a part of a layout of Foxglove names."""
    if isinstance(layout, str):
        yield layout
    else:
        yield from (*panels(layout["first"]), *panels(layout["second"]))


def test_the_layout_of_plotjuggler_names_numbers_of_the_rover() -> None:
    layout = ElementTree.parse(str(ROOT / "examples" / "rover_plotjuggler.xml"))
    curves = [str(each.get("name")) for each in layout.iter("curve")]
    assert curves and {type_of(name) for name in curves} <= {*NUMBERS}


def test_the_layout_of_foxglove_names_fields_of_the_rover() -> None:
    layout = json.loads((ROOT / "examples" / "rover_foxglove.json").read_text("utf-8"))
    configured = layout["configById"]
    assert {*panels(layout["layout"])} == {*configured}
    for name, panel in configured.items():
        kinds = {type_of(path["value"]) for path in panel.get("paths", ())}
        assert kinds <= {*(("string",) if name.startswith("StateTransitions") else NUMBERS)}
        if "topicToRender" in panel:
            assert type_of(panel["topicToRender"]) == SHOWN[panel["topicToRender"]]
