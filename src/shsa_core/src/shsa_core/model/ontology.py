"""The ontology: properties and the relations between them (Section III of the paper)."""
from dataclasses import dataclass, field
from typing import Mapping, Optional, Sequence, Tuple

import networkx as nx

from shsa_core.model.network import Network
from shsa_core.model.relation import TransferFunction


@dataclass(frozen=True)
class Property:
    """A quantity of the robot. `unit` is its unit as text, `""` if it is not known.

    `usual`: the lowest and highest value that it usually has, None: not known; `where`: file and
    line.
    """

    name: str
    unit: str = ""
    symbol: str = ""
    where: str = field(default="", compare=False, repr=False)
    usual: Optional[Tuple[float, float]] = None


@dataclass(frozen=True)
class Constant:
    """A property that never changes; `value` in `unit`."""

    name: str
    value: float
    unit: str = ""
    where: str = field(default="", compare=False, repr=False)


@dataclass(frozen=True)
class Ontology:
    """Properties, constants and relations; immutable once made.

    `graph` is the bipartite graph of properties and functions. The node of a property is its name
    (`kind="property"`), that of a function the pair of its relation and its output
    (`kind="relation"`, `function`). Edges lead from inputs to functions to outputs. `network` is
    the form of it that the search uses.
    """

    properties: Mapping[str, Property]
    constants: Mapping[str, Constant]
    functions: Sequence[TransferFunction]
    graph: nx.DiGraph = field(init=False, repr=False, compare=False)
    network: Network = field(init=False, repr=False, compare=False)

    def __post_init__(self) -> None:
        graph = nx.DiGraph()
        graph.add_nodes_from(self.properties, kind="property")
        for function in self.functions:
            node = (function.relation, function.output)
            graph.add_nodes_from((function.output, *function.inputs), kind="property")
            graph.add_node(node, kind="relation", function=function, quality=function.quality)
            graph.add_edges_from((name, node) for name in function.inputs)
            graph.add_edge(node, function.output)
        object.__setattr__(self, "graph", graph)
        object.__setattr__(self, "network", Network(graph))

    def functions_for(self, name: str) -> Tuple[TransferFunction, ...]:
        """Return the functions that yield the property `name`, in order of their relations."""
        nodes = sorted(self.graph.predecessors(name)) if name in self.graph else ()
        return tuple(self.graph.nodes[node]["function"] for node in nodes)


EMPTY = Ontology({}, {}, ())
"""Nothing is known, and so nothing is compared."""
