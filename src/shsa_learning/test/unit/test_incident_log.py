"""Incidents from the lines of their log, and from messages."""
import json
from dataclasses import replace
from pathlib import Path

import pytest
import rospy

from shsa_learning.incident_log import MOST_BYTES, MOST_NOTES, of_message, read_log
from shsa_core.errors import ModelError
from shsa_core.healing.incident import Incident, State
from shsa_core.model.error import Error
from shsa_core.model.kinds import Kind
from shsa_core.ros import clock
from shsa_core.ros.wire import healing as wire

INCIDENT = Incident(
    3,
    "amps",
    "/battery_current",
    ("battery_current",),
    "/amperemeter",
    Kind.SILENT,
    "back",
    detected=1000.5,
    state=State.ENDED,
    last_good=1000.0,
    first_message=1000.75,
    ended=1010.0,
    inputs=("/odom/twist/twist/linear/x",),
    relations=("f1",),
    quality=0.5,
    errors=(Error(0.25, p95=0.5), None),
    unavailable=("imu",),
    evidence="no message within 0.25 s",
)


def line(incident: Incident) -> bytes:
    return json.dumps(incident.as_dict()).encode() + b"\n"


def test_what_is_logged_is_read(tmp_path: Path) -> None:
    log = tmp_path / "log"
    later = replace(INCIDENT, id=4, detected=900.0)
    log.write_bytes(line(INCIDENT) + line(later))
    assert read_log(str(log)) == ((later, INCIDENT), ())


def test_an_incident_counts_as_it_was_told_last(tmp_path: Path) -> None:
    """A reconfigurator logs what is open when it ends; the next one goes on with it."""
    log = tmp_path / "log"
    still_open = replace(INCIDENT, state=State.HEALED, ended=None, detected=1000.4995)
    another = replace(INCIDENT, detected=5000.0)  # of a robot that was started anew
    log.write_bytes(line(still_open) + line(INCIDENT) + line(another))
    assert read_log(str(log)).incidents == (INCIDENT, another)


@pytest.mark.parametrize(
    "wrong, told",
    [
        (b"{", "is not a line"),
        (b"[1]", "no JSON object"),
        (b'{"id": 1}', "is no incident: it lacks service, topic, "),
        (b"\xff", "is not a line"),
        (line(INCIDENT).replace(b'"silent"', b'"loud"'), "must be one of node_gone"),
        (line(INCIDENT).replace(b"1010.0", b"1e999"), "a moment is no time"),
        (b"[" * 100_000, "is not a line"),
    ],
)
def test_a_line_that_is_none_is_told_and_left_out(tmp_path: Path, wrong: bytes, told: str) -> None:
    log = tmp_path / "log"
    log.write_bytes(line(INCIDENT) + wrong.rstrip(b"\n") + b"\n")
    incidents, (note,) = read_log(str(log))
    assert incidents == (INCIDENT,)
    assert note.startswith(f"{log}:2: ") and told in note


def test_of_many_lines_that_are_none_a_few_are_told(tmp_path: Path) -> None:
    log = tmp_path / "log"
    log.write_bytes(b"x\n" * 1000 + line(INCIDENT))
    incidents, notes = read_log(str(log))
    assert incidents == (INCIDENT,) and len(notes) == MOST_NOTES + 1
    assert notes[-1] == f"{log}: {1000 - MOST_NOTES} more lines are no incidents"


@pytest.mark.parametrize("data", [b"{}\n", b'{"journal": 1}\n{"class": "Tick"}\n', bytes(10_000)])
def test_a_file_of_something_else_is_refused_in_one_line(tmp_path: Path, data: bytes) -> None:
    log = tmp_path / "log"
    log.write_bytes(data)
    with pytest.raises(ModelError) as refused:
        read_log(str(log))
    told = str(refused.value)
    assert told.startswith(f"{log}: is no incident log") and "\n" not in told and len(told) < 400
    assert "__init__" not in told


def test_of_a_log_that_is_too_long_the_end_is_read(tmp_path: Path) -> None:
    log = tmp_path / "log"
    log.write_bytes(b"x" * MOST_BYTES + b"\n" + line(INCIDENT))
    incidents, (note,) = read_log(str(log))
    assert incidents == (INCIDENT,) and "only the last" in note


def test_no_file_is_an_error(tmp_path: Path) -> None:
    with pytest.raises(ModelError, match="No such file"):
        read_log(str(tmp_path / "none"))


def test_a_message_tells_the_same(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(rospy.rostime, "_rostime_initialized", True)
    monkeypatch.setattr(clock, "offset", lambda: 0.0)
    message = wire.incident(INCIDENT)
    assert of_message(message) == INCIDENT
    message.kind = "loud"
    with pytest.raises(ModelError, match="loud"):
        of_message(message)
    message.detected = rospy.Time()
    with pytest.raises(ModelError, match="nobody has detected"):
        of_message(message)
