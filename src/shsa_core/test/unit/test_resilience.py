"""The resilience analysis: against trying every set of nodes, and by hand on small robots."""
import dataclasses
from itertools import combinations
from math import comb
from random import Random
from typing import Iterable, List, Set, Tuple

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from search_models import every_derivation, law, ontology, random_model, som_of, source

from shsa_core.analysis.report import Suggestion, Survival
from shsa_core.analysis.resilience import analyse
from shsa_core.errors import NoSubstitute
from shsa_core.model.ontology import Ontology
from shsa_core.model.som import Som
from shsa_core.search.substitutes import find_substitute

RANDOM = settings(max_examples=300, deadline=None, derandomize=True)


def random_robot(seed: int) -> Tuple[Ontology, Som]:
    """A random ontology and SOM; some services are needed, and some share a topic."""
    robot, sources, _ = random_model(seed)
    random = Random(seed)
    som = som_of(sources)
    needed = {service.topic: random.random() < 0.6 for service in som}
    return robot, Som(dataclasses.replace(s, needed=needed[s.topic]) for s in som)


def lost_services(robot: Ontology, som: Som, failed: Iterable[str]) -> List[str]:
    """The needed services that nothing replaces after some nodes failed, by plain enumeration."""
    left = [source for source in som.sources if source.node not in failed]
    return [
        service.name
        for service in som.needed()
        if service.node in failed
        and not all(
            any(True for _ in every_derivation(robot, left, name)) for name in service.properties
        )
    ]


@RANDOM
@given(st.integers(0, 2**32))
def test_the_cuts_are_all_smallest_sets_of_nodes_that_lose_a_service(seed: int) -> None:
    robot, som = random_robot(seed)
    nodes = sorted({service.node for service in som})
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
def test_services_and_nodes_are_reported_as_a_search_finds_them(seed: int) -> None:
    robot, som = random_robot(seed)
    report = analyse(robot, som)
    for service in report.services:
        quality = 1.0
        missing: Set[str] = set()
        for name in service.properties:
            try:
                quality *= find_substitute(robot, som.sources, name, [service.node]).quality
            except NoSubstitute as none:
                missing.update(none.missing)
                quality = 0.0
        assert service.quality == (pytest.approx(quality) if quality else None)
        assert service.missing == tuple(sorted(missing))
        node = next(n for n in report.nodes if n.node == service.node)
        if service.quality is None:
            assert service.service in node.lost and service.cuts == ((service.node,),)
        else:
            assert (service.service, service.quality) in node.healed
            for name in service.properties:
                best = next(a for a in service.alternatives if a.property == name)
                assert best.quality == pytest.approx(
                    find_substitute(robot, som.sources, name, [service.node]).quality
                )
        for other in report.nodes:
            assert (service.service in other.leaned_on) == (other.node in service.reads)
        for cut in service.cuts:
            assert service.service in lost_services(robot, som, cut)


@RANDOM
@given(st.integers(0, 2**32))
def test_a_suggested_sensor_is_worth_what_it_says(seed: int) -> None:
    robot, som = random_robot(seed)
    report = analyse(robot, som)
    if report.sensor is not None:
        new = source(report.sensor.property, "/new", "/new").service
        nodes = sorted({service.node for service in som})
        for size, share in ((1, report.sensor.survival.single), (2, report.sensor.survival.double)):
            sets = list(combinations(nodes, size))
            survived = sum(not lost_services(robot, Som([*som, new]), failed) for failed in sets)
            assert share == (pytest.approx(survived / len(sets)) if sets else 1.0)
        assert dataclasses.astuple(report.sensor.survival) > dataclasses.astuple(report.survival)


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
