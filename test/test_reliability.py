"""The scoreboard: its arithmetic, its record, and a few trials of each line on real processes."""
import json
import sys
from pathlib import Path
from typing import Any, Iterator, Sequence

import pytest
from tools_run import run_tool

ROOT = Path(__file__).resolve().parent.parent
sys.path.insert(0, str(ROOT / "src" / "shsa_injection" / "bench"))

from reliability.scoreboard import Line, Mark, Record, Trial, fails_at_most, judge  # noqa: E402

from shsa_testing.thorough import LONG  # noqa: E402

TIMEOUT_S = 200.0
SHORT = (5, 6, 7, 11, 12, 9, 2, 1, 4, 3, 15)
"""The lines that are tried here, the longest first."""
BY_OTHERS = 1, 2, 4, 5, 6, 7, 9, 11, 12
"""Those that rostests and test_master try as well, in this order `takeover` twice, `deadline`,
`policies`, `healing_goes_on`, `healers_die`, the hung subscribers, `sim_time` with
`monitor_parameters`, and `signed` with `trust`: here only in `make test-long`.
"""


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


def test_the_others_are_tried_by_tests_of_their_own(monkeypatch: Any) -> None:
    """By test_master, test_partition and test_fuzz."""
    monkeypatch.syspath_prepend(str(ROOT / "src" / "shsa_core" / "bench"))
    from reliability.__main__ import LINES

    assert set(LINES) == set(range(1, 16))
    assert {number for number, line in LINES.items() if line.short} == {*SHORT}


@pytest.mark.parametrize("line", [each for each in SHORT if LONG or each not in BY_OTHERS])
def test_short_form(line: int, tmp_path: Path) -> None:
    words = [str(ROOT / "tools" / "reliability"), str(line), "--short", "--seed", "0"]
    done = run_tool(*words, "--results", str(tmp_path), timeout=TIMEOUT_S)
    (verdict,) = json.loads((tmp_path / "scoreboard.json").read_text())
    assert verdict["line"] == line
    assert verdict["holds"] and done.returncode == 0, done.stdout
