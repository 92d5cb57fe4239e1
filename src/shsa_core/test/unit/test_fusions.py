"""Derivations are fused where their sum errs less than each, and only there."""
from dataclasses import replace
from math import sqrt
from random import Random
from typing import Any, Dict, List, Optional

import pytest

from core_robot import Robot, function, service
from shsa_core.codegen.generator import fuse, fusions_of, generate
from shsa_core.codegen.program import compile_program
from shsa_core.healing import events
from shsa_core.derivations import settings
from shsa_core.derivations.fusions import shares
from shsa_core.model.calibration import Calibration, CalibrationRow
from shsa_core.model.error import Error
from shsa_core.model.log import Log
from shsa_core.model.ontology import Ontology, Property
from shsa_core.model.service import Provision, Service
from shsa_core.model.som import Som
from shsa_core.model.substitution import Program
from shsa_core.monitoring.events import (
    CalibrationsChanged,
    Connected,
    Disconnected,
    Message,
    SomChanged,
    Tick,
)
from shsa_core.monitoring.machine import Monitor
from shsa_core.search.derivation import Derivation
from shsa_testing.models import ontology_in

PERIOD = 0.2
JUDGED_S = settings.FUSED * settings.ERRORS_APART * settings.SAMPLE_S
ONTOLOGY = """
properties: {speed: {}, load: {}, power: {}}
relations:
  first: {load: {function: 2 * speed, quality: 0.9, error: 0.1}}
  second: {load: {function: power / 3, quality: 0.5, error: 0.1}}
"""


@pytest.fixture(scope="module")
def ontology(tmp_path_factory: Any) -> Ontology:
    return ontology_in(tmp_path_factory.mktemp("model"), ONTOLOGY)


def measured(name: str, needed: bool = False) -> Service:
    value = (Provision(name, "data", (-99.0, 99.0)),)
    rest: Dict[str, Any] = {"period": PERIOD, "provides": value, "needed": needed}
    return Service(name, f"/{name}", "std_msgs/Float64", f"/{name}_node", **rest)


class Watched:
    """A load that is measured, and derived twice; `common`: of both errors, 0.1 each, in all."""

    def __init__(self, ontology: Ontology, common: float) -> None:
        self.core, self.random, self.now = Monitor(ontology=ontology), Random(2), 100.0
        self.common = common
        self.rows: Dict[Program, Calibration] = {}
        self.said: List[str] = []
        self.services = [measured("speed"), measured("power"), measured("load", needed=True)]
        self.hear(SomChanged(self.now, Som(self.services)))
        for each in self.services:
            self.hear(Connected(self.now, each.topic, each.node))

    def hear(self, event: Any) -> None:
        for said in self.core.handle(event):
            if isinstance(said, Log):
                self.said.append(said.text)
            elif isinstance(said, CalibrationsChanged):
                self.rows.update({row.program: row.calibrations[0] for row in said.rows})
                for _, program in said.removed:
                    self.rows.pop(program, None)

    def run(self, seconds: float, second: float = 0.1, lost: str = "") -> None:
        """`second`: the error of the second derivation."""
        for _ in range(round(seconds / PERIOD)):
            self.now += PERIOD
            load = 4.0 + self.random.gauss(0.0, 1.0)
            cause = self.random.gauss(0.0, self.common)
            rest = sqrt(0.1**2 - self.common**2)
            errors = [cause + self.random.gauss(0.0, rest) for _ in range(2)]
            errors[1] *= second / 0.1
            values = {"load": load, "speed": load + errors[0], "power": load + errors[1]}
            values = {**values, "speed": 0.5 * values["speed"], "power": 3.0 * values["power"]}
            for each in self.services:
                if each.name != lost:
                    self.hear(Message(self.now, each.topic, each.node, (values[each.name],)))
            self.hear(Tick(self.now))

    @property
    def fused(self) -> Optional[Program]:
        found = [program for program in self.rows if fusions_of(program)]
        assert len(found) <= 1
        return found[0] if found else None


def test_independent_errors_are_fused_and_the_gain_is_that_of_what_came_after(
    ontology: Ontology,
) -> None:
    robot = Watched(ontology, 0.0)
    robot.run(JUDGED_S + 60.0)
    assert robot.fused is None, "it has not been judged yet"
    robot.run(JUDGED_S + 60.0)
    program = robot.fused
    assert program is not None and set(program.inputs) == {"/speed/data", "/power/data"}
    (said,) = robot.said
    assert said.startswith("/load: fusion ") and "times as much as the best part" in said
    error = robot.rows[program].error
    singles = [c.error for p, c in robot.rows.items() if p != program]
    assert error is not None and len(singles) == 2
    for single in singles:
        assert single is not None and error.rms < settings.FUSED_GAIN * single.rms
    step = compile_program(program.code, 2, 1).step
    value = {"/speed/data": 2.0, "/power/data": 12.0}
    assert step([value[path] for path in program.inputs], 0.0) == pytest.approx((4.0,), abs=0.1)


def test_errors_of_one_cause_are_not_averaged_as_if_they_were_independent(
    ontology: Ontology,
) -> None:
    robot = Watched(ontology, 0.097)
    robot.run(3.0 * JUDGED_S)
    assert len(robot.rows) == 2 and robot.fused is None and robot.said == []


def test_what_proves_no_better_any_more_is_given_up(ontology: Ontology) -> None:
    robot = Watched(ontology, 0.0)
    robot.run(2.0 * JUDGED_S + 120.0)
    assert robot.fused is not None
    robot.run(120.0, second=0.6)
    assert robot.fused is None and len(robot.rows) == 2


def test_what_reads_a_lost_input_is_given_up(ontology: Ontology) -> None:
    robot = Watched(ontology, 0.0)
    robot.run(2.0 * JUDGED_S + 120.0)
    robot.hear(Disconnected(robot.now, "/power", "/power_node"))
    robot.run(20.0, lost="power")
    assert robot.fused is None


def errors_of(columns: List[List[float]]) -> List[Dict[float, float]]:
    return [dict(enumerate(column)) for column in columns]  # type: ignore[arg-type]


@pytest.mark.parametrize(
    "correlation, worth, fuses",
    [(0.0, 1.0, True), (0.5, 1.0, True), (0.95, 1.0, False), (0.0, 5.0, False)],
)
def test_shares_are_those_of_what_errs_apart(correlation: float, worth: float, fuses: bool) -> None:
    random = Random(3)
    columns: List[List[float]] = [[], []]
    for _ in range(2 * settings.FUSED):
        cause = random.gauss(0.0, sqrt(correlation))
        for column, size in zip(columns, (1.0, worth)):
            column.append(size * (cause + random.gauss(0.0, sqrt(1.0 - correlation))))
    found = shares(errors_of(columns))
    assert (len(found) == 2) is fuses and sum(found.values()) == pytest.approx(1.0)
    assert all(share > 0.0 for share in found.values())


def test_three_are_fused_and_what_was_not_measured_together_is_not() -> None:
    random = Random(4)
    columns = [[random.gauss(0.0, 1.0) for _ in range(2 * settings.FUSED)] for _ in range(4)]
    found = shares(errors_of(columns))
    assert len(found) == 3 and all(0.2 < share < 0.5 for share in found.values())
    apart = [{t + 1000.0 * i: e for t, e in c.items()} for i, c in enumerate(errors_of(columns))]
    assert len(shares(apart)) == 1
    assert shares([{}, {1.0: 0.1}]) == {}


X, Y = "/x_node", "/y_node"
LAWS = [
    replace(function(f"u{name}", "u", f"{number}*{name}", 0.9), error=Error(rms, baseline=9.0))
    for number, name, rms in ((2, "x", 0.1), (3, "y", 0.2))
]
LOST = service("u", "/u_node", needed=True)
MODEL = Ontology({name: Property(name) for name in "uxy"}, {}, LAWS)


def fused_program() -> Program:
    x, y = (each.sources[0] for each in (service("x", X), service("y", Y)))
    parts = [
        Derivation("u", None, law, (Derivation(source.property, source, None),))
        for law, source in zip(LAWS, (x, y))
    ]
    found = fuse(parts, [(0.6, Calibration(1.1, 0.5)), (0.4, Calibration(0.9, -2.0))])
    derivation = Derivation("u", None, found.function, tuple(parts))
    program = generate([(derivation, "/u/data")], {})
    assert fusions_of(program) == (found,)
    return program


def test_the_generated_code_shows_a_fusion_which_is_read_from_it_again() -> None:
    program = fused_program()
    assert "def _tf3(i1,i2): # fusion 60:40: u\n  return 0.66*i1 + 0.36*i2 -0.5\n" in program.code
    value = 0.6 * (1.1 * 2.0 * 5.0 + 0.5) + 0.4 * (0.9 * 3.0 * 7.0 - 2.0)
    assert compile_program(program.code, 2, 1).step([5.0, 7.0], 0.0) == pytest.approx((value,))


@pytest.mark.parametrize(
    "code",
    [
        "t0=x[0];\ndef _tf1(i1): # fusion 60:40: u\n  return __import__('os')\nt1=_tf1(t0)\ny=t1\n",
        "y=t0",
    ],
)
def test_code_that_is_no_fusion_is_not_read_as_one(code: str) -> None:
    assert fusions_of(Program(("/x/data",), code, ("/u/data",))) == ()


def told(robot: Robot, time: float, program: Program, rms: float) -> None:
    row = CalibrationRow("u", program, (Calibration(error=Error(rms, n=200)),))
    robot.handle(events.CalibrationsHeard(time, (row,)))
    robot.idle(time)


def healing() -> Robot:
    return Robot(Som([LOST, service("x", X), service("y", Y)]), MODEL)


def test_a_proven_fusion_is_what_takes_over_and_a_lost_input_falls_back_to_the_rest() -> None:
    robot = healing()
    told(robot, 5.0, fused_program(), 0.1)
    assert robot.core.explain("u").relations == ("fusion 60:40", "ux", "uy")
    robot.heal(10.0, "/u", "/u_node")
    (row,) = robot.working()
    assert row.code == fused_program().code and row.outputs[0].error == Error(0.1, n=200)
    robot.row("/x", X, "failed", 20.0)
    robot.table(20.0)
    (row,) = robot.working()
    assert row.relations == ("uy",) and row.publishing


def test_a_fusion_that_is_given_up_is_used_no_more() -> None:
    robot = healing()
    told(robot, 5.0, fused_program(), 0.1)
    robot.handle(events.CalibrationsHeard(6.0, (), (("u", fused_program()),)))
    robot.idle(6.0)
    assert robot.core.explain("u").relations == ("ux",)
