"""The examples are valid."""
import subprocess
import sys
from pathlib import Path
from xml.etree import ElementTree

import pytest
from listings import ROOT

from shsa_core import message_types
from shsa_core.analysis.check import check_files

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
