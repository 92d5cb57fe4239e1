"""Each benchmark of healing runs, in its short form."""
import csv
import sys
from pathlib import Path

import pytest
from tools_run import run_tool

from shsa_testing.thorough import LONG

ROOT = Path(__file__).resolve().parent.parent
TIMEOUT_S = 120.0
TRANSFER = ("start", "up", "shut", "down", "registered", "unregistered", "gone")
ROWS = {
    "healthy_traffic": {"fixed", "learned"},
    "healthy_robots": {"base", "arm", "drone"},
    "healthy_nodes": {"base", "arm", "drone"},
    "failover": {"hot", "respawn, rospy, slow", "rosrun by hand, rospy"},
    "gated": {"rospy", "roscpp"},
    "interference": {"hot"},
    "transfer_nodes": {*TRANSFER, "warm", "hot"},
    "large_messages": {"nothing comes", "copied", "dropped"},
    "kilohertz": {"1000"},
    "large_robots": {"10"},
    "endurance": {"/monitor", "/reconfigurator", "prepared", *(f"lost_{n}" for n in range(2, 8))},
    "load": {"nine nodes"},
    "large_recordings": {"50000", "400000"},
    "real_recordings": {"radiation by three instruments, a day"},
    "truth": {"as_fitted", "payload", "slopes", "carpet", "smooth"},
}
HEALTHY = ("healthy_traffic", "healthy_robots", "healthy_nodes")
UNDRAWN = (
    *HEALTHY,
    "large_messages",
    "kilohertz",
    "large_robots",
    "load",
    "endurance",
    "large_recordings",
    "real_recordings",
)
COMPUTED = ("truth",)
"""They start no robot: test_bench_tool.py has them."""
SELDOM = ("gated", "interference", "transfer_nodes", *COMPUTED, *UNDRAWN)
"""They only measure what others test: in `make test-long`."""


@pytest.mark.parametrize(
    "name", [name for name in ROWS if name not in (COMPUTED if LONG else SELDOM)]
)
def test_short_form(name: str, tmp_path: Path) -> None:
    check(name, tmp_path)


def check(name: str, results: Path) -> None:
    """Have a benchmark run, and see its table and its picture."""
    bench = str(ROOT / "tools" / "bench")
    words = [sys.executable, bench, name, "--short", "--results", str(results)]
    done = run_tool(*words, timeout=TIMEOUT_S)
    assert done.returncode == 0, done.stdout
    with open(str(results / f"{name}.csv"), newline="") as file:
        rows = list(csv.reader(file))
    assert {row[0] for row in rows[1:]} == ROWS[name]
    assert all(len(row) == len(rows[0]) for row in rows)
    assert name in UNDRAWN or (results / f"{name}.png").stat().st_size > 10000
