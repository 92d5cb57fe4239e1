"""Who follows the README's example word by word heals a robot."""
import os
import signal
import socket
import subprocess
import uuid
from pathlib import Path
from typing import Dict, Iterator, List

import pytest
from test_examples import ROOT, blocks

from shsa_testing.processes import marked
from shsa_testing.waiting import wait_until

MARK = "SHSA_README"
PATIENCE_S = 60.0  # a busy machine; usually all of it takes 15 s
FILES = {"properties:": "robot.yaml", "services:": "robot_som.yaml"}
"""What the blocks begin with that are files."""


class Reader:
    """Types what stands in the README, in a folder, on a master of its own."""

    def __init__(self, folder: Path, environment: Dict[str, str]) -> None:
        self._folder = folder
        self._environment = environment
        self._opened = 0

    def opens_terminal(self, commands: str) -> "Terminal":
        """Type commands, and do not wait for them."""
        self._opened += 1
        return Terminal(self._folder / f"terminal_{self._opened}", commands, self._environment)

    def types(self, *commands: str) -> str:
        """Type commands, each of which must succeed; what they print."""
        terminal = self.opens_terminal("\n".join(commands))
        status = terminal.process.wait(PATIENCE_S)
        assert status == 0, f"{commands}: {terminal.shown()}"
        return terminal.shown()


class Terminal:
    """A shell that ends at the first command that fails."""

    def __init__(self, output: Path, commands: str, environment: Dict[str, str]) -> None:
        self._output = output
        with open(output, "w") as file:
            self.process = subprocess.Popen(
                ["bash", "-ec", commands],
                cwd=str(output.parent),
                env=environment,
                stdin=subprocess.DEVNULL,
                stdout=file,
                stderr=subprocess.STDOUT,
                start_new_session=True,
            )

    def shown(self) -> str:
        return self._output.read_text()

    def shows(self, text: str) -> None:
        """Wait until it shows a text."""
        wait_until(
            lambda: text in self.shown() or self.process.poll() is not None, PATIENCE_S, text
        )
        assert text in self.shown(), self.shown()


@pytest.fixture
def reader(tmp_path: Path) -> Iterator[Reader]:
    mark = uuid.uuid4().hex
    with socket.socket() as probe:
        probe.bind(("", 0))
        master = f"http://localhost:{probe.getsockname()[1]}"
    settings = {MARK: mark, "ROS_MASTER_URI": master, "ROS_LOG_DIR": str(tmp_path / "log")}
    settings["PYTHONUNBUFFERED"] = "1"  # a terminal shows each line at once, and a file does not
    yield Reader(tmp_path, {**os.environ, **settings})
    for number in (signal.SIGINT, signal.SIGKILL):
        for process in marked(MARK, mark):
            process.send_signal(number)
        try:
            wait_until(lambda: not marked(MARK, mark), 15.0, "everything has ended")
            return
        except AssertionError:
            continue


def example(folder: Path) -> List[str]:
    """Write the example's files into a folder; its blocks of commands."""
    text = (ROOT / "README.md").read_text()
    section = text[text.index("## Heal another robot") : text.index("## Commands")]
    commands: List[str] = []
    for block in blocks(section):
        name = FILES.get(block.split("\n")[0])
        if name is None:
            commands.append(block)
        else:
            (folder / name).write_text(block + "\n")
    return [block for block in commands if block]


def test_the_readme_heals_a_robot(tmp_path: Path, reader: Reader) -> None:
    check, sensors, healing = example(tmp_path)
    first = reader.opens_terminal(check)
    first.shows("Reconfigurator ready")
    assert "inputs  /power/data,/voltage/data" in first.shown()
    reader.types(sensors)
    state = "rostopic echo -n 1 /shsa/som_state"
    available = lambda: reader.types(state).count("available: True") == 3
    wait_until(available, PATIENCE_S, "three sensors")
    kill, look, again = healing.split("\n")
    assert reader.types(kill, look).count("data: 2.0") == 3
    assert "publishes it now" in first.shown()
    reader.types(again)
    first.shows("/current: /current_sensor is back. The substitute has stopped.")
