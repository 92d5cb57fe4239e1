"""Substitutes of a service, calibrated by the monitor while the service is well."""
from dataclasses import replace
from math import sin
from random import Random
from typing import Any, Dict, List, Optional, Tuple

import pytest

from shsa_core.derivations import settings
from shsa_core.derivations.calibrations import Calibrations, _has_moved
from shsa_core.derivations.evaluation import Output
from shsa_core.model.calibration import Calibration
from shsa_core.model.error import Error
from shsa_core.model.health import PublisherHealth
from shsa_core.model.kinds import Kind
from shsa_core.model.log import Log
from shsa_core.model.ontology import Ontology
from shsa_core.model.service import Provision, Service, Signal
from shsa_core.model.som import Som
from shsa_core.model.substitution import Program, Substitution
from shsa_core.monitoring.events import (
    CalibrationsChanged,
    Connected,
    Disconnected,
    HealthChanged,
    Message,
    SomChanged,
    SubstitutionsChanged,
    Tick,
)
from shsa_core.monitoring.machine import Monitor
from shsa_core.search.derivation import Derivation
from shsa_testing.models import ontology_in

PERIOD = 0.05
ONTOLOGY = """
properties:
  speed: {unit: m/s}
  position: {unit: m}
  load: {unit: N}
  power: {}
  heading: {unit: rad}
relations:
  first: {load: {function: 2 * speed, quality: 0.9, error: 0.2}}
  second: {load: {function: power / 3, quality: 0.5, error: 0.5}}
  slope: {speed: {function: derivative(position), quality: 0.9}}
  path: {position: integral(speed)}
  turn: {heading: 0.1 * power}
"""
GAIN, OFFSET = 1.2, 0.5


@pytest.fixture(scope="module")
def ontology(tmp_path_factory: Any) -> Ontology:
    return ontology_in(tmp_path_factory.mktemp("model"), ONTOLOGY)


def service(name: str, needed: bool = False, **more: Any) -> Service:
    value = Provision(name, "data", (-1000.0, 1000.0), calibrate=more.pop("calibrate", True))
    rest: Dict[str, Any] = {"period": PERIOD, "provides": (value,), "needed": needed, **more}
    return Service(name, f"/{name}", "std_msgs/Float64", f"/{name}_node", **rest)


LOAD, SPEED, POWER = service("load", True), service("speed"), service("power")


class Robot:
    """Sensors of one drive: the load is 1.2 times what the first relation says, and 0.5 more."""

    def __init__(self, ontology: Ontology, *services: Service) -> None:
        self.core, self.now = Monitor(ontology=ontology), 100.0
        self.random, self.services = Random(1), services
        self.failures: List[PublisherHealth] = []
        self.rows: Dict[Tuple[str, Program], Tuple[Calibration, ...]] = {}
        self.told = 0
        self.said: List[str] = []
        self.hear(SomChanged(self.now, Som(services)))
        for each in services:
            self.hear(Connected(self.now, each.topic, each.node))

    def hear(self, event: Any) -> None:
        for said in self.core.handle(event):
            if isinstance(said, HealthChanged):
                self.failures += said.failed
            elif isinstance(said, Log):
                self.said.append(said.text)
            elif isinstance(said, CalibrationsChanged):
                self.told += len(said.rows)
                self.rows.update({(r.service, r.program): r.calibrations for r in said.rows})
                for key in said.removed:
                    self.rows.pop(key, None)

    def true(self) -> Dict[str, float]:
        speed = 2.0 + sin(self.now / 2.0)
        load = GAIN * 2.0 * speed + OFFSET
        position = 2.0 * self.now - 2.0 * (sin(self.now / 4.0 + 0.8) ** 2)
        return {"speed": speed, "load": load, "power": 3.0 * load - 3.0, "position": position}

    def run(self, seconds: float, silent: str = "", **wrong: float) -> None:
        for _ in range(round(seconds / PERIOD)):
            self.now += PERIOD
            values = {**self.true(), "heading": 0.3 * self.true()["power"], **wrong}
            for each in self.services:
                if each.name != silent:
                    value = values[each.name] + self.random.gauss(0.0, 0.01)
                    self.hear(Message(self.now, each.topic, each.node, (value,)))
            self.hear(Tick(self.now))

    def of(self, name: str, relation_input: str) -> Optional[Calibration]:
        """Return the calibrations of the program for a service that reads one other."""
        found = [
            row[0]
            for (service, program), row in self.rows.items()
            if service == name and program.inputs == (f"/{relation_input}/data",)
        ]
        assert len(found) <= 1
        return found[0] if found else None


def test_the_best_plan_and_the_one_after_are_calibrated(ontology: Ontology) -> None:
    robot = Robot(ontology, LOAD, SPEED, POWER)
    robot.run(90.0)
    first, second = robot.of("load", "speed"), robot.of("load", "power")
    assert first is not None and second is not None
    assert first.gain == pytest.approx(GAIN, abs=0.02)
    assert first.offset == pytest.approx(OFFSET, abs=0.1)
    assert first.error is not None and first.error.rms < 0.1
    assert second(3.0) == pytest.approx(4.0, abs=0.05)
    assert robot.failures == []


def test_only_changes_that_matter_are_told(ontology: Ontology) -> None:
    robot = Robot(ontology, LOAD, SPEED)
    robot.run(120.0)
    told = robot.told
    robot.run(60.0)
    assert 1 <= told <= 90
    assert robot.told - told <= 10


@pytest.mark.parametrize(
    "gain, offset, rms, moves",
    [
        (1.005, 1.009, 0.105, False),
        *((1.02, 1.0, 0.1, True), (0.98, 1.0, 0.1, True), (1.0, 1.02, 0.1, True)),
        *((1.0, 0.98, 0.1, True), (1.0, 1.0, 0.12, True), (1.0, 1.0, 0.08, True)),
    ],
)
def test_what_moves_values_by_a_tenth_of_their_error_is_told(
    gain: float, offset: float, rms: float, moves: bool
) -> None:
    told = Output(LOAD.sources[0], Derivation("load", LOAD.sources[0], None), None, False)
    told.told, told.calibration = (
        Calibration(*each[:2], Error(each[2])) for each in ((1.0, 1.0, 0.1), (gain, offset, rms))
    )
    assert _has_moved(told) is moves


def test_it_stays_as_of_the_last_good_second_when_the_node_fails(ontology: Ontology) -> None:
    robot = Robot(ontology, LOAD, SPEED)
    robot.run(60.0)
    before = robot.of("load", "speed")
    robot.run(3.0, load=40.0)
    robot.hear(Disconnected(robot.now, "/load", "/load_node"))
    robot.run(60.0, silent="load")
    assert [each.kind for each in robot.failures] == [Kind.NODE_GONE]
    after = robot.of("load", "speed")
    assert before is not None and after is not None
    assert after(4.0) == pytest.approx(before(4.0), abs=0.05)


def substitute(robot: Robot) -> None:
    """Lose the load: a substitute takes its place."""
    robot.hear(Disconnected(robot.now, "/load", "/load_node"))
    output = Signal("/load", "data", "std_msgs/Float64", "", PERIOD, 0.25)
    row = Substitution("/substitute_1", "load", (), "y=0.0", (output,), publishing=True)
    robot.hear(SubstitutionsChanged(robot.now, (row,), whole=True))
    robot.hear(Connected(robot.now, "/load", "/substitute_1"))


def stand_in(robot: Robot, seconds: float, **wrong: float) -> None:
    for _ in range(round(seconds / PERIOD)):
        robot.run(PERIOD, silent="load", **wrong)
        value = 30.0 + robot.random.random()
        robot.hear(Message(robot.now, "/load", "/substitute_1", (value,)))


def test_the_stated_error_grows_with_age_and_where_two_derivations_part(
    ontology: Ontology,
) -> None:
    robot = Robot(ontology, LOAD, SPEED, POWER)
    robot.run(90.0)
    before = rms(robot)
    substitute(robot)
    stand_in(robot, 20.0)
    aged = rms(robot)
    assert before < aged < before + 0.2
    stand_in(robot, 20.0, speed=3.5)
    assert rms(robot) > aged + 0.5


def test_a_law_that_remembers_is_compared_while_a_substitute_publishes(ontology: Ontology) -> None:
    robot = Robot(ontology, LOAD, service("position"), POWER)
    robot.run(90.0)
    substitute(robot)
    stand_in(robot, 20.0)
    stand_in(robot, 4.0, power=60.0)
    for name in ("position", "power"):
        found = robot.of("load", name)
        assert found is not None and found.error is not None and found.error.rms > 8.0


def test_the_stated_error_grows_and_shrinks_also_while_nobody_publishes(
    ontology: Ontology,
) -> None:
    robot = Robot(ontology, LOAD, SPEED, POWER)
    robot.run(90.0)
    robot.hear(Disconnected(robot.now, "/load", "/load_node"))
    robot.run(20.0, silent="load")
    agreed = rms(robot)
    robot.run(20.0, silent="load", speed=3.5)
    parted = rms(robot)
    assert parted > agreed + 0.5
    robot.run(240.0, silent="load")
    assert rms(robot) < agreed + 0.3 * (parted - agreed)


def test_a_derived_value_beyond_all_measure_stops_no_look_at_the_others(ontology: Ontology) -> None:
    anything = replace(SPEED, provides=(Provision("speed", "data"),))
    robot = Robot(ontology, LOAD, anything, POWER)
    robot.run(90.0)
    agreed = rms(robot)
    robot.hear(Disconnected(robot.now, "/load", "/load_node"))
    robot.run(20.0, silent="load", speed=1e200)
    assert rms(robot) < agreed + 0.2


def rms(robot: Robot) -> float:
    """Return the error that is stated of what is derived from the speed."""
    found = robot.of("load", "speed")
    assert found is not None and found.error is not None
    return found.error.rms


def drift(robot: Robot, seconds: float, *drifting: str) -> None:
    for number in range(round(seconds / PERIOD)):
        wrong = {n: robot.true()[n] + 0.02 * number * PERIOD for n in drifting}
        robot.run(PERIOD, "", **wrong)


def drop(robot: Robot, drifting: str) -> float:
    """Return by how much less the load is by the speed once a sensor has drifted."""
    robot.run(120.0)
    before = robot.of("load", "speed")
    drift(robot, 150.0, drifting)
    after = robot.of("load", "speed")
    assert before is not None and after is not None
    return before(4.0) - after(4.0)


def test_a_sensor_that_drifts_from_all_that_is_derived_is_not_followed(
    ontology: Ontology,
) -> None:
    robot = Robot(ontology, LOAD, SPEED, POWER)
    assert drop(robot, "load") == pytest.approx(0.0, abs=0.02)
    assert len(robot.said) == 1 and "load and what is derived of it part by" in robot.said[0]


def test_a_change_that_another_derivation_confirms_is_followed(ontology: Ontology) -> None:
    """What is derived from the speed is no more what the load is; the power says so as well."""
    robot = Robot(ontology, LOAD, SPEED, POWER)
    assert drop(robot, "speed") > 0.02 and robot.said == []


@pytest.mark.parametrize("echoes", [False, True])
def test_who_repeats_what_a_service_says_is_no_witness(ontology: Ontology, echoes: bool) -> None:
    robot = Robot(ontology, LOAD, SPEED, service("power", derived_from=("load",) * echoes))
    robot.run(40.0)
    assert robot.of("load", "speed") is not None
    assert (robot.of("load", "power") is None) is echoes


def test_what_would_substitute_comes_first_and_a_better_echo_watches_it(tmp_path: Any) -> None:
    mixed = "  mixed: {load: {function: power / 3 + 0 * position, quality: 0.9, error: 0.01}}\n"
    echo = service("power", derived_from=("load",))
    robot = Robot(ontology_in(tmp_path, ONTOLOGY + mixed), LOAD, SPEED, echo, service("position"))
    reads: List[Tuple[str, ...]] = []
    for _ in range(round(10.0 / PERIOD)):
        robot.run(PERIOD)
        plans = robot.core._judgement._derivations.plans("load")
        reads += [each.plan.program.inputs for each in plans[len(reads) :]]
    echoed = ("/power/data", "/position/data")
    assert reads == [("/speed/data",), ("/position/data",), echoed]


def test_a_substitute_teaches_nothing(ontology: Ontology) -> None:
    robot = Robot(ontology, LOAD, SPEED)
    robot.run(60.0)
    before = robot.of("load", "speed")
    substitute(robot)
    stand_in(robot, 60.0)
    after = robot.of("load", "speed")
    assert before is not None and after is not None
    assert after(4.0) == pytest.approx(before(4.0), abs=0.01)


@pytest.mark.parametrize("doubted", ["load", "speed"])
def test_bad_messages_of_sensor_or_input_leave_their_stretch_out(
    ontology: Ontology, doubted: str
) -> None:
    """Every fifth second something is out of range, too seldom to be a failure."""
    robot = Robot(ontology, LOAD, SPEED)
    robot.run(60.0)
    before = robot.of("load", "speed")
    for _ in range(20):
        robot.run(4.0, load=9.0 + robot.random.random())
        robot.run(PERIOD, "", **{doubted: 2000.0})
    assert robot.failures == []
    after = robot.of("load", "speed")
    assert before is not None and after is not None
    assert after(4.0) == pytest.approx(before(4.0), abs=0.05)


def test_searches_have_a_pause_between_them(
    ontology: Ontology, monkeypatch: pytest.MonkeyPatch
) -> None:
    robot = Robot(ontology, LOAD, SPEED, POWER)
    search, begun = Calibrations._search, []

    def noted(known: Calibrations, wanted: Any) -> Any:
        begun.append(robot.now)
        return search(known, wanted)

    monkeypatch.setattr(Calibrations, "_search", noted)
    robot.run(20.0)
    pauses = [later - at for at, later in zip(begun, begun[1:])]
    assert len(pauses) >= 2 and min(pauses) > settings.SEARCH_S - 0.001


def test_without_an_input_nothing_is_learned(ontology: Ontology) -> None:
    robot = Robot(ontology, LOAD, SPEED)
    robot.run(60.0)
    before = robot.of("load", "speed")
    robot.run(60.0, silent="speed", load=40.0)
    after = robot.of("load", "speed")
    assert before is not None and after is not None and after(4.0) == before(4.0)


def test_what_an_input_said_before_it_was_silent_teaches_nothing(ontology: Ontology) -> None:
    robot = Robot(ontology, LOAD, SPEED)
    robot.run(60.0)
    before = robot.of("load", "speed")
    for _ in range(20):
        robot.run(3.0)
        robot.run(3.0, speed=9.0)
        robot.run(1.0, silent="speed")
    after = robot.of("load", "speed")
    assert before is not None and after is not None
    assert after(4.0) == pytest.approx(before(4.0), abs=0.05)


def test_a_law_that_remembers_sees_every_sample(ontology: Ontology) -> None:
    robot = Robot(ontology, service("speed", True), service("position"))
    robot.run(40.0)
    found = robot.of("speed", "position")
    assert found is not None and found.error is not None


@pytest.mark.parametrize(
    "changes",
    [{"calibrate": False}, {"latched": True}, {"needed": False}],
    ids=lambda changes: next(iter(changes)),
)
def test_what_is_not_to_be_calibrated_is_not(ontology: Ontology, changes: Any) -> None:
    robot = Robot(ontology, service("load", **{"needed": True, **changes}), SPEED, POWER)
    robot.run(60.0)
    assert robot.rows == {}


@pytest.mark.parametrize("name, source", [("position", "speed"), ("heading", "power")])
def test_integrals_and_angles_are_not_calibrated(
    ontology: Ontology, name: str, source: str
) -> None:
    robot = Robot(ontology, service(name, True), service(source))
    robot.run(60.0)
    assert robot.rows == {}


def test_without_an_ontology_nothing_is_calibrated() -> None:
    core = Monitor()
    core.handle(SomChanged(0.0, Som([LOAD, SPEED])))
    assert core.handle(Tick(1.0)) == []


def test_a_service_that_changes_begins_anew(ontology: Ontology) -> None:
    robot = Robot(ontology, LOAD, SPEED)
    robot.run(60.0)
    assert robot.of("load", "speed") is not None
    (value,) = LOAD.provides
    changed = replace(LOAD, provides=(replace(value, calibrate=False),))
    robot.hear(SomChanged(robot.now, Som([changed, SPEED])))
    robot.run(60.0)
    assert robot.rows == {}


def test_a_service_that_leaves_the_som_as_it_is_refreshed_costs_the_others_nothing(
    ontology: Ontology,
) -> None:
    other = service("position", True)
    robot = Robot(ontology, LOAD, SPEED, POWER, other)
    robot.run(60.0)
    refreshed = robot.core._judgement._derivations._refreshed
    end = robot.now + 2 * settings.REFRESH_S
    while not any(each.plan.service == "load" for each in refreshed):
        assert robot.now < end
        robot.now += PERIOD
        for each in robot.services:
            robot.hear(Message(robot.now, each.topic, each.node, (robot.true()[each.name],)))
        refreshed = robot.core._judgement._derivations._refreshed
    robot.hear(SomChanged(robot.now, Som([SPEED, POWER, other])))
    robot.hear(Tick(robot.now))
    assert not any(name == "load" for name, _ in robot.rows)


def test_a_source_that_comes_later_is_planned_with(ontology: Ontology) -> None:
    robot = Robot(ontology, LOAD, SPEED, POWER)
    robot.run(30.0, silent="speed")
    assert robot.of("load", "speed") is None and robot.of("load", "power") is not None
    robot.run(60.0)
    assert robot.of("load", "speed") is not None


def test_no_more_is_evaluated_than_the_budget_allows(
    ontology: Ontology, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(settings, "EVALUATIONS_HZ", 6.0)
    robot = Robot(ontology, LOAD, SPEED, POWER)
    robot.run(60.0)
    assert robot.of("load", "speed") is not None and robot.of("load", "power") is None
