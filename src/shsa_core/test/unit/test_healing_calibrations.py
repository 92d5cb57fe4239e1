"""The reconfigurator hands on what the monitor has learned of a living sensor."""
from dataclasses import replace
from typing import List, Tuple

import pytest
from shsa_msgs import msg
from shsa_msgs.msg import Calibrations

from core_robot import A, ONTOLOGY, SOM, Robot, function, last_incident, only, service
from shsa_core.codegen.plans import plan_service
from shsa_core.errors import ShsaError
from shsa_core.healing import events
from shsa_core.healing.events import Log
from shsa_core.healing.incident import State
from shsa_core.healing.machine import Reconfigurator
from shsa_core.model.calibration import UNCALIBRATED, Calibration, CalibrationRow
from shsa_core.model.error import Error
from shsa_core.model.kinds import Standby
from shsa_core.model.log import Level
from shsa_core.model.ontology import Ontology, Property
from shsa_core.model.service import LastResort, Provision, Service
from shsa_core.model.som import Som
from shsa_core.model.substitution import Program
from shsa_core.ros import clock
from shsa_core.ros.wire.healing import calibration_key, calibration_row, calibrations_heard
from shsa_core.search.derivation import SourceTable

FOUND = Calibration(1.2, 0.5, Error(0.3, 0.01, 0.6, n=500))
LATER = Calibration(1.4, 0.9, Error(0.2, 0.01, 0.4, n=600))


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
    robot.back(12.0)
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


X, Y = "/x_node", "/y_node"
PAIR = Service(
    "p", "/p", "pkg/Type", "/p_node", 0.02, (Provision("u", "u"), Provision("v", "v")), needed=True
)
LAWS = ["ux: u by 2*x", "uy: u by 3*y", "vx: v by 4*x", "vy: v by 5*y"]


def pair(*outputs: Provision, last_resort: LastResort = LastResort()) -> Robot:
    """Two values, each by two laws with known errors; the first is the best of both."""
    functions = []
    for number, law in enumerate(LAWS):
        name, output, text = law.replace(":", "").replace(" by", "").split()
        each = function(name, output, text, 0.9)
        functions.append(replace(each, error=Error(0.1 * (number % 2 + 1), baseline=9.0)))
    properties = {name: Property(name) for name in "uvxy"}
    lost = replace(PAIR, provides=outputs or PAIR.provides, last_resort=last_resort)
    som = Som([lost, service("x", X), service("y", Y)])
    return Robot(som, Ontology(properties, {}, functions))


def measured(robot: Robot, time: float, without: str, *errors: float, n: int = 200) -> Program:
    """The monitor tells by what the best plan without a node errs; returns its program."""
    program = program_of(robot, without)
    row = CalibrationRow("p", program, tuple(calibration(rms, n) for rms in errors))
    robot.handle(events.CalibrationsHeard(time, (row,)))
    robot.idle(time)
    return program


def calibration(rms: float, n: int = 200) -> Calibration:
    return Calibration(1.1, rms, Error(rms, p95=2 * rms, n=n))


def program_of(robot: Robot, without: str) -> Program:
    """Return the program of the best plan without a node."""
    planner = robot.core.robot.planner
    question = planner.ontology, planner.som.services["p"], planner.plans.sources
    return plan_service(*question, ("/p_node", without), predictor=planner.predictor).program


def chosen(robot: Robot) -> Tuple[str, ...]:
    return robot.core.explain("p").relations


def test_what_was_measured_decides_value_by_value_and_its_calibrations_come_along() -> None:
    robot = pair()
    assert chosen(robot) == ("ux", "vx")
    measured(robot, 5.0, Y, 0.5, 0.1)
    assert chosen(robot) == ("ux", "vx"), "of the others nothing is known"
    measured(robot, 6.0, X, 0.3, 0.4)
    assert chosen(robot) == ("uy", "vx")
    robot.fail("/p", "/p_node", 10.0)
    (row,) = robot.working()
    assert [(each.gain, each.offset) for each in row.outputs] == [(1.1, 0.3), (1.1, 0.1)]
    assert [each.error.rms for each in row.outputs if each.error] == [0.3, 0.1]


def test_small_changes_and_few_samples_change_no_plan() -> None:
    robot = pair()
    measured(robot, 5.0, Y, 0.5, 0.1)
    measured(robot, 6.0, X, 0.3, 0.4, n=50)
    assert chosen(robot) == ("ux", "vx")
    measured(robot, 7.0, X, 0.45, 0.4)
    assert chosen(robot) == ("ux", "vx"), "that is not clear"
    measured(robot, 8.0, X, 0.39, 0.4)
    assert chosen(robot) == ("ux", "vx"), "nor has it changed much"
    measured(robot, 9.0, X, 0.3, 0.4)
    assert chosen(robot) == ("uy", "vx")


def test_what_is_measured_while_it_is_healed_changes_no_plan_that_runs() -> None:
    robot = pair()
    measured(robot, 5.0, Y, 0.5, 0.1)
    robot.fail("/p", "/p_node", 10.0)
    program = measured(robot, 11.0, X, 0.3, 0.4)
    assert chosen(robot) == ("uy", "vx")
    assert robot.working()[0].relations == ("ux", "vx")
    robot = pair()
    measured(robot, 5.0, Y, 0.5, 0.1)
    assert measured(robot, 6.0, X, 0.3, 0.4) == program
    robot.handle(events.CalibrationsHeard(7.0, (), (("p", program),)))
    robot.core.robot.planner.plans.drop("p")
    robot.idle(7.0)
    assert chosen(robot) == ("ux", "vx"), "it is followed no more"


def contradicted(first: float, second: float) -> Tuple[Robot, List[events.Command]]:
    """While the best plan of both substitutes, the monitor tells by what each may err."""
    robot = pair()
    measured(robot, 5.0, Y, 0.2, 0.2)
    measured(robot, 6.0, X, 0.3, 0.3)
    robot.heal(10.0, "/p", "/p_node")
    other, best = (
        CalibrationRow("p", program, (calibration(rms),) * 2)
        for program, rms in ((program_of(robot, X), second), (program_of(robot, Y), first))
    )
    return robot, robot.handle(events.CalibrationsHeard(20.0, (other, best)))


def test_a_substitute_that_is_contradicted_gives_way_to_one_that_is_not() -> None:
    robot, said = contradicted(2.0, 0.3)
    (row,) = robot.working()
    assert row.publishing and row.relations == ("uy", "vy")
    assert [(each.gain, each.offset) for each in row.outputs] == [(1.1, 0.3)] * 2
    told = "/p: the substitute is contradicted: its error has grown. The next best takes its place."
    assert Log(Level.WARN, told) in said and last_incident(said).state is State.HEALED
    contradicted_too = CalibrationRow("p", program_of(robot, X), (calibration(8.0),) * 2)
    robot.handle(events.CalibrationsHeard(30.0, (contradicted_too,)))
    assert robot.working()[0].relations == ("ux", "vy"), "what was tried is not tried again"


@pytest.mark.parametrize("first, second", [(2.0, 2.0), (0.2, 0.3), (0.35, 0.3)])
def test_a_substitute_goes_on_where_no_other_errs_clearly_less(first: float, second: float) -> None:
    robot, _ = contradicted(first, second)
    assert robot.working()[0].relations == ("ux", "vx")


def intolerant(limit: float, last_resort: LastResort = LastResort(), n: int = 200) -> Robot:
    """The best plan of a pair substitutes; an error of the first value up to `limit` is borne."""
    strict = replace(PAIR.provides[0], fault_tolerant_error=limit), PAIR.provides[1]
    robot = pair(*strict, last_resort=last_resort)
    measured(robot, 5.0, Y, 0.1, 0.1, n=n)
    robot.heal(10.0, "/p", "/p_node")
    return robot


def errs(robot: Robot, time: float, rms: float, n: int = 200) -> List[events.Command]:
    """The monitor tells by what the best plan may err now."""
    row = CalibrationRow("p", program_of(robot, Y), (calibration(rms, n),) * 2)
    return robot.handle(events.CalibrationsHeard(time, (row,)))


@pytest.mark.parametrize("n", [50, 200])
def test_a_substitute_that_errs_more_than_is_tolerated_by_now_is_used_no_more(n: int) -> None:
    robot = intolerant(0.3, n=n)
    assert not any(isinstance(each, Log) for each in errs(robot, 15.0, 0.14, n))
    said = errs(robot, 20.0, 2.0, n)
    why = "u by ux: its error of 4 (p95) is above fault_tolerant_error, 0.3"
    assert Log(Level.WARN, f"/p: the substitute is used no more: {why}.") in said
    assert last_incident(said).state is State.UNHEALED and robot.working() == []
    assert why in last_incident(said).detail


def test_what_errs_too_much_makes_room_for_safe_values_and_is_used_again_once_it_may_be() -> None:
    robot = intolerant(0.3, LastResort(values=(("u", 0.0), ("v", 0.0))))
    errs(robot, 20.0, 2.0)
    incident = robot.core.incident("p")
    assert incident is not None and incident.state is State.SAFE
    robot.handle(events.Tick(25.0))
    assert [row.relations for row in robot.working()] == [()], "it still errs too much"
    errs(robot, 30.0, 0.14)
    robot.handle(events.Tick(100.0))
    assert [row.relations for row in robot.working()] == [("ux", "vx")]


def test_one_that_errs_too_much_makes_room_for_any_that_is_tolerated() -> None:
    robot = intolerant(0.5)
    assert last_incident(errs(robot, 20.0, 2.0)).state is State.HEALED
    assert robot.working()[0].relations == ("uy", "vx")


@pytest.mark.parametrize("standby", [Standby.COLD, Standby.HOT])
def test_a_substitute_that_errs_too_much_is_not_used_and_the_incident_says_why(
    standby: Standby,
) -> None:
    strict = replace(PAIR.provides[0], fault_tolerant_error=0.1), PAIR.provides[1]
    robot = pair(*strict)
    commands = robot.fail("/p", "/p_node", 10.0)
    incident = last_incident(commands)
    assert incident.state is State.UNHEALED and incident.missing == ()
    why = "u by ux: its error of 0.196 (p95) is above fault_tolerant_error, 0.1"
    told = f"/p cannot be healed now: no substitute for u, v: {why}."
    assert incident.detail == told and robot.working() == []
    assert Log(Level.ERROR, told) in commands


def test_an_error_that_was_measured_lets_a_substitute_be_used_or_not() -> None:
    strict = replace(PAIR.provides[0], fault_tolerant_error=0.3), PAIR.provides[1]
    robot = pair(*strict)
    assert chosen(robot) == ("ux", "vx")
    measured(robot, 5.0, Y, 0.5, 0.1)
    with pytest.raises(ShsaError, match="u by ux: its error of 1 "):
        chosen(robot)
    robot.fail("/p", "/p_node", 10.0)
    assert robot.working() == []


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
    told(robot, 8.0, replace(LATER, error=Error(0.2, n=50)))
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
    robot.core, robot.shown = Reconfigurator(ONTOLOGY, SOM, robot.core.robot.settings), {}
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
    assert heard.removed == (key,) and found == row


@pytest.mark.parametrize(
    "calibration",
    [
        Calibration(gain=0.0),
        Calibration(gain=float("nan")),
        Calibration(offset=float("inf")),
        Calibration(error=Error(float("inf"))),
    ],
    ids=str,
)
def test_a_message_that_is_no_calibration_is_refused(
    calibration: Calibration, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(clock, "now", lambda: 7.0)
    message = calibration_row(CalibrationRow("a", program_of_best(), (calibration,)))
    with pytest.raises(ShsaError, match="a: "):
        calibrations_heard(Calibrations(calibrations=[message]))


def test_a_text_that_is_none_is_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(clock, "now", lambda: 7.0)
    with pytest.raises(ShsaError, match="the key is no JSON"):
        calibrations_heard(Calibrations(removed=["x"]))
    with pytest.raises(ShsaError, match="the row must be"):
        calibrations_heard(Calibrations(calibrations=[msg.Calibration("x", "[]")]))
