"""The commands where no master is: one line, status 2, and nobody waits for good."""
import socket
import time
from pathlib import Path
from typing import Any, List

import pytest

from shsa_core.cli.main import main
from shsa_core.ros import settings

SOM = """\
services:
  odometry:
    {topic: /odom, type: std_msgs/Float64, node: /base, period: 0.1, provides: {v: {field: data}}}
"""
INJECT, CHAOS = ["inject", "/odom", "off"], ["chaos", "--steps", "1"]


@pytest.fixture
def som(tmp_path: Path) -> str:
    path = tmp_path / "som.yaml"
    path.write_text(SOM)
    return str(path)


@pytest.mark.parametrize("uri", ["localhost:11311", "", "http://", "http://localhost:junk"])
@pytest.mark.parametrize("words", [INJECT, CHAOS, ["inject", "--master"]])
@pytest.mark.parametrize("given", [True, False])
def test_an_address_that_is_none(
    monkeypatch: pytest.MonkeyPatch, capsys: Any, som: str, words: List[str], uri: str, given: bool
) -> None:
    monkeypatch.setenv("ROS_MASTER_URI", uri)
    assert main([*words, *(["--som", som] if given else [])]) == 2
    told = capsys.readouterr().err
    assert told.startswith("shsa: ROS_MASTER_URI is ") and told.count("\n") == 1


def test_a_master_on_a_computer_that_nobody_knows(
    monkeypatch: pytest.MonkeyPatch, capsys: Any
) -> None:
    def nowhere(*_: object, **__: object) -> None:
        raise socket.gaierror(socket.EAI_NONAME, "Name or service not known")

    monkeypatch.setattr(socket, "getaddrinfo", nowhere)
    monkeypatch.setenv("ROS_MASTER_URI", "http://nobody:11311")
    assert main(["inject", "--master"]) == 1
    told = capsys.readouterr().err
    assert told.startswith("shsa: refused: http://nobody:11311 cannot be found: ")
    assert "service not known" in told and told.count("\n") == 1


def test_a_master_that_never_answers(
    monkeypatch: pytest.MonkeyPatch, capsys: Any, som: str
) -> None:
    with socket.create_server(("127.0.0.1", 0)) as silent:
        uri = f"http://127.0.0.1:{silent.getsockname()[1]}"
        monkeypatch.setenv("ROS_MASTER_URI", uri)
        begin = time.monotonic()
        assert main([*CHAOS, "--som", som]) == 2
    assert time.monotonic() - begin < 2.0 * settings.PATIENCE_S
    assert capsys.readouterr().err == f"shsa: no ROS master answers at {uri}: timed out\n"
