"""Outages, tables and picture of failover.py, from the messages that a consumer heard."""
import sys
from math import inf
from pathlib import Path
from types import SimpleNamespace
from typing import Any, Dict, List

import pytest

BENCH = Path(__file__).resolve().parent.parent / "src" / "shsa_core" / "bench"
sys.path.insert(0, str(BENCH))

import failover  # noqa: E402
import takeover as told  # noqa: E402
import failover_rows as of  # noqa: E402
from failover_plot import plot  # noqa: E402
from robot import NODE, Heard  # noqa: E402
from report import in_words, print_table, summary  # noqa: E402
from takeover import STEPS, Takeover, from_words, watched  # noqa: E402

PERIOD_S = 0.02
UNTIL = 3.0


def stream(begin: float, end: float, step: float = PERIOD_S) -> List[float]:
    return [begin + step * number for number in range(int((end - begin) / step))]


def heard(good: List[float], failed_at: float = 1.0) -> List[float]:
    return [round(each, 3) for each in watched(good, failed_at, UNTIL, PERIOD_S)]


def test_a_crash_lasts_from_the_last_good_message_to_the_first_one_after_it() -> None:
    assert heard([*stream(0.0, 1.0), *stream(1.3, UNTIL)]) == [0.32, 0.3]


def test_a_table_may_have_no_rows(capsys: Any) -> None:
    print_table("Goals", ("goal", "at most"), [])
    assert "at most" in capsys.readouterr().out


def test_at_1_khz_a_pause_that_is_the_consumers_own_is_no_news() -> None:
    good = [*(n / 1000 for n in range(1001)), *(1.005 + n / 100 for n in range(200))]
    assert watched(good, 1.0, UNTIL, 0.001).over == 0.0


def test_the_longest_of_several_pauses_counts_and_the_last_one_ends_it() -> None:
    good = [*stream(0.0, 1.0), *stream(1.06, 1.12), *stream(1.2, 1.3), *stream(1.35, UNTIL)]
    assert heard(good) == [0.1, 0.35]


def test_a_healthy_stream_has_no_outage_that_must_end() -> None:
    assert heard(stream(0.0, UNTIL)) == [PERIOD_S, 0.0]


def test_silence_that_nobody_ends_is_never_over() -> None:
    assert heard(stream(0.0, 1.0)) == [inf, inf]


def test_a_node_that_stays_slow_pauses_shortly_and_is_never_over() -> None:
    assert heard([*stream(0.0, 1.0), *stream(1.04, UNTIL, 0.06)]) == [0.06, inf]


def test_it_is_not_over_while_the_next_message_is_overdue() -> None:
    """As a node does that sends a little more before it leaves."""
    assert heard(stream(0.0, UNTIL - 0.48), 2.45)[1] == inf


class Ear:
    """A consumer that heard the node until it hung at 1.0 s, and then its substitute."""

    contacts: Dict[str, float] = {}

    def __init__(self, filled_at: float) -> None:
        last = [Heard(at, "/lost", NODE, 1.0) for at in stream(0.0, 1.0)]
        filled = [Heard(at, "/lost", "/s", 1.0) for at in stream(filled_at, UNTIL)]
        self.messages = [*last, *filled]

    def since(self, moment: float) -> List[Heard]:
        return [each for each in self.messages if each.at > moment]


def steps(filled_at: float, monkeypatch: pytest.MonkeyPatch) -> Dict[str, int]:
    """Return the steps in ms, above 0, of a hang at 1 s that is detected at 1.1 s."""
    monkeypatch.setattr(told, "moment_of", lambda stamp: stamp)
    monkeypatch.setattr(told, "uri_of", lambda node: "")
    times = {"detected": 1.1, "found": 1.101, "spawned": 1.103, "killed": 0.0}
    incident: Any = SimpleNamespace(substitute="/s", kind="silent", **times)
    both: Any = SimpleNamespace(rospy=Ear(filled_at))
    found = told.with_steps(Takeover(0.0, 0.0), both, 1.0, incident)
    figures = {step: round(getattr(found, f"{step}_ms")) for step in STEPS}
    assert told.with_substitute(found, both, 1.0, incident).late == 0
    return {step: figure for step, figure in figures.items() if figure}


def test_a_substitute_that_is_told_has_no_bridge(monkeypatch: pytest.MonkeyPatch) -> None:
    expected = {"waited": 20, "detect": 100, "decide": 1, "start": 2, "first": 2}
    assert steps(1.105, monkeypatch) == expected


def test_one_that_fills_in_before_anybody_knows_has_only_a_bridge(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    assert steps(1.03, monkeypatch) == {"waited": 20, "bridge": 30}


def test_figures_with_a_never_among_them() -> None:
    assert summary([10.0, 20.0, inf]) == (20.0, inf, inf)
    assert in_words([10.0, 20.0, inf], 0) == "20 / never / never"
    assert in_words([inf, inf]) == "never"


def test_a_row_of_the_file_is_read_as_it_was_written() -> None:
    takeover = Takeover(18.5, 19.25, inf, waited_ms=9.0, late=2, substitute="/substitute_1")
    words = dict(zip(Takeover._fields, takeover.in_words()))
    assert repr(from_words(words)) == repr(takeover)


def test_a_file_of_another_version_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "failover.csv"
    path.write_text("row,number,rospy_ms\nhot,1,16.0\n")
    with pytest.raises(SystemExit, match="failover.csv holds no rows of this version"):
        failover.read(path)


def test_every_silent_fault_stands_beside_respawn_with_and_without_a_bridge() -> None:
    assert len(of.BY_NAME) == len(of.ROWS)
    for fault in ("kill -9", "rosnode kill", "SIGSTOP", "slow", "intermittent"):
        beside = {row.contender for row in of.ROWS if row.fault == fault}
        assert {"hot", "hot, no bridge", "respawn, rospy"} <= beside
    assert {*of.SHORT} <= {*of.BY_NAME}


def test_what_this_version_does_not_know_is_left_out_and_said(
    capsys: "pytest.CaptureFixture[str]", monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(of, "KNOWN", {"name"})
    rows = failover.wanted(["SIGSTOP"], short=False)
    assert [row.name for row in rows if row.som] == []
    assert "hot, no bridge, SIGSTOP" in capsys.readouterr().out


def test_without_rosmon_its_row_is_left_out_and_said(
    capsys: "pytest.CaptureFixture[str]", tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("ROS_PACKAGE_PATH", str(tmp_path))
    assert failover.wanted(["rosmon"], short=False) == []
    assert "Left out: rosmon, rospy." in capsys.readouterr().out
    (tmp_path / "rosmon_core").mkdir()
    (tmp_path / "rosmon_core" / "package.xml").write_text(
        "<package><name>rosmon_core</name></package>"
    )
    assert [row.name for row in failover.wanted(["rosmon"], short=False)] == ["rosmon, rospy"]


def test_goals_and_picture_of_what_was_measured(
    tmp_path: Path, capsys: "pytest.CaptureFixture[str]"
) -> None:
    of_steps = (0.0, 4.0, 2.0, 1.0, 0.0, 0.0, 3.0)
    rows = {
        "hot": [Takeover(27.0, 29.0, 20.0, 9.0, *of_steps, substitute="/s")],
        "hot, SIGSTOP": [Takeover(50.0, 61.0, 45.0, waited_ms=9.0, substitute="/s")],
        "respawn, rospy, SIGSTOP": [Takeover(inf, inf, inf)],
    }
    verdicts = {row[0] + row[1]: row[-1] for row in failover.judge(rows).rows}
    assert verdicts == {
        "hot: median until the first messagerospy": "not met",
        "hot: p95 until the first messagerospy": "met",
        "hot: p95, 1 period + 8 msrospy": "met",
        "hot: p95, 1 period + 8 msroscpp": "not met",
        "hot, SIGSTOP: p95, 3 periodsrospy": "met",
        "hot, SIGSTOP: p95, 3 periodsroscpp": "not met",
    }
    failover.show(rows, markdown=True)
    failover.show_goals(failover.judge(rows))
    printed = " ".join(capsys.readouterr().out.split())
    assert '| `respawn="true"`, rospy, SIGSTOP | 1 | never | never | never |' in printed
    assert "| hot: p95, 1 period + 8 ms | 28 ms | 27 ms | 29 ms, not met |" in printed
    plot(rows, tmp_path / "failover.png")
    assert (tmp_path / "failover.png").stat().st_size > 10000
