"""The reconfigurator hands on what the monitor has learned of a living sensor."""
from dataclasses import replace
from typing import Any, List, Tuple

import pytest
from shsa_msgs.msg import Calibrations

from core_robot import A, ONTOLOGY, SOM, Robot, last_incident, only, service
from shsa_core.codegen.plans import Plan, plan_service
from shsa_core.errors import ShsaError
from shsa_core.healing import events
from shsa_core.healing.planner import Calibrated
from shsa_core.healing.machine import Reconfigurator
from shsa_core.healing.planner import Planner
from shsa_core.model.calibration import UNCALIBRATED, Calibration
from shsa_core.model.error import Error
from shsa_core.model.kinds import Standby
from shsa_core.model.service import Signal
from shsa_core.model.som import Som
from shsa_core.model.substitution import Program
from shsa_core.monitoring.events import CalibrationRow
from shsa_core.ros import clock
from shsa_core.ros.wire.healing import calibrations_heard
from shsa_core.ros.wire.monitoring import calibration_key, calibration_row
from shsa_core.search.derivation import SourceTable

FOUND = Calibration(1.2, 0.5, Error(0.3, 0.01, 0.6, n=200))
LATER = Calibration(1.4, 0.9, Error(0.2, 0.01, 0.4, n=300))


def program_of_best() -> Program:
    table = SourceTable(ONTOLOGY.network, SOM.sources)
    return plan_service(ONTOLOGY, SOM.services["a"], table, (A,)).program


def told(robot: Robot, time: float, found: Calibration = FOUND) -> List[events.Command]:
    row = CalibrationRow("a", program_of_best(), (found,))
    return robot.handle(events.CalibrationsHeard(time, (row,)))


def standby(mode: str) -> Som:
    first = service("a", A, needed=True, standby=Standby(mode))
    return Som([first, *list(SOM)[1:]])


def calibrated(robot: Robot) -> Tuple[float, float]:
    """Gain and offset of the one substitute that works."""
    (row,) = robot.working()
    (output,) = row.outputs
    return output.gain, output.offset


@pytest.mark.parametrize("mode", ["cold", "warm", "hot"])
def test_a_substitute_starts_with_what_was_learned(mode: str) -> None:
    robot = Robot(standby(mode))
    told(robot, 5.0)
    commands = robot.fail("/a", A, 10.0)
    assert calibrated(robot) == (1.2, 0.5)
    (row,) = robot.working()
    assert row.outputs[0].error == FOUND.error
    incident = last_incident(commands)
    assert (incident.gains, incident.offsets) == ((1.2,), (0.5,))
    assert incident.errors == (FOUND.error,)
    if mode == "cold":
        assert only(commands, events.StartSubstitute).outputs[0].gain == 1.2


def test_a_takeover_works_out_what_a_plan_gives_once(monkeypatch: Any) -> None:
    robot = Robot(standby("cold"))
    worked_out: List[Plan] = []
    work_out = Planner._outputs

    def count(planner: Planner, plan: Plan, known: Calibrated) -> Tuple[Signal, ...]:
        worked_out.append(plan)
        return work_out(planner, plan, known)

    monkeypatch.setattr(Planner, "_outputs", count)
    told(robot, 5.0)
    worked_out.clear()
    robot.fail("/a", A, 10.0)
    assert len(worked_out) == 1
    assert calibrated(robot) == (1.2, 0.5)


def test_a_hot_substitute_follows_what_is_learned_in_the_same_process() -> None:
    robot = Robot(standby("hot"))
    node = robot.working()[0].node
    told(robot, 5.0)
    assert calibrated(robot) == (1.2, 0.5)
    told(robot, 6.0, LATER)
    assert calibrated(robot) == (1.4, 0.9) and robot.working()[0].node == node


def test_while_it_substitutes_the_calibration_stays_as_of_the_failure() -> None:
    robot = Robot()
    told(robot, 5.0)
    robot.heal(10.0)
    told(robot, 20.0, LATER)
    robot.table(21.0)
    assert calibrated(robot) == (1.2, 0.5)
    (row,) = robot.working()
    assert row.outputs[0].error == LATER.error  # nobody measures: the monitor knows better


def test_what_was_told_meanwhile_counts_at_the_next_failure() -> None:
    robot = Robot()
    told(robot, 5.0)
    node = robot.heal(10.0)
    robot.row("/a", A, "healthy", 12.0)
    robot.table(12.0)
    told(robot, 13.0, LATER)
    robot.handle(events.Tick(15.0))
    del robot.rows["/a", node]
    robot.table(16.0)
    robot.idle(16.0)
    robot.fail("/a", A, 100.0)
    assert calibrated(robot) == (1.4, 0.9)


def test_a_program_of_which_nothing_was_told_is_as_it_is() -> None:
    robot = Robot()
    other = replace(program_of_best(), inputs=("/elsewhere/data",))
    row = CalibrationRow("a", other, (FOUND,))
    robot.handle(events.CalibrationsHeard(5.0, (row,)))
    robot.fail("/a", A, 10.0)
    assert calibrated(robot) == (1.0, 0.0)


def test_a_service_that_is_not_to_be_calibrated_is_not() -> None:
    (value,) = SOM.services["a"].provides
    first = replace(SOM.services["a"], provides=(replace(value, calibrate=False),))
    robot = Robot(Som([first, *list(SOM)[1:]]))
    told(robot, 5.0)
    robot.fail("/a", A, 10.0)
    assert calibrated(robot) == (1.0, 0.0)


def test_what_is_calibrated_no_more_is_forgotten() -> None:
    robot = Robot()
    told(robot, 5.0)
    robot.handle(events.CalibrationsHeard(6.0, (), (("a", program_of_best()),)))
    robot.fail("/a", A, 10.0)
    assert calibrated(robot) == (1.0, 0.0)


def test_a_monitor_that_starts_anew_does_not_undo_what_was_learned() -> None:
    robot = Robot()
    told(robot, 5.0)
    told(robot, 8.0, replace(LATER, error=Error(0.2, n=10)))
    told(robot, 9.0, UNCALIBRATED)
    robot.fail("/a", A, 10.0)
    assert calibrated(robot) == (1.2, 0.5)


def test_a_row_with_another_number_of_outputs_is_not_used() -> None:
    robot = Robot()
    row = CalibrationRow("a", program_of_best(), (FOUND, FOUND))
    robot.handle(events.CalibrationsHeard(5.0, (row,)))
    robot.fail("/a", A, 10.0)
    assert calibrated(robot) == (1.0, 0.0)


def test_the_next_reconfigurator_goes_on_with_the_same_numbers() -> None:
    robot = Robot()
    told(robot, 5.0)
    node = robot.heal(10.0)
    row = robot.shown[node]
    records, robot.written = tuple(robot.written.values()), {}
    robot.core, robot.shown = Reconfigurator(ONTOLOGY, SOM, robot.core.settings), {}
    robot.handle(events.Started(20.0, (), (), records, (node,)))
    assert robot.shown[node] == row and calibrated(robot) == (1.2, 0.5)


def test_a_calibration_survives_the_way_as_a_message(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(clock, "now", lambda: 7.0)
    row = CalibrationRow("a", program_of_best(), (FOUND, UNCALIBRATED))
    row = replace(row, program=replace(row.program, outputs=("/a/data", "/a/other")))
    key = "a", program_of_best()
    table = Calibrations(calibrations=[calibration_row(row)], removed=[calibration_key(*key)])
    heard = calibrations_heard(table)
    (found,) = heard.rows
    assert heard.removed == (key,) and (found.service, found.program) == (row.service, row.program)
    assert found.calibrations[1] == UNCALIBRATED
    assert found.calibrations[0].gain == 1.2 and found.calibrations[0].error is not None
    assert found.calibrations[0].error.p95 == 0.6


@pytest.mark.parametrize(
    "changes",
    [
        {"gains": []},
        {"gains": [0.0]},
        {"gains": [float("nan")]},
        {"offsets": [float("inf")]},
        {"samples": [1, 2]},
    ],
    ids=str,
)
def test_a_message_that_is_no_calibration_is_refused(
    changes: dict, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(clock, "now", lambda: 7.0)
    message = calibration_row(CalibrationRow("a", program_of_best(), (FOUND,)))
    for name, value in changes.items():
        setattr(message, name, value)
    with pytest.raises(ShsaError, match="a: "):
        calibrations_heard(Calibrations(calibrations=[message]))


def test_a_key_that_names_nothing_is_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(clock, "now", lambda: 7.0)
    with pytest.raises(ShsaError, match="names no calibration"):
        calibrations_heard(Calibrations(removed=["x"]))
