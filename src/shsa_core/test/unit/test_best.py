"""The search touches only what may be part of a better derivation."""
from typing import Any, List, Sequence

from shsa_testing.models import law, ontology, source

from shsa_core.model.ontology import Ontology
from shsa_core.model.service import Source
from shsa_core.search.best import BestDerivations
from shsa_core.search.derivation import LOST, UNRATED, SourceTable


def reached(robot: Ontology, sources: Sequence[Source], **options: Any) -> List[str]:
    """Return the properties that are rated in a search for `a`."""
    network = robot.network
    best = BestDerivations(SourceTable(network, sources), **options)
    best.settle(network.number("a"))
    return [name for n, name in enumerate(network.names) if best.ratings[n] != UNRATED]


CHAIN = [law("ab", "a", "b", quality=0.9), law("bc", "b", "c", quality=0.9), law("xa", "x", "a")]


def test_only_what_the_target_depends_on_is_touched() -> None:
    assert reached(ontology(*CHAIN), [source("c")]) == ["a", "b", "c"]


def test_nothing_is_followed_that_cannot_be_better_than_a_source() -> None:
    assert reached(ontology(*CHAIN), [source("c"), source("b", quality=0.9)]) == ["a", "b"]
    assert reached(ontology(*CHAIN), [source("c"), source("b", quality=0.89)]) == ["a", "b", "c"]
    assert reached(ontology(*CHAIN), [source("a")]) == ["a"]
    everything = reached(ontology(*CHAIN), [source("c"), source("a")], prune=False)
    assert everything == ["a", "b", "c"]


def test_functions_that_are_not_usable_are_not_followed() -> None:
    robot = ontology(*CHAIN, law("ay", "a", "y"))
    unusable = [f.relation for f in robot.network.functions].index("bc")
    assert reached(robot, [source("c")], usable=lambda f: f != unusable) == ["a", "b", "y"]


def test_a_cycle_is_settled_together_and_known() -> None:
    robot = ontology(
        law("ab", "a", "b"),
        law("bc", "b", "c"),
        law("ca", "c", "a"),
        law("cd", "c", "d"),
        law("de", "d", "e"),
    )
    network = robot.network
    best = BestDerivations(SourceTable(network, [source("e")]))
    assert best.settle(network.number("a"))
    names = {
        network.names[n]: {network.names[m] for m in cycle} for n, cycle in best.cycles().items()
    }
    assert names == dict.fromkeys("abc", {"a", "b", "c"})
    assert reached(robot, [source("e")]) == ["a", "b", "c", "d", "e"]


def test_two_cycles_are_kept_apart() -> None:
    robot = ontology(
        law("ab", "a", "b"),
        law("ba", "b", "a"),
        law("bc", "b", "c"),
        law("cd", "c", "d"),
        law("dc", "d", "c"),
    )
    network = robot.network
    best = BestDerivations(SourceTable(network, []))
    assert not best.settle(network.number("a"))
    cycles = {frozenset(network.names[m] for m in cycle) for cycle in best.cycles().values()}
    assert cycles == {frozenset("ab"), frozenset("cd")}
    assert all(best.ratings[n] == LOST for n in range(4))


def test_several_targets_share_what_they_depend_on() -> None:
    robot = ontology(*CHAIN, law("yb", "y", "b"))
    network = robot.network
    best = BestDerivations(SourceTable(network, [source("c")]))
    for name in ("a", "y", "a"):
        assert best.settle(network.number(name))
    first, second = (best.ratings.derivation(network.number(name)) for name in "ay")
    assert first.inputs[0] is second.inputs[0]
