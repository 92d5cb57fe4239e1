"""The resilience analysis: against trying every set of failed nodes, and in small robots worked out by hand."""
import dataclasses
from itertools import combinations
from math import comb
from random import Random
from typing import Iterable, List, Set, Tuple

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from search_models import every_derivation, law, ontology, random_model, service

from shsa_core.analysis.report import Suggestion, Survival
from shsa_core.analysis.resilience import analyse
from shsa_core.errors import NoSubstitute
from shsa_core.model.ontology import Ontology
from shsa_core.model.som import Som
from shsa_core.search.substitutes import find_substitute

RANDOM = settings(max_examples=300, deadline=None, derandomize=True)


def random_robot(seed: int) -> Tuple[Ontology, Som]:
    """A random ontology and SOM: no field twice, each topic on one node, some topics needed."""
    robot, services, _ = random_model(seed)
    random = Random(seed)
    nodes = {s.topic: s.node for s in services}
    needed = {s.topic: random.random() < 0.6 for s in services}
    fields = {
        s.path: dataclasses.replace(s, node=nodes[s.topic], needed=needed[s.topic])
        for s in services
    }
    return robot, Som(fields.values())


def lost_topics(robot: Ontology, som: Som, failed: Iterable[str]) -> List[str]:
    """The needed topics that nothing replaces after some nodes failed, by plain enumeration."""
    left = [s for s in som if s.node not in failed]
    lost = []
    for topic in dict.fromkeys(s.topic for s in som if s.needed):
        fields = som.of_topic(topic)
        if fields[0].node in failed:
            if not all(
                any(True for _ in every_derivation(robot, left, s.property)) for s in fields
            ):
                lost.append(topic)
    return lost


@RANDOM
@given(st.integers(0, 2**32))
def test_the_cuts_are_all_smallest_sets_of_nodes_that_lose_a_topic(seed: int) -> None:
    robot, som = random_robot(seed)
    nodes = sorted({s.node for s in som})
    fatal = {
        frozenset(failed): lost_topics(robot, som, failed)
        for size in (1, 2, 3)
        for failed in combinations(nodes, size)
    }
    smallest = {
        failed: topics
        for failed, topics in fatal.items()
        if topics and not any(fatal[other] for other in fatal if other < failed)
    }
    report = analyse(robot, som, size=3)
    assert {frozenset(cut.nodes): sorted(cut.topics) for cut in report.cuts} == {
        failed: sorted(topics) for failed, topics in smallest.items()
    }
    if len(nodes) > 1:
        for size, share in ((1, report.survival.single), (2, report.survival.double)):
            survived = sum(not fatal[frozenset(f)] for f in combinations(nodes, size))
            assert share == pytest.approx(survived / comb(len(nodes), size))


@RANDOM
@given(st.integers(0, 2**32))
def test_topics_and_nodes_are_reported_as_a_search_finds_them(seed: int) -> None:
    robot, som = random_robot(seed)
    report = analyse(robot, som)
    for topic in report.topics:
        quality = 1.0
        missing: Set[str] = set()
        for name in topic.properties:
            try:
                quality *= find_substitute(robot, som, name, [topic.node]).quality
            except NoSubstitute as none:
                missing.update(none.missing)
                quality = 0.0
        assert topic.quality == (pytest.approx(quality) if quality else None)
        assert topic.missing == tuple(sorted(missing))
        node = next(n for n in report.nodes if n.node == topic.node)
        if topic.quality is None:
            assert topic.topic in node.lost and topic.cuts == ((topic.node,),)
        else:
            assert (topic.topic, topic.quality) in node.healed
            for name in topic.properties:
                best = next(a for a in topic.alternatives if a.property == name)
                assert best.quality == pytest.approx(
                    find_substitute(robot, som, name, [topic.node]).quality
                )
        for other in report.nodes:
            assert (topic.topic in other.leaned_on) == (other.node in topic.reads)
        for cut in topic.cuts:
            assert topic.topic in lost_topics(robot, som, cut)


@RANDOM
@given(st.integers(0, 2**32))
def test_a_suggested_sensor_is_worth_what_it_says(seed: int) -> None:
    robot, som = random_robot(seed)
    report = analyse(robot, som)
    if report.sensor is not None:
        new = service(report.sensor.property, "/new", "/new")
        nodes = sorted({s.node for s in som})
        for size, share in ((1, report.sensor.survival.single), (2, report.sensor.survival.double)):
            sets = list(combinations(nodes, size))
            survived = sum(not lost_topics(robot, Som([*som, new]), failed) for failed in sets)
            assert share == (pytest.approx(survived / len(sets)) if sets else 1.0)
        assert dataclasses.astuple(report.sensor.survival) > dataclasses.astuple(report.survival)


SPEED = service("speed", "/odom", "/drive", needed=True)
LEFT, RIGHT = service("left", node="/left_wheel"), service("right", node="/right_wheel")
GPS, RADAR = service("position", node="/gps"), service("speed", "/radar", "/radar", quality=0.5)
ROBOT = ontology(
    law("wheels", "speed", "left", "right", quality=0.9),
    law("motion", "speed", "position", quality=0.8),
    law("paths", "position", "gps_time"),
)


def test_alternatives_come_best_first_by_relation_or_service() -> None:
    (topic,) = analyse(ROBOT, Som([SPEED, LEFT, RIGHT, GPS, RADAR])).topics
    assert [(a.by, a.quality) for a in topic.alternatives] == [
        ("wheels", 0.9),
        ("motion", 0.8),
        ("/radar/speed", 0.5),
    ]
    assert topic.alternatives[0].inputs == ("/left/left", "/right/right")
    assert topic.alternatives[0].nodes == topic.reads == ("/left_wheel", "/right_wheel")
    assert topic.cuts == ()


def test_larger_cuts_are_found_on_request() -> None:
    som = Som([SPEED, LEFT, RIGHT, GPS])
    assert analyse(ROBOT, som).cuts == ()
    report = analyse(ROBOT, som, size=3)
    assert [cut.nodes for cut in report.cuts] == [
        ("/drive", "/gps", "/left_wheel"),
        ("/drive", "/gps", "/right_wheel"),
    ]
    assert all(cut.topics == ("/odom",) for cut in report.cuts)


def test_single_points_of_failure_and_their_remedies() -> None:
    report = analyse(ROBOT, Som([SPEED, LEFT]))
    assert [cut.nodes for cut in report.cuts] == [("/drive",)]
    assert report.survival == Survival(0.5, 0.0)
    assert report.topics[0].missing == ("gps_time", "right")
    assert report.nodes[0].lost == ("/odom",)
    assert report.sensor == Suggestion("speed", None, Survival(1.0, 1.0))
    assert report.relation == Suggestion("speed", "left", Survival(1.0, 0.0))


def test_a_relation_that_cannot_be_executed_does_not_count() -> None:
    learned = dataclasses.replace(law("learned", "speed", "left"), expression=None)
    report = analyse(ontology(learned), Som([SPEED, LEFT]))
    assert [cut.nodes for cut in report.cuts] == [("/drive",)]
    assert report.topics[0].alternatives == ()


def test_nothing_is_suggested_for_a_robot_that_nothing_can_hurt() -> None:
    report = analyse(ROBOT, Som([LEFT, RIGHT]))
    assert report.topics == () and report.cuts == ()
    assert report.survival == Survival(1.0, 1.0)
    assert report.sensor is None and report.relation is None


def test_a_robot_of_one_node_and_of_none() -> None:
    assert analyse(ROBOT, Som([SPEED])).survival == Survival(0.0, 1.0)
    assert analyse(ROBOT, Som()).survival == Survival(1.0, 1.0)
