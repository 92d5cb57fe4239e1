"""The table of sources, kept up by changes: always the same as one that is made anew."""
import dataclasses
from random import Random
from typing import Iterable, List

from hypothesis import given, settings, strategies as st
from shsa_testing.models import random_model, source, usable

from shsa_core.model.ontology import Network
from shsa_core.model.service import Source
from shsa_core.search.derivation import LOST, SourceTable
from shsa_learning.substitutes import substitutes
from shsa_testing.thorough import many

NAMES = "abcdef"


def same(table: SourceTable, network: Network, sources: Iterable[Source]) -> None:
    fresh = SourceTable(network, sources)
    for number in map(network.number, NAMES):
        assert table.of(number) == fresh.of(number)
        assert table.rating(number) == fresh.rating(number)
        if fresh.rating(number) != LOST:
            assert table.best(number) == fresh.best(number)


@settings(max_examples=many(500), deadline=None, derandomize=True)
@given(st.integers(0, 2**32))
def test_a_table_that_is_kept_up_is_that_of_what_is_left(seed: int) -> None:
    robot, sources, excluded = random_model(seed)
    random = Random(seed)
    table = SourceTable(robot.network)
    left: List[Source] = []
    for _ in range(20):
        each = random.choice(sources) if sources else source("a")
        if random.random() < 0.6:
            table.add(each)
            left.append(each)
        else:
            table.discard(each)
            left = [other for other in left if other != each]
        same(table, robot.network, left)
        same(table.excluding(excluded), robot.network, usable(left, excluded))
        nodes = [random.choice(["/m", "/n"])]
        twice = table.excluding(excluded).excluding(nodes)
        same(twice, robot.network, usable(left, [*excluded, *nodes]))


def test_a_table_without_anything_to_leave_out_is_the_table_itself() -> None:
    robot, _, _ = random_model(0)
    table = SourceTable(robot.network, [source("a", "/t", "/n")])
    assert table.excluding(["/elsewhere"]) is table
    number = robot.network.number("a")
    for name in ("/t", "/n", source("a", "/t", "/n").service.name):
        assert table.excluding([name]).rating(number) == LOST
        assert table.excluding([name]).of(number) == []


def test_of_sources_that_are_as_good_the_faster_is_the_best() -> None:
    robot, _, _ = random_model(0)
    number = robot.network.number("a")
    slow, event = source("a", "/a0", "/n"), source("a", "/a1", "/n")
    event = dataclasses.replace(event.service, period=None).sources[0]
    fast = dataclasses.replace(source("a", "/a2", "/n").service, period=0.02).sources[0]
    worse = dataclasses.replace(source("a", "/a", "/n", 0.9).service, period=0.01).sources[0]
    assert SourceTable(robot.network, [event, slow, fast, worse]).best(number) == fast
    assert SourceTable(robot.network, [event, slow, worse]).best(number) == slow
    assert SourceTable(robot.network, [event, worse]).best(number) == event
    found = [each.derivation.source for each, _ in substitutes(robot, [event, slow, fast], "a")]
    assert found[:3] == [fast, slow, event]
