"""The page of `shsa init`, followed word by word, leads to a model that is checked."""
import math
import subprocess
import sys
from pathlib import Path
from typing import List

import pytest

from recordings import BagWriter

ROOT = Path(__file__).resolve().parents[4]
PAGE = ROOT / "docs" / "howto" / "write_a_som.md"
SHSA = ROOT / "src" / "shsa_core" / "scripts" / "shsa"
SENSORS = {"/voltage": 12.0, "/current": 2.0, "/power": 24.0}
TYPED = ("shsa init --bag", "sed ", "shsa check", "shsa find")
"""The commands that are typed here: the rest needs a running robot, as in init.test."""


def shown() -> List[str]:
    """Return the lines of the page that are commands or files, without their indent."""
    lines = PAGE.read_text("utf-8").splitlines()
    return [line[4:] for line in lines if line.startswith("    ")]


def typed() -> List[str]:
    """Return the commands of the page, in order, without those that learn."""
    return [line for line in shown() if line.startswith(TYPED) and "--learn" not in line]


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    """A folder with a recording of the page's robot."""
    with BagWriter(tmp_path / "drive.bag") as bag:
        for topic, value in SENSORS.items():
            samples = [(1000.0 + k / 10, value + 0.1 * math.sin(k / 20)) for k in range(200)]
            bag.floats(topic, samples, f"{topic}_sensor" if topic != "/power" else "/power_meter")
    return tmp_path


def test_the_commands_of_the_page_lead_to_a_substitute(folder: Path) -> None:
    commands = typed()
    assert len(commands) == 6
    told = ""
    for command in commands:
        done = subprocess.run(
            ["bash", "-c", command.replace("shsa ", f"{sys.executable} {SHSA} ", 1)],
            cwd=str(folder),
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            universal_newlines=True,
        )
        assert done.returncode == 0, (command, done.stdout)
        told += done.stdout
    assert "valid: 0 errors, 0 warnings" in told
    assert "inputs  /power/data,/voltage/data" in told


def test_the_page_shows_what_a_draft_has(folder: Path) -> None:
    init = [sys.executable, str(SHSA), "init", "--bag", "drive.bag"]
    done = subprocess.run(
        init, cwd=str(folder), stdout=subprocess.PIPE, universal_newlines=True, check=True
    )
    lines = shown()
    start = lines.index("current:")
    for line in lines[start : start + 7]:
        assert line.split("#")[0].replace("}", "").strip() in done.stdout
