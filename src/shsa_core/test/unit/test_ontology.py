"""The ontology as a graph."""
from typing import Tuple

from shsa_core.language.expression import parse_law
from shsa_core.model.ontology import Constant, Ontology, Property, TransferFunction


def function(
    relation: str, output: str, text: str, inputs: Tuple[str, ...], quality: float = 1.0
) -> TransferFunction:
    return TransferFunction(relation, output, inputs, parse_law(text), quality, text=text)


ONTOLOGY = Ontology(
    {name: Property(name) for name in ("a", "b", "c", "alone")},
    {"k": Constant("k", 2.0)},
    (
        function("s", "a", "b + c", ("b", "c"), 0.5),
        function("r", "a", "b*k", ("b",)),
        function("r", "b", "a/k", ("a",)),
    ),
)


def test_the_graph_is_bipartite_and_follows_the_data() -> None:
    graph = ONTOLOGY.graph
    kinds = dict(graph.nodes(data="kind"))
    assert {node for node, kind in kinds.items() if kind == "property"} == {"a", "b", "c", "alone"}
    assert {node for node, kind in kinds.items() if kind == "relation"} == {
        ("s", "a"),
        ("r", "a"),
        ("r", "b"),
    }
    assert set(graph.edges) == {
        ("b", ("s", "a")),
        ("c", ("s", "a")),
        (("s", "a"), "a"),
        ("b", ("r", "a")),
        (("r", "a"), "a"),
        ("a", ("r", "b")),
        (("r", "b"), "b"),
    }
    assert graph.nodes[("s", "a")]["quality"] == 0.5


def test_where_it_stands_makes_no_difference() -> None:
    assert Property("a", where="f:1") == Property("a", where="f:2")
    assert Constant("k", 1.0, where="f:1") == Constant("k", 1.0)
