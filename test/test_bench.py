"""Each benchmark of healing runs, in its short form."""
import csv
import subprocess
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
SELDOM = ("gated", "interference", "transfer_nodes", *UNDRAWN)
"""They only measure what others test: in `make test-long`."""


@pytest.mark.parametrize("name", [name for name in ROWS if LONG or name not in SELDOM])
def test_short_form(name: str, tmp_path: Path) -> None:
    results = tmp_path
    bench = str(ROOT / "tools" / "bench")
    words = [sys.executable, bench, name, "--short", "--results", str(results)]
    done = run_tool(*words, timeout=TIMEOUT_S)
    assert done.returncode == 0, done.stdout
    with open(str(results / f"{name}.csv"), newline="") as file:
        rows = list(csv.reader(file))
    assert {row[0] for row in rows[1:]} == ROWS[name]
    assert all(len(row) == len(rows[0]) for row in rows)
    assert name in UNDRAWN or (results / f"{name}.png").stat().st_size > 10000


def test_a_measurement_goes_on_where_it_was(tmp_path: Path) -> None:
    script = ROOT / "src" / "shsa_core" / "bench" / "transfer_nodes.py"
    measures = (*TRANSFER, "warm", "hot")
    lines = [
        "measure,nodes,repetition,time_ms",
        *(f"{m},{n},1,10" for m in measures for n in (0, 5)),
    ]
    path = tmp_path / "transfer_nodes.csv"
    path.write_text("\n".join(lines) + "\n")
    done = subprocess.run(
        [sys.executable, str(script), "--short", "--results", str(tmp_path)],
        stdout=subprocess.PIPE,
        universal_newlines=True,
        timeout=TIMEOUT_S,
    )
    assert done.returncode == 0
    assert "6 repetitions are there already" in done.stdout
    assert path.read_text().splitlines() == lines


def test_a_measurement_by_other_definitions_is_not_gone_on_with(tmp_path: Path) -> None:
    script = ROOT / "src" / "shsa_core" / "bench" / "transfer_nodes.py"
    path = tmp_path / "transfer_nodes.csv"
    path.write_text("measure,nodes,repetition,ms\nstart,0,1,600\n")
    done = subprocess.run(
        [sys.executable, str(script), "--short", "--results", str(tmp_path)],
        stderr=subprocess.PIPE,
        universal_newlines=True,
        timeout=TIMEOUT_S,
    )
    assert done.returncode == 1
    assert f"{path} holds other measures; --fresh begins anew." in done.stderr
    assert path.read_text().endswith("start,0,1,600\n")


NEW = '''"""What nobody has measured yet."""
from argparse import ArgumentParser
if __name__ == "__main__":
    parser = ArgumentParser()
    parser.add_argument("--results")
    parser.add_argument("--short", action="store_true")
    print("short:", parser.parse_known_args()[0].short)
'''


def test_a_missing_or_failing_benchmark_is_said_and_a_new_one_found(tmp_path: Path) -> None:
    tool = ROOT / "tools" / "bench"
    done = subprocess.run(
        [sys.executable, str(tool), "nonsense"], stderr=subprocess.PIPE, universal_newlines=True
    )
    assert done.returncode == 2 and "nonsense" in done.stderr
    folder = tmp_path / "src" / "shsa_core" / "bench"
    folder.mkdir(parents=True)
    (folder / "evaluate.py").write_text(NEW + "    raise SystemExit(3)\n")
    (folder / "unheard_of.py").write_text(NEW)
    (folder / "helper.py").write_text(NEW.replace("--results", "--more"))
    copy = tmp_path / "tools" / "bench"
    copy.parent.mkdir()
    copy.write_text(tool.read_text())
    done = subprocess.run(
        [sys.executable, str(copy), "evaluate", "failover", "unheard_of", "--short"],
        stdout=subprocess.PIPE,
        universal_newlines=True,
    )
    assert done.returncode == 1
    assert "failed with exit status 3 after 0 s" in done.stdout and "missing" in done.stdout
    assert "short: True" in done.stdout and "unheard_of: done after 0 s" in done.stdout
    told = subprocess.check_output([sys.executable, str(copy), "--list"], universal_newlines=True)
    assert "What nobody has measured yet." in told and "helper" not in told
