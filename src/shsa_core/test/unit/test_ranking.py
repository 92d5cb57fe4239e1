"""Every derivation of a property, by each of its functions."""
from itertools import islice
from typing import List, Tuple

import pytest
from shsa_testing.models import law, ontology, random_model, source

from shsa_core.search.derivation import Derivation, Rated, SourceTable
from shsa_core.search.ranking import Ranking

Key = Tuple[Tuple[float, int, int], Tuple[object, ...]]


def tree(derivation: Derivation) -> Tuple[object, ...]:
    return (derivation.name(), *map(tree, derivation.inputs))


def keys(rated: List[Rated]) -> List[Key]:
    return [(each.key, tree(each.derivation)) for each in rated]


@pytest.mark.parametrize("seed", range(30))
def test_the_derivations_by_each_function_are_all_but_the_sources(seed: int) -> None:
    model, sources, _ = random_model(seed)
    network, table = model.network, SourceTable(model.network, sources)
    for number in range(len(network.names)):
        joint = list(islice(Ranking(table).joint([number]), 300))
        if len(joint) == 300:
            continue
        parts = [each._replace(derivation=each.derivation.inputs[0]) for each in joint]
        ways = [list(way) for way in Ranking(table).by_function(number)]
        for way in ways:
            assert len({each.derivation.function for each in way}) == 1
            assert [each.key for each in way] == sorted(each.key for each in way)
        found = sorted(key for way in ways for key in keys(way))
        assert found == sorted(keys([each for each in parts if each.derivation.function]))


def test_a_function_without_inputs_at_hand_has_no_way() -> None:
    model = ontology(law("near", "y", "x"), law("far", "y", "z"))
    table = SourceTable(model.network, [source("x"), source("y")])
    (way,) = Ranking(table).by_function(model.network.number("y"))
    assert [each.derivation.relations() for each in way] == [("near",)]
