"""The search: against enumeration on random ontologies, and its rule for best."""
from itertools import islice
from typing import List, Sequence, Tuple

import pytest
from hypothesis import event, given, settings
from hypothesis.strategies import integers
from shsa_testing.models import Rank, every_derivation, law, models, ontology, rank, source, usable

from shsa_core.errors import NoSubstitute
from shsa_core.model.ontology import Ontology, TransferFunction
from shsa_core.model.service import Source
from shsa_core.search.depth_first import first_found
from shsa_core.search.derivation import SourceTable
from shsa_learning.substitutes import Substitute, find_substitute, substitutes
from shsa_testing.thorough import many

Model = Tuple[Ontology, List[Source], List[str]]
MANY = 2000  # derivations, more than which a random model is left out

RANDOM = settings(max_examples=many(2000), deadline=None, derandomize=True)


def every_rank(model: Model) -> List[Rank]:
    robot, sources, excluded = model
    every = every_derivation(robot, usable(sources, excluded), "a")
    ranks = sorted(map(rank, islice(every, MANY)))
    event("substitutes: " + ("many" if len(ranks) > 8 else str(len(ranks))))
    return ranks


@RANDOM
@given(models)
def test_substitute_is_the_best_of_all(model: Model) -> None:
    robot, sources, excluded = model
    every = every_rank(model)
    if not every:
        with pytest.raises(NoSubstitute):
            find_substitute(robot, sources, "a", excluded)
    elif len(every) < MANY:
        found = find_substitute(robot, sources, "a", excluded)
        assert rank(found.derivation) == every[0]
        assert found.quality == pytest.approx(float(-every[0][0]))
        assert found.proven_best


@RANDOM
@given(models, integers(0, 8))
def test_a_search_with_a_deadline_finds_a_substitute_where_there_is_one(
    model: Model, steps: int
) -> None:
    robot, sources, excluded = model
    every = every_rank(model)
    if not every:
        with pytest.raises(NoSubstitute):
            find_substitute(robot, sources, "a", excluded, steps)
    elif len(every) < MANY:
        found = find_substitute(robot, sources, "a", excluded, steps)
        assert rank(found.derivation) in every
        assert found.proven_best <= (rank(found.derivation) == every[0])


def test_more_steps_find_a_better_substitute() -> None:
    first = [law("a", "a", "b", quality=0.5), law("b", "b", "s", quality=0.5)]
    far = [law("z0", "a", "c1", quality=0.9)]
    far += [law(f"c{i}", f"c{i}", f"c{i + 1}", quality=0.99) for i in range(1, 20)]
    robot = ontology(*first, *far, law("c20", "c20", "s", quality=0.99))
    found = [find_substitute(robot, [source("s")], "a", (), steps) for steps in (0, 4, 24, None)]
    assert [each.proven_best for each in found] == [False, False, True, True]
    assert [each.quality for each in found[:2]] == [0.25, 0.25]
    assert [each.quality for each in found[2:]] == [pytest.approx(0.9 * 0.99**20)] * 2


@RANDOM
@given(models)
def test_substitutes_come_best_first_and_all_do(model: Model) -> None:
    robot, sources, excluded = model
    every = every_rank(model)
    if len(every) < MANY:
        found = [each for each, _ in substitutes(robot, usable(sources, excluded), "a")]
        assert [rank(each.derivation) for each in found] == every
        assert [each.proven_best for each in found] == [i == 0 for i in range(len(every))]


@RANDOM
@given(models)
def test_the_first_found_is_a_substitute_if_there_is_one(model: Model) -> None:
    robot, sources, excluded = model
    every = every_rank(model)
    table = SourceTable(robot.network, usable(sources, excluded))
    found = first_found(table, robot.network.number("a"))
    if not every:
        assert found is None
    elif len(every) < MANY:
        assert found is not None and rank(found.derivation) in every


def first(robot: Ontology, sources: Sequence[Source], target: str) -> Sequence[str]:
    """Return the relations of the substitute that is found first."""
    network = robot.network
    found = first_found(SourceTable(network, sources), network.number(target))
    assert found is not None
    return found.derivation.relations()


def best(
    functions: Sequence[TransferFunction], sources: Sequence[Source], excluded: Sequence[str] = ()
) -> Substitute:
    return find_substitute(ontology(*functions), sources, "a", excluded)


def relations(found: Substitute) -> Tuple[str, ...]:
    return found.derivation.relations()


def test_the_highest_quality_wins_whatever_it_takes() -> None:
    functions = [
        law("short", "a", "b", quality=0.8),
        law("long", "a", "c", quality=0.9),
        law("more", "c", "d", "e"),
    ]
    found = best(functions, [source("b"), source("d"), source("e")])
    assert relations(found) == ("long", "more") and found.quality == 0.9


def test_qualities_count_as_often_as_they_are_used() -> None:
    functions = [
        law("twice", "a", "b", "c"),
        law("left", "b", "d"),
        law("right", "c", "d"),
        law("once", "a", "e", quality=0.85),
    ]
    assert relations(best(functions, [source("d", quality=0.9), source("e")])) == ("once",)
    found = best(functions, [source("d", quality=0.95), source("e")])
    assert relations(found) == ("twice", "left", "right") and found.quality == pytest.approx(0.9025)


def test_of_equal_quality_fewer_relations_win() -> None:
    functions = [
        law("b1", "a", "b", quality=0.9),
        law("b2", "b", "c", quality=0.9),
        law("z", "a", "d", quality=0.81),
    ]
    assert relations(best(functions, [source("c"), source("d")])) == ("z",)


def test_of_equal_relations_fewer_inputs_win() -> None:
    functions = [law("b", "a", "b", "c"), law("z", "a", "d")]
    assert relations(best(functions, [source("b"), source("c"), source("d")])) == ("z",)


def test_of_equal_inputs_names_decide() -> None:
    functions = [law("s", "a", "b"), law("r", "a", "c")]
    assert relations(best(functions, [source("b"), source("c")])) == ("r",)
    found = best(
        [law("r", "a", "b")],
        [source("b", "/y", "/n"), source("b", "/x", "/o"), source("b", "/x", "/m")],
    )
    assert [(s.topic, s.node) for s in found.derivation.sources()] == [("/x", "/m")]


def test_a_service_elsewhere_is_passed_on() -> None:
    spare = source("a", "/spare", quality=0.5)
    found = best(
        [law("r", "a", "b", quality=0.4)],
        [source("a", "/lost"), spare, source("b")],
        excluded=["/lost"],
    )
    assert found.derivation.source is spare and found.quality == 0.5


def test_nothing_is_used_of_an_excluded_node_or_topic() -> None:
    functions = [law("r", "a", "b"), law("s", "a", "c", quality=0.5)]
    sources = [source("b", "/b", "/n"), source("c", "/c", "/m")]
    assert relations(best(functions, sources, excluded=["/n"])) == ("s",)
    assert relations(best(functions, sources, excluded=["/b"])) == ("s",)
    with pytest.raises(NoSubstitute):
        best(functions, sources, excluded=["/b", "/m"])


def test_a_relation_without_inputs_is_enough() -> None:
    assert relations(best([law("always", "a")], [])) == ("always",)


def test_a_property_that_the_ontology_does_not_know() -> None:
    assert best([], [source("a")]).quality == 1.0
    with pytest.raises(NoSubstitute, match="missing any relation that yields it"):
        best([], [])


@pytest.mark.parametrize(
    "functions, sources, missing",
    [
        ([law("r", "a", "b", "c"), law("s", "b", "d")], ["c"], ("d",)),
        ([law("r", "a", "b"), law("s", "a", "c")], [], ("b", "c")),
        (
            [law("ui", "p", "u", "a"), law("pu", "a", "p", "u"), law("pi", "u", "p", "a")],
            ["u"],
            ("p",),
        ),
        (
            [law("ui", "p", "u", "a"), law("pu", "a", "p", "u"), law("pi", "u", "p", "a")],
            [],
            ("p", "u"),
        ),
        ([law("r", "a", "b"), law("s", "b", "c"), law("t", "c", "b")], [], ("b", "c")),
        (
            [law("r", "a", "b"), law("s", "b", "c"), law("t", "c", "b"), law("u", "c", "d")],
            [],
            ("d",),
        ),
        ([law("r", "a", "a")], [], ()),
    ],
)
def test_what_is_missing_is_where_the_derivations_ended(
    functions: List[TransferFunction], sources: List[str], missing: Tuple[str, ...]
) -> None:
    with pytest.raises(NoSubstitute) as none:
        find_substitute(ontology(*functions), [source(name) for name in sources], "a")
    assert none.value.missing == missing
    assert none.value.properties == ("a",)


def test_long_chains_neither_underflow_nor_recurse() -> None:
    length = 20000
    chain = [law(f"r{i}", f"p{i}", f"p{i + 1}", quality=0.5) for i in range(length)]
    worse = law("worse", "p0", "q", quality=0.4)
    robot = ontology(*chain, worse, law("first", "q", f"p{length}", quality=0.5))
    sources = [source(f"p{length}"), source("p10", "/half", quality=0.5)]
    found = find_substitute(robot, sources[:1], "p0", ["/p0"])
    assert relations(found) == ("worse", "first") and found.quality == pytest.approx(0.2)
    only = ontology(*chain)
    found = find_substitute(only, sources[:1], "p0")
    assert len(relations(found)) == length and 0 < found.quality < 1e-300
    assert len(first(only, sources[:1], "p0")) == length
    assert len(list(substitutes(only, sources, "p0"))) == 2
    assert relations(find_substitute(only, sources, "p0")) == tuple(f"r{i}" for i in range(10))


def test_uses_that_double_at_every_level_are_counted_without_end() -> None:
    levels = 300
    ladder = [law(f"l{i}", f"p{i}", f"p{i + 1}", f"q{i + 1}", quality=0.9) for i in range(levels)]
    ladder += [
        law(f"m{i}", f"q{i}", f"p{i + 1}", f"q{i + 1}", quality=0.9) for i in range(1, levels)
    ]
    robot = ontology(*ladder)
    sources = [source(f"p{levels}"), source(f"q{levels}")]
    found = find_substitute(robot, sources, "p0")
    assert len(found.derivation.unique()) == 2 * levels + 1
    assert 0 < found.quality < 1e-300
    assert found.derivation.inputs[0].inputs[0] is found.derivation.inputs[1].inputs[0]


def test_a_better_derivation_within_a_cycle_is_found_though_a_worse_comes_first() -> None:
    functions = [
        law("ab", "a", "b", quality=0.9),
        law("ba", "b", "a", quality=0.9),
        law("ac", "a", "c", quality=0.5),
        law("bd", "b", "d", quality=0.7),
    ]
    found = best(functions, [source("c"), source("d")])
    assert relations(found) == ("ab", "bd") and found.quality == pytest.approx(0.63)


def test_the_first_found_goes_depth_first() -> None:
    functions = [
        law("r", "a", "b", quality=0.1),
        law("s", "a", "c"),
        law("t", "b", "d", quality=0.1),
    ]
    robot, sources = ontology(*functions), [source("c"), source("d")]
    assert first(robot, sources, "a") == ("r", "t")
    assert first(robot, sources[:1], "a") == ("s",)


def test_the_first_found_comes_back_to_what_the_path_blocked() -> None:
    functions = [
        law("r1", "a", "b", "c"),
        law("r2", "b", "c"),
        law("r3", "c", "b"),
        law("r4", "c", "d"),
    ]
    assert first(ontology(*functions), [source("d")], "a") == ("r1", "r2", "r4")
