"""What is missing: the last parts of a graph, against networkx, and messages that stay short."""
from random import Random

import networkx as nx
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from shsa_core.errors import LISTED, NoSubstitute
from shsa_core.search.missing import last_parts


@settings(max_examples=1000, deadline=None, derandomize=True)
@given(st.integers(0, 2**32))
def test_the_last_parts_are_those_that_reach_no_other(seed: int) -> None:
    random = Random(seed)
    size = random.randint(1, 12)
    graph = nx.DiGraph()
    graph.add_nodes_from(range(size))
    for _ in range(random.randint(0, 2 * size)):
        graph.add_edge(random.randrange(size), random.randrange(size))
    reached = graph.subgraph({0} | nx.descendants(graph, 0))
    parts = nx.condensation(reached)
    last = [parts.nodes[part]["members"] for part in parts if parts.out_degree(part) == 0]
    assert last_parts(0, lambda number: list(graph.successors(number))) == set().union(*last)


def test_long_chains_do_not_recurse() -> None:
    size = 50000
    assert last_parts(0, lambda number: [number + 1] if number < size else []) == {size}
    assert len(last_parts(0, lambda number: [(number + 1) % size])) == size


@pytest.mark.parametrize("count, end", [(LISTED, "p19"), (LISTED + 3, "p19 and 3 more")])
def test_a_message_lists_the_first_names(count: int, end: str) -> None:
    none = NoSubstitute(["a"], [f"p{i}" for i in range(count)])
    assert str(none).endswith(end) and len(none.missing) == count
