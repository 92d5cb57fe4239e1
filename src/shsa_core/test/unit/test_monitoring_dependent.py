"""Witnesses that know nothing of their own, and nodes that compute from what is wrong."""
from dataclasses import replace
from typing import Any

import pytest
from monitor_bench import table
from witness_robot import ONTOLOGY, PERIOD, Robot, service, usual

from shsa_core.model.ontology import Ontology
from shsa_core.model.service import Service, Signal
from shsa_core.model.substitution import Substitution
from shsa_core.monitoring.events import Connected, Disconnected, Message, SubstitutionsChanged
from shsa_testing.models import ontology_in

SUBSTITUTE = "/substitute_raw_1"


@pytest.fixture(scope="module")
def ontology(tmp_path_factory: Any) -> Ontology:
    return ontology_in(tmp_path_factory.mktemp("model"), ONTOLOGY)


def computed(name: str, *limit: float) -> Service:
    """A service that its node computes from `raw`."""
    return replace(service(name, *limit), derived_from=("raw",))


class RawRobot(Robot):
    """Some of its services are computed from `raw`, which a substitute can take over."""

    def __init__(self, ontology: Ontology, *services: Service) -> None:
        super().__init__(ontology, service("raw"), *services)
        self.true["raw"] = 10.0

    def replace_raw(self) -> None:
        self.hear(Disconnected(self.now, "/raw", "/raw_node"))
        outputs = (Signal("/raw", "data", "x/Y", "", PERIOD, 5 * PERIOD),)
        row = Substitution(SUBSTITUTE, "raw", (), "y=0.0", outputs, publishing=True)
        self.hear(SubstitutionsChanged(self.now, (row,), whole=True))
        self.hear(Connected(self.now, "/raw", SUBSTITUTE))
        self.failures.clear()

    def run_replaced(self, seconds: float, raw: float, **wrong: float) -> None:
        for _ in range(round(seconds / PERIOD)):
            self.hear(Message(self.now, "/raw", SUBSTITUTE, (raw,)))
            self.run(PERIOD, silent="raw", **wrong)


def test_two_that_are_computed_from_one_convict_nobody(ontology: Ontology) -> None:
    services = service("current", 2.0), service("voltage"), computed("power"), computed("draw")
    robot = RawRobot(ontology, *services)
    robot.run(10.0)
    robot.run(10.0, raw=20.0, power=240.0, draw=10.0)
    assert robot.failures == []


def test_who_computes_from_a_wrong_substitute_is_not_blamed(ontology: Ontology) -> None:
    robot = RawRobot(ontology, computed("current", 2.0), *usual()[1:])
    robot.run(10.0)
    robot.replace_raw()
    robot.run_replaced(10.0, raw=4.0, current=4.0)
    assert robot.failures == []
    row = next(each for each in table(robot.core) if each.topic == "/current")
    assert row.state == "healthy" and row.detail.startswith("not blamed: what it is computed from")


def test_who_was_wrong_before_its_input_failed_stays_so(ontology: Ontology) -> None:
    robot = RawRobot(ontology, computed("current", 2.0), *usual()[1:])
    robot.run(10.0)
    robot.run(10.0, current=4.0)
    assert robot.kinds() == {"current": "witness"}
    robot.replace_raw()
    robot.run_replaced(10.0, raw=10.0, current=4.0)
    row = next(each for each in table(robot.core) if each.topic == "/current")
    assert row.state == "failed"


def test_a_value_out_of_its_range_does_not_confirm_itself(ontology: Ontology) -> None:
    """What is made from it replaces what the only witness computes from."""
    current = service("current", 2.0)
    narrow = replace(current.provides[0], range=(0.0, 15.0))
    robot = RawRobot(ontology, replace(current, provides=(narrow,)), computed("draw"))
    robot.run(10.0)
    robot.replace_raw()
    robot.run_replaced(5.0, raw=10.0)
    robot.run_replaced(5.0, raw=40.0, current=40.0, draw=20.0)
    assert robot.kinds() == {"current": "out_of_range"}


def test_event_driven_nodes_that_died_are_no_witnesses(ontology: Ontology) -> None:
    others = [replace(each, period=None) for each in usual()[1:]]
    robot = Robot(ontology, service("current", 2.0), *others)
    robot.run(10.0)
    for each in others:
        robot.hear(Disconnected(robot.now, each.topic, each.node))
    robot.failures.clear()
    robot.services = robot.services[:1]
    robot.true["current"] = 20.0
    robot.run(10.0)
    assert robot.failures == []
