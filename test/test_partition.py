"""A link between two computers goes down and comes up again."""
import json
import subprocess
import sys
from pathlib import Path

import pytest

from shsa_testing.computers import refusal
from shsa_testing.thorough import LONG

SCRIPT = Path(__file__).resolve().parent.parent / "src" / "shsa_core" / "bench" / "partition.py"
TIMEOUT_S = 150.0


@pytest.mark.parametrize("seconds", [2.0, 20.0] if LONG else [2.0])
def test_a_backlog_is_neither_good_nor_bad(seconds: float) -> None:
    if refusal():
        pytest.skip(refusal())
    done = subprocess.run(
        [sys.executable, str(SCRIPT), "--seconds", str(seconds)],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        universal_newlines=True,
        timeout=TIMEOUT_S,
    )
    assert done.returncode == 0, done.stderr
    found = json.loads(done.stdout.splitlines()[-1])
    assert found["taken_for_good"] == 0, found
    assert found["kinds"] == ["silent"] and not found["killed"], found
    assert found["state"] == "ended" and found["gap"] < 1.0, found
