"""The view is started by the launch files of others, which do without it where it is missing."""
import os
import shlex
import subprocess
from pathlib import Path
from typing import Dict, List

import pytest

from shsa_testing.launches import loaded

SOURCES = Path(__file__).resolve().parents[3]
LAUNCH = SOURCES / "shsa_core" / "launch" / "shsa.launch"
ALONE = SOURCES / "shsa_view" / "launch" / "view.launch"


def load(file: Path, *words: str) -> Dict[str, List[str]]:
    """Return the nodes that a launch file would start, and their words."""
    config = loaded(file, "ontology:=/o", "som:=/s", *words)
    return {node.name: shlex.split(node.args) for node in config.nodes}


def test_the_view_starts_with_healing_if_it_is_asked_for() -> None:
    assert "view" not in load(LAUNCH)
    given = load(LAUNCH, "view:=true", "view_port:=9000", "incident_log:=/l", "secret:=/x")["view"]
    for name, value in (
        *(("--ontology", "/o"), ("--som", "/s"), ("--incident-log", "/l")),
        *(("--secret", "/x"), ("--port", "9000"), ("--address", "127.0.0.1")),
    ):
        assert given[given.index(name) + 1] == value
    assert "--actions" not in given


def test_acting_has_to_be_allowed() -> None:
    assert "--actions" in load(LAUNCH, "view:=true", "actions:=true")["view"]


def test_it_starts_alone() -> None:
    assert list(load(ALONE)) == ["view"]


@pytest.mark.parametrize("wanted", [False, True])
def test_healing_needs_no_view(tmp_path: Path, wanted: bool) -> None:
    (tmp_path / "shsa_msgs").symlink_to(SOURCES / "shsa_msgs")
    core = tmp_path / "shsa_core"
    core.mkdir()
    nodes = SOURCES / "shsa_core" / "nodes"
    for each in (*nodes.parent.iterdir(), nodes / "launch_arguments"):  # as an installed package
        (core / each.name).symlink_to(each)
    kept = [
        each for each in os.environ["CMAKE_PREFIX_PATH"].split(":") if each == "/opt/ros/noetic"
    ]
    nowhere = {"ROS_PACKAGE_PATH": str(tmp_path), "CMAKE_PREFIX_PATH": ":".join(kept)}
    words = ["ontology:=/o", "som:=/s", f"view:={str(wanted).lower()}"]
    done = subprocess.run(
        ["roslaunch", "--nodes", str(LAUNCH), *words],
        env={**os.environ, **nowhere},
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        universal_newlines=True,
    )
    if wanted:
        assert done.returncode and "shsa_view" in done.stdout
    else:
        assert done.stdout.split() == ["/reconfigurator", "/monitor"]
