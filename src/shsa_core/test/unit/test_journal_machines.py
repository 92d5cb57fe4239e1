"""The real machines decide again what they decided while recorded, in any process."""
import json
import os
import subprocess
import sys
from pathlib import Path
from typing import Any, List, Optional

import pytest

sys.path.insert(0, str(Path(__file__).resolve().parents[2] / "bench"))

from simulated_robot import Robot  # noqa: E402

from shsa_core.healing import events  # noqa: E402
from shsa_core.journal.writer import JournalWriter  # noqa: E402
from shsa_core.model.kinds import Standby  # noqa: E402

PACKAGE = Path(__file__).resolve().parents[2]
SOURCES = f"{PACKAGE / 'src'}:{PACKAGE.parent / 'shsa_learning' / 'src'}"


class RecordedRobot(Robot):
    """A robot whose reconfigurator has a journal."""

    def __init__(self, path: Path, standby: Standby) -> None:
        self._path = path
        self.journal: Optional[JournalWriter] = None
        super().__init__(10, standby, topics_a_node=2)

    def handle(self, event: events.Event) -> float:
        """One event, recorded with its answer."""
        if self.journal is None:
            self.journal = JournalWriter(str(self._path), "healing", self.setup, pytest.fail)
        taken: List[float] = []
        handle = super().handle

        def answer(event: events.Event) -> List[Any]:
            before = len(self.said)
            taken.append(handle(event))
            return self.said[before:]

        self.journal.recorded(answer)(event)
        return taken[0]


def replayed(path: Path, seed: int) -> Any:
    """Run `shsa replay`, with sets in another order for each seed."""
    done = subprocess.run(
        [sys.executable, str(PACKAGE / "scripts/shsa"), "replay", str(path), "--json"],
        stdout=subprocess.PIPE,
        universal_newlines=True,
        env={**os.environ, "PYTHONPATH": SOURCES, "PYTHONHASHSEED": str(seed)},
    )
    assert done.returncode == 0, done.stdout
    return json.loads(done.stdout)


@pytest.mark.parametrize("standby", Standby)
def test_healing_replays_to_identical_commands(tmp_path: Path, standby: Standby) -> None:
    path = tmp_path / "healing.journal"
    robot = RecordedRobot(path, standby)
    nodes = ("/node_0", "/node_1", "/node_4")
    for node in nodes:
        robot.time += 100.0
        robot.fail(node)
        robot.plans()
    for node in nodes:
        robot.time += 10.0
        robot.come_back(node)
    assert robot.journal is not None
    robot.journal.close()
    for seed in (1, 2):
        document = replayed(path, seed)
        summary = document["summary"]
        assert summary["identical"] and not summary["errors"] and not summary["broken"]
        assert summary["events"] > summary["decisions"] > 20
        states = [
            command["incident"]["state"]
            for decision in document["decisions"]
            for command in decision["commands"]
            if command["class"] == "ShowIncident"
        ]
        assert states.count("ended") == 6 and "healed" in states and document["end"] == "closed"
