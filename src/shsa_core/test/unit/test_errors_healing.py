"""Expected errors in healing: what is chosen, shown and told by them, as the models are now."""
from dataclasses import replace
from math import isnan
from typing import Optional, Tuple

import pytest
from core_robot import A, ONTOLOGY, SOM, Robot, last_incident

from shsa_core.healing import events
from shsa_core.journal.codec import Codec
from shsa_core.healing.incident import Incident
from shsa_core.model.error import Error
from shsa_core.model.ontology import Ontology
from shsa_core.model.som import Som


def measured(good: Optional[float], poor: Optional[float]) -> Ontology:
    """The relation `good` has the higher quality."""
    errors = {"good": good, "poor": poor}
    functions = ((each, errors[each.relation]) for each in ONTOLOGY.functions)
    return Ontology(
        {name: replace(each, usual=(0.0, 1.0)) for name, each in ONTOLOGY.properties.items()},
        {},
        [replace(f, error=None if rms is None else Error(rms, p95=1.5)) for f, rms in functions],
    )


def with_error(service: str, rms: float) -> Som:
    """The SOM in which a service says how far it is off."""
    return Som(
        each
        if each.name != service
        else replace(each, provides=(replace(each.provides[0], error=Error(rms)),))
        for each in SOM
    )


def chosen(robot: Robot) -> Tuple[Tuple[str, ...], Optional[float]]:
    plan = robot.core.explain("a")
    error = plan.errors[0]
    return plan.relations, None if error is None else error.rms


def test_healing_follows_the_smallest_error_and_tells_it() -> None:
    robot = Robot(ontology=measured(0.9, 0.7))
    assert chosen(robot) == (("poor",), 0.7)
    commands = robot.fail("/a", A, 10.0)
    (row,) = robot.working()
    assert row.relations == ("poor",)
    assert [each.error for each in row.outputs] == [Error(0.7, p95=1.5)]
    incident = last_incident(commands)
    assert incident.errors == (Error(0.7, p95=1.5),)
    assert incident.as_dict()["errors"][0]["rms"] == 0.7  # type: ignore[index]
    codec = Codec(Incident)
    assert codec.decode(codec.encode(incident), "x", "x") == incident


def test_without_a_substitute_no_error_is_told() -> None:
    robot = Robot(Som([*SOM][:1]))
    assert last_incident(robot.fail("/a", A, 10.0)).errors == ()


def test_choice_and_errors_follow_the_som_as_it_is_now() -> None:
    robot = Robot(
        ontology=replace(
            measured(None, 0.7),
            functions=[
                replace(f, quality=1.0) if f.relation == "good" else f
                for f in measured(None, 0.7).functions
            ],
        )
    )
    assert chosen(robot) == (("poor",), 0.7)
    robot.handle(events.SomChanged(2.0, with_error("b", 0.1)))  # `good` is exact: b + 1
    robot.idle(2.0)
    relations, rms = chosen(robot)
    assert relations == ("good",) and rms == pytest.approx(0.1)
    robot.handle(events.SomChanged(3.0, with_error("b", 0.8)))
    robot.idle(3.0)
    assert chosen(robot) == (("poor",), 0.7)
    robot.fail("/a", A, 10.0)
    assert robot.working()[0].relations == ("poor",)


def test_the_answer_and_the_incident_on_the_wire() -> None:
    pytest.importorskip("rospy")
    from shsa_core.ros.wire import healing as wire

    robot = Robot(ontology=measured(0.9, 0.7))
    answer = wire.found(robot.core.explain("a"))
    assert (answer.error_rms, answer.error_p95) == ([0.7], [1.5])
    unknown = wire.found(Robot().core.explain("a"))
    assert isnan(unknown.error_rms[0]) and isnan(unknown.error_p95[0])
