"""Benchmarks without robots, and what starts them all."""
import subprocess
import sys
from pathlib import Path

import pytest
from test_bench import COMPUTED, ROOT, TIMEOUT_S, TRANSFER, check


@pytest.mark.parametrize("name", COMPUTED)
def test_short_form(name: str, tmp_path: Path) -> None:
    check(name, tmp_path)


def measured(results: Path) -> "subprocess.CompletedProcess[str]":
    """Run a measurement beside what was measured before."""
    script = ROOT / "src" / "shsa_core" / "bench" / "transfer_nodes.py"
    return subprocess.run(
        [sys.executable, str(script), "--short", "--results", str(results)],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        universal_newlines=True,
        timeout=TIMEOUT_S,
    )


def test_a_measurement_goes_on_where_it_was(tmp_path: Path) -> None:
    measures = (*TRANSFER, "warm", "hot")
    lines = [
        "measure,nodes,repetition,time_ms",
        *(f"{m},{n},1,10" for m in measures for n in (0, 5)),
    ]
    path = tmp_path / "transfer_nodes.csv"
    path.write_text("\n".join(lines) + "\n")
    done = measured(tmp_path)
    assert done.returncode == 0
    assert "6 repetitions are there already" in done.stdout
    assert path.read_text().splitlines() == lines


def test_a_measurement_by_other_definitions_is_not_gone_on_with(tmp_path: Path) -> None:
    path = tmp_path / "transfer_nodes.csv"
    path.write_text("measure,nodes,repetition,ms\nstart,0,1,600\n")
    done = measured(tmp_path)
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
