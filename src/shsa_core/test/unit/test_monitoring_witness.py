"""A value in its range that is wrong: others tell, where the SOM says how far off it may be."""
from dataclasses import replace
from typing import Any, Dict, List, Set

import pytest
from monitor_bench import table
from witness_robot import ONTOLOGY, PERIOD, Robot, service, usual

from shsa_core.derivations.agreement import _agree as agree
from shsa_core.model.checks import LEARNED, Witness, default_checks
from shsa_core.model.error import Error
from shsa_core.model.ontology import Ontology
from shsa_core.model.samples import WitnessSample
from shsa_core.model.service import Provision, Service, Signal
from shsa_core.model.som import Som
from shsa_core.model.substitution import Substitution
from shsa_core.monitoring.events import (
    Connected,
    Disconnected,
    Message,
    SomChanged,
    SubstitutionsChanged,
)
from shsa_testing.models import ontology_in


@pytest.fixture(scope="module")
def ontology(tmp_path_factory: Any) -> Ontology:
    return ontology_in(tmp_path_factory.mktemp("model"), ONTOLOGY)


def test_what_is_wrong_within_its_range_is_found_in_five_seconds(ontology: Ontology) -> None:
    robot = Robot(ontology, *usual())
    robot.run(60.0)
    assert robot.failures == []
    robot.run(5.0, current=4.0)
    assert robot.kinds() == {"current": "witness"}
    assert "by /power_node, /voltage_node it is" in robot.failures[0].detail
    assert "by /draw_node it is" in robot.failures[0].detail
    robot.run(30.0, current=4.0)
    assert len(robot.failures) == 1
    robot.run(5.0)
    state = {row.topic: str(row.state) for row in table(robot.core)}
    assert state["/current"] == "healthy"


def test_0_is_found(ontology: Ontology) -> None:
    robot = Robot(ontology, *usual())
    robot.run(10.0)
    robot.run(5.0, current=0.0)
    assert robot.kinds() == {"current": "witness"}


def test_who_is_on_the_same_host_may_still_be_a_witness(ontology: Ontology) -> None:
    robot = Robot(ontology, *(replace(each, host="pi") for each in usual()))
    robot.run(10.0)
    robot.run(5.0, current=0.0)
    assert robot.kinds() == {"current": "witness"}


def test_without_a_limit_nobody_is_compared(ontology: Ontology) -> None:
    robot = Robot(ontology, service("current"), service("power"), service("voltage"))
    robot.run(10.0)
    robot.run(20.0, current=4.0)
    assert robot.failures == []


def test_of_two_witnesses_both_must_say_so(ontology: Ontology) -> None:
    robot = Robot(ontology, *usual())
    robot.run(10.0)
    robot.run(20.0, draw=20.0)
    robot.run(20.0, power=20.0)
    assert robot.failures == []
    robot.run(6.0, current=4.0)
    assert robot.kinds() == {"current": "witness"}


def test_two_nodes_of_one_topic_are_two_witnesses(ontology: Ontology) -> None:
    """The programs that read them are the same."""
    twin = replace(service("draw"), name="twin", node="/twin_node")
    robot = Robot(ontology, service("current", 2.0), service("draw"), twin)
    robot.true["twin"] = robot.true["draw"]
    robot.run(60.0)
    robot.run(20.0, draw=8.0)
    assert robot.failures == []
    robot.run(60.0)
    robot.run(20.0, current=16.0)
    assert robot.kinds() == {"current": "witness"}


def test_of_two_twins_one_calibrates_the_program_that_both_have(ontology: Ontology) -> None:
    """Substitutes know a calibration by its program."""
    twin = replace(service("draw"), name="twin", node="/twin_node")
    robot = Robot(ontology, service("current"), service("draw"), twin)
    robot.true["twin"] = 6.0
    robot.run(120.0)
    rows = [row.calibrations[0] for row in robot.calibrated if row.service == "current"]
    gains = [each.gain for each in rows if each.error]
    assert gains and max(gains) - min(gains) < 0.05


def test_what_was_learned_outlives_a_change_of_an_inputs_numbers(ontology: Ontology) -> None:
    robot = Robot(ontology, service("current"), service("draw"))
    robot.run(30.0)
    plans = robot.core._judgement._derivations.plans
    before = plans("current")
    slower = replace(service("draw"), period=0.025)
    robot.hear(SomChanged(robot.now, Som([service("current"), slower])))
    robot.run(30.0)
    assert before and plans("current") == before
    (followed,) = plans("current")
    assert followed.plan.inputs[0].service == slower, "by the numbers of now"
    assert followed.outputs[0].derivation.inputs[0].source.service == slower  # type: ignore


def test_what_is_wrong_stays_so_where_another_services_numbers_change(ontology: Ontology) -> None:
    robot = Robot(ontology, *usual())
    robot.run(10.0)
    robot.run(5.0, current=4.0)
    slower = [replace(each, period=0.025) if each.name == "draw" else each for each in usual()]
    robot.hear(SomChanged(robot.now, Som(slower)))
    robot.run(5.0, current=4.0)
    assert {str(each.state) for each in table(robot.core) if each.topic == "/current"} == {"failed"}
    robot.hear(SomChanged(robot.now, Som(slower[:3])))
    robot.run(5.0, current=4.0)
    assert healthy(robot)["current"] == "doubtful", "one witness is left"


def test_one_witness_never_convicts_and_is_told_once(ontology: Ontology) -> None:
    robot = Robot(ontology, *usual()[:3])
    robot.run(10.0)
    robot.run(30.0, current=4.0)
    assert robot.failures == []
    (told,) = robot.told
    assert "nobody can tell which is wrong" in told
    (row,) = (each for each in table(robot.core) if each.topic == "/current")
    assert row.state == "healthy" and row.detail in told
    assert healthy(robot)["current"] == "doubtful"
    robot.run(10.0)
    assert set(healthy(robot).values()) == {"healthy"}
    (row,) = (each for each in table(robot.core) if each.topic == "/current")
    assert row.detail == ""


def test_two_witnesses_settle_a_dispute(ontology: Ontology) -> None:
    services = [service("current", 2.0), service("power"), service("voltage", 2.0)]
    robot = Robot(ontology, *services, service("draw"))
    robot.run(10.0)
    robot.run(6.0, current=4.0)
    assert robot.kinds() == {"current": "witness"}


def test_who_fails_is_no_witness(ontology: Ontology) -> None:
    robot = Robot(ontology, *usual())
    robot.run(10.0)
    robot.run(30.0, power=2000.0)
    assert robot.kinds() == {"power": "out_of_range"}
    robot.failures.clear()
    robot.run(30.0, silent="voltage", current=4.0)
    assert robot.kinds() == {"voltage": "silent"}


@pytest.mark.parametrize("wrong_for", (1.0, 2.0, 2.8))
def test_a_node_that_starts_anew_is_not_accused_of_what_its_predecessor_did(
    ontology: Ontology, wrong_for: float
) -> None:
    robot = Robot(ontology, *usual())
    robot.run(10.0)
    robot.run(wrong_for, current=4.0)
    robot.hear(Disconnected(robot.now, "/current", "/current_node"))
    robot.hear(Connected(robot.now, "/current", "/current_node"))
    robot.run(5.0)
    assert robot.kinds() == {"current": "node_gone"}
    robot.run(5.0, current=4.0)
    assert robot.kinds() == {"current": "witness"}


def test_who_speaks_just_before_a_node_does_not_hide_it(ontology: Ontology) -> None:
    """First a stranger, then as its substitute."""
    robot, other = Robot(ontology, *usual()), "/other"
    robot.run(20.1)
    robot.hear(Connected(robot.now, "/current", other))

    def run(seconds: float, **wrong: Any) -> Dict[str, str]:
        for _ in range(round(seconds / PERIOD)):
            robot.hear(Message(robot.now + PERIOD - 0.001, "/current", other, (10.0,)))
            robot.run(PERIOD, **wrong)
        return {each.publisher: str(each.state) for each in table(robot.core)}

    assert run(20.0, current=4.0)["/current_node"] == "failed"
    output = Signal("/current", "data", "x/Y", "", PERIOD, 5 * PERIOD)
    row = Substitution(other, "current", (), "y=0.0", (output,), publishing=True)
    robot.hear(SubstitutionsChanged(robot.now, (row,)))
    assert run(20.0, current=4.0)["/current_node"] == "failed"
    assert run(10.0)["/current_node"] == "healthy"


def test_a_short_difference_is_none(ontology: Ontology) -> None:
    robot = Robot(ontology, *usual())
    for _ in range(10):
        robot.run(5.0)
        robot.run(1.0, current=4.0)
    assert robot.failures == []


def known(name: str, error: float, witness: bool = False) -> Service:
    """A service whose error is known; `witness`: it is compared, with no limit of its own."""
    checks = default_checks(True) + ((Witness(LEARNED),) if witness else ())
    value = Provision(name, "data", (0.0, 1000.0), checks=checks, error=Error(error))
    return Service(name, f"/{name}", "std_msgs/Float64", f"/{name}_node", PERIOD, (value,))


def with_known_errors() -> List[Service]:
    return [known("current", 0.1, True), known("power", 1.2), known("voltage", 0.1)]


@pytest.fixture(scope="module")
def judged(tmp_path_factory: Any) -> Ontology:
    """The same laws, with errors: 4 times the rms of both is 1.3 A by power, and 0.9 A by draw."""
    text = """
properties: {power: {}, voltage: {}, current: {}, draw: {}}
relations:
  power: {current: {function: power / voltage, error: 0.3}}
  draw: {current: {function: 2 * draw, error: 0.2}}
"""
    return ontology_in(tmp_path_factory.mktemp("judged"), text)


def healthy(robot: Robot) -> Dict[str, str]:
    return {each.service.name: str(each.condition) for each in robot.core.overview()}


def test_by_known_errors_a_sensor_that_two_contradict_is_wrong(judged: Ontology) -> None:
    robot = Robot(judged, *with_known_errors(), known("draw", 0.1))
    robot.run(60.0)
    robot.run(5.0, current=8.0)
    assert robot.kinds() == {"current": "witness"}
    detail = robot.failures[0].detail
    assert "by /draw_node it is" in detail and "by /power_node, /voltage_node it is" in detail


def test_by_known_errors_a_drift_is_found(judged: Ontology) -> None:
    """At 0.05 A/s it takes 26 s to be wrong by 1.3 A, and 4 s to be sure."""
    robot = Robot(judged, *with_known_errors(), known("draw", 0.1))
    robot.run(20.0)
    for second in range(35):
        robot.run(1.0, current=10.0 + 0.05 * second)
        if robot.failures:
            break
    assert robot.kinds() == {"current": "witness"} and 20 <= second <= 33


def test_by_known_errors_a_fast_drift_is_found_in_six_seconds(judged: Ontology) -> None:
    """At 5 %/s: 0.5 A/s."""
    robot = Robot(judged, *with_known_errors(), known("draw", 0.1))
    robot.run(20.0)
    for step in range(65):
        robot.run(0.1, current=10.0 + 0.05 * step)
        if robot.failures:
            break
    assert robot.kinds() == {"current": "witness"} and step <= 62


def test_by_known_errors_a_sensor_that_stuck_is_found_once_the_value_moves(
    judged: Ontology,
) -> None:
    robot = Robot(judged, *with_known_errors(), known("draw", 0.1))
    robot.run(10.0)
    robot.run(10.0, current=10.0)
    assert robot.failures == []
    robot.true.update(power=60.0, current=5.0, draw=2.5)
    robot.run(6.0, current=10.0)
    assert robot.kinds() == {"current": "witness"}


@pytest.mark.parametrize(
    "wrong, doubtful, fine",
    [("draw", {"draw"}, {"power"}), ("power", {"power", "voltage"}, {"draw"})],
)
def test_a_derivation_that_is_outvoted_brings_its_inputs_in_doubt(
    judged: Ontology, wrong: str, doubtful: Set[str], fine: Set[str]
) -> None:
    robot = Robot(judged, *with_known_errors(), known("draw", 0.1))
    robot.run(10.0)
    robot.run(10.0, silent="", **{wrong: 0.5 * robot.true[wrong]})
    assert robot.failures == []
    states = healthy(robot)
    assert {name for name, state in states.items() if state == "doubtful"} == doubtful
    (told,) = {each.detail for each in robot.core.overview() if each.service.name in doubtful}
    assert all(f"/{name}_node" in told for name in {"current"} | fine)
    robot.run(10.0)
    assert set(healthy(robot).values()) == {"healthy"}


def test_by_known_errors_one_witness_alone_blames_nobody(judged: Ontology) -> None:
    robot = Robot(judged, *with_known_errors())
    robot.run(10.0)
    robot.run(20.0, current=4.0)
    assert robot.failures == []
    assert healthy(robot)["current"] == "doubtful"


def test_where_all_differ_nobody_is_blamed(judged: Ontology) -> None:
    robot = Robot(judged, *with_known_errors(), known("draw", 0.1))
    robot.run(10.0)
    robot.run(20.0, current=5.0, draw=10.0)
    assert robot.failures == []
    assert healthy(robot)["current"] == "doubtful"


def test_errors_that_nobody_states_are_known_once_they_were_seen(ontology: Ontology) -> None:
    services = [known("current", 0.1, True), *usual()[1:]]
    robot = Robot(ontology, *services)
    robot.run(240.0)
    assert robot.failures == []
    robot.run(6.0, current=8.0)
    assert robot.kinds() == {"current": "witness"}


def test_without_known_errors_nothing_is_judged_by_them(ontology: Ontology) -> None:
    services = [known("current", 0.1, True), *usual()[1:]]
    robot = Robot(ontology, *services)
    robot.run(10.0)
    robot.run(20.0, current=4.0)
    assert robot.failures == []
    assert set(healthy(robot).values()) == {"healthy"}


def test_a_witness_of_two_needs_the_other_to_agree(ontology: Ontology) -> None:
    """One witness tells too high, the other too low: no third is proven wrong."""
    robot = Robot(ontology, *usual())
    robot.run(10.0)
    robot.run(20.0, draw=8.0, power=60.0)
    assert robot.failures == []


def test_a_value_out_of_its_range_that_others_confirm_accuses_the_som(ontology: Ontology) -> None:
    """The load is larger than whoever wrote the range ever saw."""
    current = service("current", 2.0)
    narrow = replace(current.provides[0], range=(0.0, 15.0))
    robot = Robot(ontology, replace(current, provides=(narrow,)), *usual()[1:])
    robot.run(10.0)
    robot.true.update(power=240.0, current=20.0, draw=10.0)
    robot.run(10.0)
    assert robot.failures == []
    (told,) = robot.told
    assert "the range in the SOM may be wrong, and not the node" in told
    robot.run(5.0, current=40.0)
    assert robot.kinds() == {"current": "out_of_range"}


def test_two_witnesses_agree_within_the_errors_of_both() -> None:
    """Errors of 3 and 4 that know nothing of each other allow 5."""
    exact, rough = (WitnessSample("x", 20.0, 0.0, 20.0, "", each) for each in (3.0, 4.0))
    for samples in ([exact, rough], [rough, exact]):
        assert agree(4.9, samples) and not agree(5.1, samples)
    assert not agree(4.9, [exact, replace(rough, mean=4.9)]), "it is as far from the sensor"
    assert not agree(4.9, [exact, replace(rough, allowed=None)])
