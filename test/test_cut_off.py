"""The link to a computer with an agent and a monitor of its own is cut: each side heals itself."""
import json
import subprocess
import sys
from pathlib import Path

import pytest

from shsa_testing.computers import refusal

SCRIPT = Path(__file__).resolve().parent.parent / "src" / "shsa_core" / "bench" / "cut_off.py"
TIMEOUT_S = 150.0
LATE_S = 0.25


def test_each_side_of_a_cut_has_one_publisher_and_so_has_the_reunion() -> None:
    if refusal():
        pytest.skip(refusal())
    done = subprocess.run(
        [sys.executable, str(SCRIPT), "--seconds", "4"],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        universal_newlines=True,
        timeout=TIMEOUT_S,
    )
    assert done.returncode == 0, done.stderr
    found = json.loads(done.stdout.splitlines()[-1])
    # What only the lost monitor watched is healed here, and the side without a master by itself.
    assert found["first"]["gap"] < 3.0 and found["near"]["gap"] < 3.0, found
    assert found["first"]["overlap"] < LATE_S and found["near"]["overlap"] < LATE_S, found
    assert all(len(nodes) == 1 for nodes in found["after"].values()), found
    assert found["near_here"]["gap"] < LATE_S and found["spared"], found
