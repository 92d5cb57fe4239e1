"""The scoreboard: its arithmetic, its record, and a few trials of each line on real processes."""
import json
import os
import subprocess
import sys
import warnings
from pathlib import Path
from typing import Any, Iterator, List, Sequence, Tuple

import pytest

ROOT = Path(__file__).resolve().parent.parent
sys.path.insert(0, str(ROOT / "src" / "shsa_injection" / "bench"))

from reliability.scoreboard import Line, Mark, Record, Trial, fails_at_most, judge  # noqa: E402

from attempts import ATTEMPTS, LONGEST, machine  # noqa: E402
from shsa_testing.processes import marked  # noqa: E402

TIMEOUT_S = 600.0


def none(graph: Any, seeds: Sequence[int]) -> Iterator[Trial]:
    return iter(())


LINE = Line(1, "off", "healed", none, full=3, short=1, marks=(Mark("outage", 30.0, "ms"),))


@pytest.mark.parametrize(
    "trials,failed,bound",
    # From the table of the exact one-sided bound: 1 - 0.05 ** (1 / n) where none failed.
    [(1, 0, 0.95), (59, 0, 0.0495), (10, 1, 0.3942), (10, 10, 1.0)],
)
def test_the_bound_of_the_share_that_fails(trials: int, failed: int, bound: float) -> None:
    assert fails_at_most(trials, failed) == pytest.approx(bound, abs=2e-4)


def test_a_line_holds_if_every_trial_does_and_its_figures_keep_to_their_marks() -> None:
    good = [Trial(1, seed, True, {"outage": 20.0}) for seed in range(3)]
    assert judge(LINE, good).good
    assert not judge(LINE, [*good, Trial(1, 3, False)]).good
    late = judge(LINE, [*good, Trial(1, 3, True, {"outage": 200.0})])
    assert not late.good and "mark 30" in late.missed[0]
    assert not judge(LINE, [Trial(2, 0, True)]).good, "nothing was tried"


def test_a_run_goes_on_where_the_last_one_ended(tmp_path: Path) -> None:
    path = tmp_path / "trials.jsonl"
    Record(path).add(Trial(1, 0, True, {"outage": 20.0}))
    Record(path).add(Trial(1, 2, False, why="nobody came"))
    record = Record(path)
    assert record.missing(1, range(4)) == [1, 3] and record.missing(2, range(2)) == [0, 1]
    assert record.trials[1].why == "nobody came"


def run(results: Path, *arguments: str) -> Tuple[List[Any], str]:
    """The verdicts of the short form, and what it printed."""
    mark = f"test_reliability_{os.getpid()}"
    done = subprocess.run(
        [str(ROOT / "tools" / "reliability"), "--short", "--results", str(results), *arguments],
        env=dict(os.environ, SHSA_TEST=mark),
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        universal_newlines=True,
        timeout=TIMEOUT_S,
    )
    verdicts = json.loads((results / "scoreboard.json").read_text())
    assert not marked("SHSA_TEST", mark)
    assert (done.returncode == 0) is all(each["holds"] for each in verdicts)
    return verdicts, done.stdout


def test_short_form(tmp_path: Path) -> None:
    """A line that does not hold is tried again: this may be a busy machine."""
    with machine(alone=False):
        verdicts, said = run(tmp_path / "1")
    missing = {8, 10, 13, 14}  # test_master, test_partition and test_fuzz try the same
    assert {each["line"] for each in verdicts} == set(range(1, 16)) - missing
    for number in range(2, ATTEMPTS + 1):
        again = [str(each["line"]) for each in verdicts if not each["holds"]]
        if not again:
            return
        warnings.warn(f"lines {again} did not hold: {said[-LONGEST:]}")
        with machine(alone=True):
            verdicts, said = run(tmp_path / str(number), *again, "--seed", str(1000 * number))
    assert all(each["holds"] for each in verdicts), said[-LONGEST:]
