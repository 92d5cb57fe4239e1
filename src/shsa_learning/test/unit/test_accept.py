"""`shsa accept`: advised incidents are judged, and one line is written, if somebody agrees."""
import json
import os
import resource
import subprocess
import sys
from dataclasses import replace
from pathlib import Path
from typing import Any, List, Optional

import pytest

from shsa_core.cli.main import main
from shsa_core.derivations.calibrator import SOURCE
from shsa_core.files.som_file import read_som
from shsa_core.healing.incident import Incident, State
from shsa_core.model.error import Error
from shsa_core.model.kinds import Kind
from shsa_learning.acceptance import advice

SOM = """\
# A comment.
services:
  odometry:
    {topic: /odom, type: std_msgs/Float64, node: /base, period: 0.1, provides: {v: {field: data}}}
  unheard:
    {topic: /x, type: a/B, node: /x, period: none, needed: false, provides: {x: {field: x}}}
"""
ADVISED = "nothing is done, as healing advises; else /base is killed: nothing else is lost with it"
LASTED = Incident(
    1,
    "odometry",
    "/odom",
    ("v",),
    "/base",
    Kind.SILENT,
    "",
    100.0,
    State.KEPT,
    inputs=("/imu/data",),
    outputs=("/odom/data",),
    errors=(Error(0.25),),
    decision=ADVISED,
)
BRIEF = replace(LASTED, id=2, kind=Kind.RATE_LOW, detected=200.0, returned=200.5, ended=202.5)
LACKS = replace(LASTED, id=3, detected=300.0, inputs=(), missing=("w",), decision="…advises")


@pytest.fixture
def som(tmp_path: Path) -> Path:
    path = tmp_path / "som.yaml"
    path.write_text(SOM)
    return path


def test_advice_counts_what_lasted_and_says_what_to_change(som: Path) -> None:
    acted = replace(LASTED, id=9, decision="/base is killed: nothing else is lost with it")
    of_another = replace(LASTED, service="unheard")
    (told,) = advice(read_som(str(som)), [LASTED, BRIEF, LACKS, acted, of_another])
    assert told[:6] == ("odometry", 2, 1, 1, 2, 1)
    assert "v: the substitute's RMS error is expected to be 0.25; it was never" in str(told)
    assert "rate_low: over by itself within 0.5 s: correct `period`" in str(told)
    lacking = replace(LACKS, decision=ADVISED)
    assert "no substitute: w is missing" in str(advice(read_som(str(som)), [lacking])[0])
    assert "nothing was advised" in str(advice(read_som(str(som)), [])[0])


HUNG = replace(LASTED, returned=120.0)
SEEN = Error(0.25, p95=0.5, n=40, source=SOURCE)


@pytest.mark.parametrize(
    "incident, right, needless, note",
    [
        (HUNG, 1, 1, "never compared"),
        (replace(HUNG, kind=Kind.NODE_GONE), 1, 0, "never compared"),
        (replace(HUNG, errors=(SEEN,)), 1, 1, "v: differed from the original by 0.25 RMS, 95 % by"),
        (replace(HUNG, errors=(Error(0.25, baseline=0.2),)), 0, 1, "say `policy: advise`"),
        (replace(HUNG, errors=(None,)), 1, 1, "v: nothing is known of the substitute's error"),
        (replace(HUNG, returned=101.0), 0, 1, "say `policy: advise`"),
    ],
)
def test_advice_is_compared_with_what_became_of_the_original(
    incident: Incident, right: int, needless: int, note: str, som: Path
) -> None:
    (told,) = advice(read_som(str(som)), [incident])
    assert (told.returned, told.right, told.needless) == (1, right, needless)
    assert note in str(told) and ("policy" in str(told)) is not bool(right)


@pytest.mark.parametrize("words, answer, act", [(["--yes"], "", 1), ([], "y", 1), ([], "", 0)])
def test_one_line_is_written_if_somebody_agrees(
    som: Path, words: List[str], answer: str, act: int, monkeypatch: pytest.MonkeyPatch, capsys: Any
) -> None:
    log = som.with_name("log.jsonl")
    log.write_text(json.dumps(BRIEF.as_dict()) + "\n")
    monkeypatch.setattr("builtins.input", lambda _: answer)
    command = ["accept", "--som", str(som), "--log", str(log), *words]
    assert main(command) == 1 - act
    assert som.read_text() == SOM.replace("services:", act * "act: true\n" + "services:")
    assert "right 0 of 1 times, its node ended 1 times (1 needlessly)" in capsys.readouterr().out
    assert main(command) == 1 - act  # a second time nothing changes


def test_a_line_that_says_no_is_changed(som: Path, tmp_path: Path) -> None:
    som.write_text("act: false\n" + SOM)
    log = tmp_path / "empty"
    log.touch()
    assert main(["accept", "--som", str(som), "--log", str(log), "--yes"]) == 0
    assert som.read_text() == "act: true\n" + SOM


@pytest.mark.parametrize("content", [None, "{}\n"])
def test_without_the_log_that_was_named_nothing_is_written(
    som: Path, content: Optional[str], capsys: Any
) -> None:
    log = som.with_name("named.jsonl")
    if content is not None:
        log.write_text(content)
    assert main(["accept", "--som", str(som), "--log", str(log), "--yes"]) == 2
    said = capsys.readouterr()
    assert said.err.startswith(f"shsa: {log}: ") and said.err.count("\n") == 1
    assert said.out == "" and som.read_text() == SOM


def test_before_the_first_incident_there_is_no_log(
    som: Path, monkeypatch: pytest.MonkeyPatch, capsys: Any
) -> None:
    none = str(som.with_name("shsa_incidents.jsonl"))
    monkeypatch.setattr("shsa_core.ros.incidents.log_path", lambda _: none)
    assert main(["accept", "--som", str(som), "--yes"]) == 0
    assert "nothing was advised yet" in capsys.readouterr().err


def test_a_full_disk_leaves_the_som_as_it_was(som: Path) -> None:
    def full() -> None:
        resource.setrlimit(resource.RLIMIT_FSIZE, (10, 10))

    script = Path(__file__).resolve().parents[3] / "shsa_core" / "scripts" / "shsa"
    log = som.with_name("empty.jsonl")
    log.touch()
    words = ["accept", "--yes", "--som", str(som), "--log", str(log)]
    done = subprocess.run(
        [sys.executable, str(script), *words],
        preexec_fn=full,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        universal_newlines=True,
        env={**os.environ, "PYTHONDONTWRITEBYTECODE": "1"},
    )
    assert done.returncode == 2 and "File too large" in done.stderr
    assert som.read_text() == SOM and {*som.parent.iterdir()} == {som, log}
