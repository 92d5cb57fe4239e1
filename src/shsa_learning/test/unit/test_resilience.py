"""The resilience analysis: against trying every set of nodes, and by hand on small robots."""
import dataclasses
from itertools import combinations
from math import comb
from random import Random
from typing import Any, Dict, Iterable, List, Tuple

import pytest
from hypothesis import given, settings, strategies as st
from shsa_testing.models import every_derivation, law, ontology, random_model, som_of, source

from shsa_core.codegen.plans import plan_service
from shsa_core.errors import GenerationError, NoSubstitute
from shsa_core.model.ontology import Ontology, TransferFunction
from shsa_core.model.service import Service
from shsa_core.model.som import Som
from shsa_core.search.derivation import SourceTable
from shsa_learning.check import check_model
from shsa_learning.report.report import Suggestion, Survival
from shsa_learning.report.resilience import analyse
from shsa_learning.substitutes import find_substitute
from shsa_testing.thorough import many

RANDOM = settings(max_examples=many(300), deadline=None, derandomize=True)


def random_robot(seed: int) -> Tuple[Ontology, Som]:
    """A random ontology and SOM; some services are needed, and some share a topic."""
    robot, sources, _ = random_model(seed)
    random = Random(seed)
    som = som_of(sources)
    needed = {service.topic: random.random() < 0.6 for service in som}
    causes: List[List[str]] = [[], [], ["hub"], ["hub", "mast"], ["/m"]]
    return robot, Som(
        dataclasses.replace(
            s,
            needed=needed[s.topic],
            fails_with=tuple(random.choice(causes)),
            host=random.choice(["", "", "pi", "hub"]),
        )
        for s in som
    )


def causes_of(som: Som) -> List[str]:
    """All that can fail: nodes, and what services fail with."""
    return sorted({cause for service in som for cause in service.causes})


def lost_services(robot: Ontology, som: Som, failed: Iterable[str]) -> List[str]:
    """The needed services that nothing replaces after some failures, by plain enumeration."""
    left = [source for source in som.sources if set(failed).isdisjoint(source.service.causes)]
    return [
        service.name
        for service in som.needed()
        if not set(failed).isdisjoint(service.causes)
        and not all(
            any(True for _ in every_derivation(robot, left, name)) for name in service.properties
        )
    ]


@RANDOM
@given(st.integers(0, 2**32))
def test_the_cuts_are_all_smallest_sets_of_causes_that_lose_a_service(seed: int) -> None:
    robot, som = random_robot(seed)
    nodes = causes_of(som)
    fatal = {
        frozenset(failed): lost_services(robot, som, failed)
        for size in (1, 2, 3)
        for failed in combinations(nodes, size)
    }
    smallest = {
        failed: services
        for failed, services in fatal.items()
        if services and not any(fatal[other] for other in fatal if other < failed)
    }
    report = analyse(robot, som, size=3)
    assert {frozenset(cut.nodes): sorted(cut.services) for cut in report.cuts} == {
        failed: sorted(services) for failed, services in smallest.items()
    }
    if len(nodes) > 1:
        for size, share in ((1, report.survival.single), (2, report.survival.double)):
            survived = sum(not fatal[frozenset(f)] for f in combinations(nodes, size))
            assert share == pytest.approx(survived / comb(len(nodes), size))


@RANDOM
@given(st.integers(0, 2**32))
def test_services_and_nodes_are_reported_as_healing_plans_them(seed: int) -> None:
    robot, som = random_robot(seed)
    random = Random(seed)
    functions = [
        dataclasses.replace(f, law=None) if random.random() < 0.2 else f for f in robot.functions
    ]
    robot = ontology(*functions)
    report = analyse(robot, som)
    table = SourceTable(robot.network, som.sources)
    warned = [f.what.split()[0] for f in check_model(robot, som) if "there is no" in f.what]
    assert warned == [each.service for each in report.services if each.quality is None]
    for service in report.services:
        node = next(n for n in report.nodes if n.node == service.node)
        try:
            plan = plan_service(robot, som.services[service.service], table, [service.node])
        except NoSubstitute as none:
            assert service.quality is None and service.missing == none.missing
            assert not service.refused
        except GenerationError as error:
            assert service.quality is None and service.refused == str(error)
        else:
            assert service.quality == pytest.approx(plan.quality)
            assert {c for source in plan.inputs for c in source.service.causes} == {*service.reads}
            assert (service.service, service.quality) in node.healed
        if service.quality is None:
            assert service.service in node.lost and (service.node,) in service.cuts
        for other in report.nodes:
            assert (service.service in other.leaned_on) == (other.node in service.reads)
            lost = service.service in lost_services(ontology(*executable(robot)), som, [other.node])
            assert (service.service in other.lost) == lost


def executable(robot: Ontology) -> List[TransferFunction]:
    return [function for function in robot.functions if function.law is not None] or [
        law("unused", "z", "y")
    ]


@RANDOM
@given(st.integers(0, 2**32))
def test_the_best_alternative_is_what_a_search_finds(seed: int) -> None:
    robot, som = random_robot(seed)
    for service in analyse(robot, som).services:
        for name in service.properties:
            try:
                best = find_substitute(robot, som.sources, name, [service.node])
            except NoSubstitute:
                assert not [a for a in service.alternatives if a.property == name]
            else:
                first = next(a for a in service.alternatives if a.property == name)
                assert first.quality == pytest.approx(best.quality)


def survived(robot: Ontology, som: Som, services: Iterable[Service]) -> Tuple[int, int]:
    """Count failures of one cause of the robot, and of two, that lose nothing then."""
    more = Som([*som, *services])
    one, two = (
        sum(not lost_services(robot, more, failed) for failed in combinations(causes_of(som), size))
        for size in (1, 2)
    )
    return one, two


@RANDOM
@given(st.integers(0, 2**32))
def test_the_suggested_sensor_is_the_one_that_raises_it_most(seed: int) -> None:
    robot, som = random_robot(seed)
    report = analyse(robot, som)
    assert report.exact == ("sensor", "relation")
    before = survived(robot, som, [])
    with_sensor = {
        name: survived(robot, som, [source(name, "/new", "/new").service])
        for name in {*robot.properties, *(s.property for s in som.sources)}
    }
    most = max(with_sensor.values(), default=before)
    if report.sensor is None:
        assert most == before
    else:
        assert with_sensor[report.sensor.property] == most > before
        count = len(causes_of(som))
        shares = [n / comb(count, k) if comb(count, k) else 1.0 for k, n in zip((1, 2), most)]
        assert dataclasses.astuple(report.sensor.survival) == pytest.approx(tuple(shares))


@RANDOM
@given(st.integers(0, 2**32))
def test_the_suggested_relation_is_the_one_that_raises_it_most(seed: int) -> None:
    robot, som = random_robot(seed)
    report = analyse(robot, som)
    before = survived(robot, som, [])
    measured = {source.property for source in som.sources}
    most = before
    for name in {*robot.properties, *measured}:
        for other in measured - {name}:
            more = ontology(*robot.functions, law("new", name, other))
            most = max(most, survived(more, som, []))
    if report.relation is None:
        assert most == before
    else:
        assert report.relation.source is not None
        new = law("new", report.relation.property, report.relation.source)
        assert survived(ontology(*robot.functions, new), som, []) == most > before


SPEED = source("speed", "/odom", "/drive", needed=True)
LEFT, RIGHT = source("left", node="/left_wheel"), source("right", node="/right_wheel")
GPS, RADAR = source("position", node="/gps"), source("speed", "/radar", "/radar", quality=0.5)
ROBOT = ontology(
    law("wheels", "speed", "left", "right", quality=0.9),
    law("motion", "speed", "position", quality=0.8),
    law("paths", "position", "gps_time"),
)


def test_alternatives_come_best_first_by_relation_or_source() -> None:
    (service,) = analyse(ROBOT, som_of([SPEED, LEFT, RIGHT, GPS, RADAR])).services
    assert (service.service, service.topic) == (SPEED.service.name, "/odom")
    assert [(a.by, a.quality) for a in service.alternatives] == [
        ("wheels", 0.9),
        ("motion", 0.8),
        ("/radar/speed", 0.5),
    ]
    assert service.alternatives[0].inputs == ("/left/left", "/right/right")
    assert service.alternatives[0].nodes == service.reads == ("/left_wheel", "/right_wheel")
    assert service.cuts == ()


def test_larger_cuts_are_found_on_request() -> None:
    som = som_of([SPEED, LEFT, RIGHT, GPS])
    assert analyse(ROBOT, som).cuts == ()
    report = analyse(ROBOT, som, size=3)
    assert [cut.nodes for cut in report.cuts] == [
        ("/drive", "/gps", "/left_wheel"),
        ("/drive", "/gps", "/right_wheel"),
    ]
    assert all(cut.services == (SPEED.service.name,) for cut in report.cuts)


def test_single_points_of_failure_and_their_remedies() -> None:
    report = analyse(ROBOT, som_of([SPEED, LEFT]))
    assert [cut.nodes for cut in report.cuts] == [("/drive",)]
    assert report.survival == Survival(0.5, 0.0)
    assert report.services[0].missing == ("gps_time", "right")
    assert report.nodes[0].lost == (SPEED.service.name,)
    assert report.sensor == Suggestion("speed", None, Survival(1.0, 1.0))
    assert report.relation == Suggestion("speed", "left", Survival(1.0, 0.0))


def test_a_relation_that_cannot_be_executed_does_not_count() -> None:
    learned = dataclasses.replace(law("learned", "speed", "left"), law=None)
    report = analyse(ontology(learned), som_of([SPEED, LEFT]))
    assert [cut.nodes for cut in report.cuts] == [("/drive",)]
    assert report.services[0].alternatives == ()


def test_nothing_is_suggested_for_a_robot_that_nothing_can_hurt() -> None:
    report = analyse(ROBOT, som_of([LEFT, RIGHT]))
    assert report.services == () and report.cuts == ()
    assert report.survival == Survival(1.0, 1.0)
    assert report.sensor is None and report.relation is None


def test_a_robot_of_one_node_and_of_none() -> None:
    assert analyse(ROBOT, som_of([SPEED])).survival == Survival(0.0, 1.0)
    assert analyse(ROBOT, Som()).survival == Survival(1.0, 1.0)


def test_a_sensor_that_changes_nothing_by_rounding_alone_is_not_suggested() -> None:
    """A third of the nodes is fatal: 1 - 1/3 is not 2/3 of a float."""
    spare = [source(name, "/" + name, "/node_" + name) for name in ("u", "v")]
    for count in range(3, 30):
        others = [source(f"o{i}") for i in range(count)]
        lost = source("lost", needed=True)
        report = analyse(ontology(law("f", "u", "v")), som_of([lost, *spare, *others]))
        assert report.sensor is not None and report.sensor.property == "lost"
        both = [source("a", "/ab", "/ab", needed=True), source("b", "/ab", "/ab", needed=True)]
        report = analyse(ontology(law("f", "u", "v")), som_of([*both, *spare, *others]))
        assert report.sensor is None and report.relation is None


def test_a_second_sensor_of_an_input_is_found() -> None:
    robot = ontology(law("f", "speed", "wheel"), law("g", "turn", "wheel"))
    odometry = [source("speed", "/odom", "/drive", needed=True), source("turn", "/odom", "/drive")]
    report = analyse(robot, som_of([*odometry, source("wheel", node="/drive")]))
    assert report.sensor == Suggestion("wheel", None, Survival(1.0, 1.0))


@pytest.mark.parametrize("shared", [{"fails_with": ("usb_hub",)}, {"host": "usb_hub"}])
def test_what_services_fail_with_is_a_cut(shared: Dict[str, Any]) -> None:
    som = Som(
        dataclasses.replace(s, **(shared if s.topic != "/right" else {}))
        for s in som_of([SPEED, LEFT, RIGHT])
    )
    report = analyse(ROBOT, som)
    assert [cut.nodes for cut in report.cuts] == [
        ("usb_hub",), ("/drive", "/left_wheel"), ("/drive", "/right_wheel"),
    ]  # fmt: skip
    (service,) = report.services
    assert service.quality == 0.9 and service.reads == ("/left_wheel", "usb_hub", "/right_wheel")
    hub = next(node for node in report.nodes if node.node == "usb_hub")
    assert hub.lost == (SPEED.service.name,) and hub.leaned_on == hub.lost
    (warning,) = [f for f in check_model(ROBOT, som) if "usb_hub" in f.what]
    assert "so does left_of_left_wheel, which its substitute reads" in warning.what


def test_a_robot_of_one_host_is_not_told_to_do_without_it() -> None:
    services = som_of([SPEED, LEFT, RIGHT])
    som = Som(dataclasses.replace(s, host="pi") for s in services)
    assert [f for f in check_model(ROBOT, som) if "pi" in f.what] == []
    assert [cut.nodes for cut in analyse(ROBOT, som).cuts][0] == ("pi",)


def test_what_is_too_large_for_code_is_lost() -> None:
    chain = [law(f"r{i}", f"p{i}", f"p{i + 1}") for i in range(1200)]
    som = som_of([source("p0", needed=True), source("p1200")])
    report = analyse(ontology(*chain), som)
    assert report.services[0].quality is None and "r1199" in report.services[0].refused
    assert [cut.nodes for cut in report.cuts] == [("/node_of_p0",)]


@pytest.mark.parametrize("seed", range(3))
def test_where_the_som_leaves_open_what_is_needed_all_of_it_is_reported(seed: int) -> None:
    robot, som = random_robot(seed)
    marked = lambda needed: Som(dataclasses.replace(each, needed=needed) for each in som)
    left_open, needed = analyse(robot, marked(None)), analyse(robot, marked(True))
    assert [each.service for each in left_open.services] == [each.name for each in som]
    assert left_open.nodes == needed.nodes and left_open.cuts == needed.cuts
    assert analyse(robot, marked(False)).services == ()
