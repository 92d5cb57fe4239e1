"""Missing properties: enough to derive what is lost, in linear time; messages stay short."""
from random import Random
from typing import List, Sequence

import pytest
from hypothesis import given, settings, strategies as st
from shsa_testing.models import every_derivation, law, ontology, random_model, source

from shsa_core.errors import LISTED, NoSubstitute
from shsa_core.model.ontology import Ontology
from shsa_learning.substitutes import find_substitute
from shsa_testing.thorough import many


def missing(model: Ontology, available: Sequence[str] = (), target: str = "a") -> List[str]:
    with pytest.raises(NoSubstitute) as none:
        find_substitute(model, [source(name) for name in available], target)
    return list(none.value.missing)


def test_what_waits_for_itself_is_missing_though_something_else_is_too() -> None:
    model = ontology(law("f", "a", "x", "b", "c"), law("g", "b", "c"), law("h", "c", "b", "x"))
    assert missing(model) == ["b", "c", "x"]
    model = ontology(law("f", "a", "b"), law("g", "b", "c"), law("h", "c", "b"), law("i", "c", "x"))
    assert missing(model) == ["x"]


def test_a_cycle_within_a_cycle_is_unlocked_as_far_as_it_can_be() -> None:
    model = ontology(
        law("f", "a", "b"), law("g", "b", "c", "x"), law("h", "c", "b"), law("i", "d", "c"),
        law("j", "c", "d"), law("k", "d", "y"),
    )  # fmt: skip
    assert missing(model) == ["x", "y"]


@settings(max_examples=many(1500), deadline=None, derandomize=True)
@given(st.integers(0, 2**32))
def test_with_all_that_is_missing_the_lost_can_be_derived(seed: int) -> None:
    model, sources, excluded = random_model(seed)
    available = [s for s in sources if Random(seed).random() < 0.5]
    for target in model.properties:
        try:
            find_substitute(model, available, target, excluded)
        except NoSubstitute as none:
            assert target not in none.missing
            left = [s for s in available if {s.topic, s.node}.isdisjoint(excluded)]
            enough = left + [source(name, "/new_" + name) for name in none.missing]
            found = any(True for _ in every_derivation(model, enough, target))
            alone = all(target in f.inputs for f in model.functions if f.output == target)
            assert found == bool(none.missing)
            assert none.missing or alone


def test_long_chains_do_not_recurse() -> None:
    chain = [law(f"r{i}", f"p{i}", f"p{i + 1}") for i in range(3000)]
    assert missing(ontology(*chain), target="p0") == ["p3000"]
    assert len(missing(ontology(*chain, law("back", "p3000", "p1")), target="p0")) == 3000


@pytest.mark.parametrize("count, end", [(LISTED, "p19"), (LISTED + 3, "p19 and 3 more")])
def test_a_message_lists_the_first_names(count: int, end: str) -> None:
    none = NoSubstitute(["a"], [f"p{i}" for i in range(count)])
    assert str(none).endswith(end) and len(none.missing) == count
